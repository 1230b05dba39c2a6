// The tables of a report: for readers, and as CSV for other programs.
#pragma once

#include <string>
#include <vector>

#include "report/comparison.h"

namespace cale {

/// Cells as they are shown.
struct Table {
    std::size_t name_columns = 1;  // the first hold names, the others values
    std::vector<std::string> header{};
    std::vector<std::vector<std::string>> rows{};
    std::vector<std::vector<bool>> best{};  // by row and column: shown bold; empty: none
};

/// A row per group and baseline: IQM, median, mean and optimality gap with their intervals, games, runs.
Table aggregate_table(const Comparison& comparison);
/// A row per pair of groups: the probability that the first scores more.
Table improvement_table(const Comparison& comparison);
/// A row per game: its random and human score, what each group scored, and each baseline. The best of
/// the groups is bold.
Table game_table(const Comparison& comparison);
/// A row per setting in which groups differ, a column per group.
Table setting_table(const Comparison& comparison);

/// "5 runs per game", "2-5 runs per game"
std::string runs_text(const Comparison& comparison);

/// The table in columns of text for a terminal.
std::string to_text(const Table& table);

struct CsvFile {
    std::string name{};  // "aggregates.csv"
    std::string text{};
};

/// With all digits: scores (a row per run), aggregates, performance_profiles,
/// probability_of_improvement, sample_efficiency, game_scores, game_curves, events, reward_quantiles;
/// those that the comparison has nothing for are left out.
std::vector<CsvFile> csv_files(const Comparison& comparison);

}  // namespace cale
