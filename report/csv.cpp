#include "report/csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "cale/text.h"
#include "report/ranges.h"
#include "storage/files.h"

namespace cale {
namespace {

std::runtime_error damaged(const std::filesystem::path& path, std::size_t line,
                           const std::vector<std::string>& cells) {
    return std::runtime_error(fmt::format("{} is damaged: line {} is '{:.100}'", path.string(), line,
                                          printable(joined(cells, ","))));
}

std::string without_blanks(std::string_view text) {
    const auto first = text.find_first_not_of(' '), last = text.find_last_not_of(' ');
    return first == text.npos ? "" : std::string(text.substr(first, last - first + 1));
}

/// The cells of a line as csv_line() writes it, but for line breaks in a cell.
std::vector<std::string> cells_of(std::string_view line) {
    if (line.find('"') == line.npos) return split(line, ',');
    std::vector<std::string> cells(1);
    bool quoted = false;
    for (std::size_t i = 0; i < line.size(); ++i) {
        const bool twice = quoted && line[i] == '"' && i + 1 < line.size() && line[i + 1] == '"';
        if (twice) {
            cells.back() += line[i++];
        } else if (line[i] == '"') {
            quoted = !quoted;
        } else if (line[i] == ',' && !quoted) {
            cells.emplace_back();
        } else {
            cells.back() += line[i];
        }
    }
    return cells;
}

CsvTable table_of(const std::filesystem::path& path, const std::string& text, bool by_hand) {
    CsvTable table{.path = path};
    constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
    std::size_t line_number = 0, start = text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : 0;
    for (std::size_t end = 0; (end = text.find('\n', start)) != text.npos; start = end + 1) {
        auto line = std::string_view(text).substr(start, end - start);
        if (line.ends_with('\r')) line.remove_suffix(1);
        ++line_number;
        if (by_hand && line.empty()) continue;
        const bool in_front = table.columns.empty();
        if (line.starts_with('#') && (in_front || by_hand)) {
            if (in_front) table.comment = line.substr(1);
            continue;
        }
        auto cells = cells_of(line);
        if (by_hand)
            for (auto& cell : cells) cell = without_blanks(cell);
        if (in_front) {
            table.columns = std::move(cells);
            continue;
        }
        if (cells.size() != table.columns.size()) throw damaged(path, line_number, cells);
        table.rows.push_back(std::move(cells));
        table.lines.push_back(line_number);
    }
    if (table.columns.empty())
        throw std::runtime_error(fmt::format("{} has no header: it is empty or damaged", path.string()));
    if (start < text.size()) table.cut_line = line_number + 1;
    return table;
}

}  // namespace

std::optional<std::size_t> CsvTable::find(std::string_view column) const {
    const auto found = std::ranges::find(columns, column);
    if (found == columns.end()) return std::nullopt;
    return static_cast<std::size_t>(found - columns.begin());
}

double CsvTable::number(std::size_t row, std::size_t column) const {
    const auto value = number_in<double>(rows[row][column]);
    if (!value || !std::isfinite(*value)) throw damaged(path, lines[row], rows[row]);
    return *value;
}

double CsvTable::score(std::size_t row, std::size_t column) const {
    const double value = number(row, column);
    if (std::abs(value) <= kHighestScore) return value;
    throw std::runtime_error(
        fmt::format("{} is damaged: line {} has a score of {:g}, beyond what any game counts to",
                    path.string(), lines[row], value));
}

CsvTable read_csv(const std::filesystem::path& path, std::size_t bytes) {
    auto text = read_file(path);
    text.resize(std::min(bytes, text.size()));
    return table_of(path, text, /*by_hand=*/false);
}

CsvTable read_csv_by_hand(const std::filesystem::path& path) {
    const auto text = read_file(path);
    auto table = table_of(path, text + '\n', /*by_hand=*/true);
    if (!text.ends_with('\n')) table.cut_line = 1 + static_cast<std::size_t>(std::ranges::count(text, '\n'));
    return table;
}

CsvTable read_whole_csv(const std::filesystem::path& path) {
    auto table = read_csv(path);
    require_whole(table);
    return table;
}

void require_whole(const CsvTable& table) {
    if (table.cut_line)
        throw std::runtime_error(fmt::format("{} is damaged: it ends in the middle of line {}",
                                             table.path.string(), *table.cut_line));
}

std::string csv_line(const std::vector<std::string>& cells) {
    std::string line;
    for (const auto& cell : cells) {
        if (&cell != cells.data()) line += ',';
        if (cell.find_first_of(",\"\n") == cell.npos && !cell.starts_with('#')) {
            line += cell;
            continue;
        }
        line += '"';
        for (const char c : cell) line.append(c == '"' ? 2 : 1, c);
        line += '"';
    }
    return line + '\n';
}

}  // namespace cale
