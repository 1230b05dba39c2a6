// Tables of comma-separated values: those that runs write, and those that a report writes.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cale {

/// No game counts further: a higher score indicates a damaged file, and sums of such could overflow.
inline constexpr double kHighestScore = 1e12;

/// A file's header and rows. A cell may be quoted, but holds no line break.
struct CsvTable {
    std::filesystem::path path{};
    std::string comment{};  // the line before the header that starts with '#', without it
    std::vector<std::string> columns{};
    std::vector<std::vector<std::string>> rows{};  // each as long as `columns`
    std::vector<std::size_t> lines{};              // of the file, by row, from 1
    std::optional<std::size_t> cut_line{};         // in whose middle the file ends; no row, but for
                                                   // read_csv_by_hand()

    std::optional<std::size_t> find(std::string_view column) const;
    /// Throws std::runtime_error that names the file and the line where the cell is no finite number.
    double number(std::size_t row, std::size_t column) const;
    /// The same for a game's score, up to kHighestScore either way.
    double score(std::size_t row, std::size_t column) const;
};

/// An incomplete last line, as left by a killed run or a truncated copy, is no row: see CsvTable::cut_line.
/// Throws std::runtime_error, naming the file, where it cannot be read or has no header, and the line where a
/// row is longer or shorter. `bytes`: as if the file ended there.
CsvTable read_csv(const std::filesystem::path& path, std::size_t bytes = std::string::npos);

/// read_csv() for a file that is written at once. Throws std::runtime_error where it ends within a line, too.
CsvTable read_whole_csv(const std::filesystem::path& path);

/// read_csv() for a table that a person wrote: empty lines, those that start with '#', and blanks around a
/// cell are passed over, and a last line without its end is both a row and the cut_line.
CsvTable read_csv_by_hand(const std::filesystem::path& path);

/// Throws std::runtime_error for a table whose file ends within a line.
void require_whole(const CsvTable& table);

/// A line of a table: cells with a comma, a quote or a line break, or that start with '#', are quoted.
std::string csv_line(const std::vector<std::string>& cells);

}  // namespace cale
