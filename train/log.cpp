#include "train/log.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include "cale/text.h"
#include "report/learning_curve.h"
#include "storage/files.h"

namespace cale {
namespace {

constexpr double kFramesPerSecond = 60;
constexpr std::string_view kProgressColumns = "global_step,frame,seconds,steps_per_second";
constexpr std::ptrdiff_t kFixedColumns = 4;

/// The lines that are complete: a run that was killed may leave half of one.
std::vector<std::string_view> whole_lines(std::string_view text) {
    std::vector<std::string_view> lines;
    for (auto end = text.find('\n'); end != text.npos; end = text.find('\n')) {
        lines.push_back(text.substr(0, end));
        text.remove_prefix(end + 1);
    }
    return lines;
}

/// Returns the path of an episodes.csv that is to be continued behind its first `offset` bytes. Throws
/// CutFile, before anything is cut off, where a line of these is no episode or none ends there: the end of
/// the run reads all.
const std::filesystem::path& checked_episodes(const std::filesystem::path& path,
                                              std::optional<std::int64_t> offset) {
    std::error_code error;
    const auto size = std::filesystem::file_size(path, error);
    if (!offset || error || size < static_cast<std::uintmax_t>(*offset)) return path;  // AppendFile says so
    bool ends_in_a_line = false;
    try {
        ends_in_a_line = read_episodes(path, static_cast<std::size_t>(*offset)).cut_line.has_value();
    } catch (const std::runtime_error& damage) {
        throw CutFile(fmt::format("{}; restore it, or start a new run", damage.what()));
    }
    if (ends_in_a_line) {
        throw CutFile(
            fmt::format("{} was changed since the checkpoint was written, whose last line ended at "
                        "byte {}: restore it, or start a new run",
                        path.string(), *offset));
    }
    return path;
}

/// progress.csv as it was when it had `rows` rows: without later ones, and without the columns that came with
/// them, which are the last ones and empty.
std::string first_rows(const std::filesystem::path& path, std::int64_t rows) {
    if (rows == 0) return "";
    if (!std::filesystem::exists(path)) {
        throw CutFile(
            fmt::format("{} is missing, which had {} when the checkpoint was written: restore it, or start a "
                        "new run",
                        path.string(), counted(rows, "row")));
    }
    const std::string text = read_file(path);
    auto lines = whole_lines(text);
    if (std::ssize(lines) < rows + 1 || !lines.front().starts_with(kProgressColumns)) {
        throw CutFile(
            fmt::format("{} does not have the {} rows that it had when the checkpoint was written: it was "
                        "cut or replaced since; restore it, or start a new run",
                        path.string(), rows));
    }
    lines.resize(static_cast<std::size_t>(rows) + 1);
    std::vector<std::vector<std::string>> table;
    std::ptrdiff_t columns = kFixedColumns;
    for (const auto line : lines) {
        auto& cells = table.emplace_back(split(line, ','));
        if (table.size() == 1) continue;  // the header
        const auto last =
            std::find_if(cells.rbegin(), cells.rend(), [](auto& cell) { return !cell.empty(); });
        columns = std::max(columns, cells.rend() - last);
    }
    std::string kept;
    for (auto& cells : table) {
        cells.resize(static_cast<std::size_t>(columns));
        kept += fmt::format("{}\n", fmt::join(cells, ","));
    }
    return kept;
}

AppendFile cut_back(const std::filesystem::path& path, std::int64_t rows) {
    const std::string kept = first_rows(path, rows);
    write_file_atomically(path, kept);
    return AppendFile(path, static_cast<std::int64_t>(kept.size()));
}

}  // namespace

const std::string& game_of(const std::vector<std::string>& games, std::int64_t env) {
    return games.at(static_cast<std::size_t>(env) % games.size());
}

EpisodeLog::EpisodeLog(const std::filesystem::path& path, const EpisodeLogHeader& run,
                       std::optional<std::int64_t> offset)
    : file_(checked_episodes(path, offset), offset), seed_(run.seed), games_(run.games) {
    if (offset) return;
    const nlohmann::ordered_json first_line = {
        {"t_start", 0.0}, {"env_id", run.env_id}, {"agent", run.agent}, {"seed", run.seed}};
    file_.write(fmt::format("#{}\nr,l,t,global_step,frame,seed,env,truncated{}\n", first_line.dump(),
                            games_.empty() ? "" : ",game"));
}

void EpisodeLog::write(const Episode& episode) {
    const double game_time = static_cast<double>(episode.frame) / kFramesPerSecond;
    const auto game = games_.empty() ? std::string() : ',' + game_of(games_, episode.env);
    file_.write(fmt::format("{},{},{:.6f},{},{},{},{},{}{}\n", episode.episode_return, episode.length,
                            game_time, episode.global_step, episode.frame, seed_, episode.env,
                            episode.truncated ? 1 : 0, game));
}

void ProgressLog::require(const std::filesystem::path& path, std::int64_t rows) {
    static_cast<void>(first_rows(path, rows));
}

std::int64_t ProgressLog::rows_to(const std::filesystem::path& path, std::int64_t rows, std::int64_t step) {
    if (!std::filesystem::exists(path)) return rows;
    const std::string text = read_file(path);
    const auto lines = whole_lines(text);
    const auto next = static_cast<std::size_t>(rows) + 1;  // behind the header
    const bool is_there =
        next < lines.size() && number_in<std::int64_t>(split(lines[next], ',').front()) == step;
    return rows + (is_there ? 1 : 0);
}

ProgressLog::ProgressLog(const std::filesystem::path& path, std::optional<std::int64_t> rows)
    : file_(rows ? cut_back(path, *rows) : AppendFile(path)), rows_(rows.value_or(0)) {
    if (rows_ == 0) return;
    const std::string text = read_file(path);
    const auto lines = whole_lines(text);
    names_ = split(lines.front(), ',');
    names_.erase(names_.begin(), names_.begin() + kFixedColumns);
    last_step_ = number_in<std::int64_t>(split(lines.back(), ',').front()).value_or(0);
}

void ProgressLog::write(const Report& report) {
    std::vector<std::string> unseen;
    for (const auto& [name, value] : report.scalars) {
        if (std::ranges::find(names_, name) == names_.end()) unseen.push_back(name);
    }
    if (rows_ == 0 || !unseen.empty()) add_columns(unseen);

    auto row = fmt::format("{},{},{:.3f},{:.2f}", report.global_step, report.frame, report.seconds,
                           report.steps_per_second);
    for (const auto& name : names_) {
        const auto scalar = report.scalars.find(name);
        row += scalar == report.scalars.end() ? "," : fmt::format(",{}", scalar->second);
    }
    file_.write(row + "\n");
    ++rows_;
    last_step_ = report.global_step;
}

void ProgressLog::add_columns(const std::vector<std::string>& unseen) {
    const auto fixed = split(kProgressColumns, ',');
    for (const auto& name : unseen) {
        if (std::ranges::find(fixed, name) != fixed.end())
            throw std::invalid_argument(
                fmt::format("the scalar '{}' cannot name a column: progress.csv has one of that name", name));
        if (name.find_first_of(",\"\n") != name.npos) {
            throw std::invalid_argument(fmt::format(
                "the scalar '{}' cannot name a column: it has a comma, a quote or a line break", name));
        }
    }
    names_.insert(names_.end(), unseen.begin(), unseen.end());

    const std::string old = read_file(file_.path());
    auto rows = whole_lines(old);
    if (!rows.empty()) rows.erase(rows.begin());
    std::string wider =
        fmt::format("{}{}{}\n", kProgressColumns, names_.empty() ? "" : ",", fmt::join(names_, ","));
    for (const auto row : rows) wider.append(row).append(unseen.size(), ',').append("\n");
    write_file_atomically(file_.path(), wider);
    file_ = AppendFile(file_.path(), static_cast<std::int64_t>(wider.size()));
}

std::map<std::string, std::vector<double>> read_progress(const std::filesystem::path& path) {
    const std::string text = read_file(path);
    std::map<std::string, std::vector<double>> columns;
    std::vector<std::string> names;
    for (const auto line : whole_lines(text)) {
        const auto cells = split(line, ',');
        if (names.empty()) {
            names = cells;
            for (auto name = names.begin(); name != names.end(); ++name)
                if (std::find(names.begin(), name, *name) != name)
                    throw std::runtime_error(
                        fmt::format("{}: two columns are called {:.100}", path.string(), *name));
            continue;
        }
        if (cells.size() != names.size())
            throw std::runtime_error(fmt::format("{}: '{:.100}' has {} cells where the header has {}",
                                                 path.string(), line, cells.size(), names.size()));
        for (std::size_t i = 0; i < cells.size(); ++i) {
            char* end = nullptr;
            const double value = cells[i].empty() ? NAN : std::strtod(cells[i].c_str(), &end);
            if (end != nullptr && *end != '\0')
                throw std::runtime_error(fmt::format("{}: {:.100} is '{:.100}', which is no number",
                                                     path.string(), names[i], cells[i]));
            columns[names[i]].push_back(value);
        }
    }
    return columns;
}

}  // namespace cale
