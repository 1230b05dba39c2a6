// Tables of comma-separated values: those that runs write, and those that a report writes.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cale {

/// A file's header and rows. A cell may be quoted, but holds no line break.
struct CsvTable {
    std::filesystem::path path{};
    std::string comment{};  // the line before the header that starts with '#', without it
    std::vector<std::string> columns{};
    std::vector<std::vector<std::string>> rows{};  // each as long as `columns`
    std::vector<std::size_t> lines{};              // of the file, by row, from 1
    std::optional<std::size_t> cut_line{};         // in whose middle the file ends; it is no row

    std::optional<std::size_t> find(std::string_view column) const;
    /// Throws std::runtime_error that names the file and the line where the cell is no finite number.
    double number(std::size_t row, std::size_t column) const;
    /// The same for a game's score, which must not exceed kHighestScore in size either.
    double score(std::size_t row, std::size_t column) const;
};

/// No score of the sixty games is as large as this: larger numbers indicate a damaged file, and their sums
/// could overflow.
inline constexpr double kHighestScore = 1e12;

/// An incomplete last line, as left by a killed run or a truncated copy, is no row: see CsvTable::cut_line.
/// Throws std::runtime_error, naming the file, where it cannot be read or has no header, and the line where a
/// row is longer or shorter.
CsvTable read_csv(const std::filesystem::path& path);

/// read_csv() for a file that is written at once. Throws std::runtime_error where it ends within a line, too.
CsvTable read_whole_csv(const std::filesystem::path& path);

/// read_csv() for a table that a person wrote: its last line may lack its end, and empty lines are passed
/// over.
CsvTable read_csv_by_hand(const std::filesystem::path& path);

/// A line of a table: cells with a comma, a quote or a line break are quoted.
std::string csv_line(const std::vector<std::string>& cells);

}  // namespace cale
