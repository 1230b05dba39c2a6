// The tables of a report: for readers, and as CSV for other programs.
#pragma once

#include <array>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "report/comparison.h"

namespace cale {

/// Cells as they are shown.
struct Table {
    std::size_t name_columns = 1;  // the first hold names, the others values
    std::vector<std::string> header{};
    std::vector<std::vector<std::string>> rows{};
    std::vector<std::vector<bool>> best{};  // by row and column: shown bold; empty: none

    bool is_bold(std::size_t row, std::size_t column) const { return !best.empty() && best[row][column]; }
};

/// A row per group and baseline: IQM, median, mean and optimality gap with their intervals, games, runs.
Table aggregate_table(const Comparison& comparison);
/// A row per pair of groups: the probability that the first scores more.
Table improvement_table(const Comparison& comparison);
/// A row per game: the published random and human score that it is normalised with, what random play scores
/// on the runs' joystick, what each group scored, and each baseline. The highest mean of the groups is bold,
/// unless all share it.
Table game_table(const Comparison& comparison);
/// Returns what the literature has to compare with.
std::vector<Baseline> published(const Comparison& comparison);
/// A row per group: agent, protocol, action space, agent steps, games, seeds, runs.
Table setup_table(const Comparison& comparison);
/// A row per setting in which groups differ, a column per group.
Table setting_table(const Comparison& comparison);
/// A row per setting that all groups share, and its value.
Table shared_setting_table(const Comparison& comparison);

/// "5 runs per game", "2-5 runs per game", of the numbers of runs in the games.
std::string runs_text(const std::set<std::size_t>& counts);
/// The same of the games that are compared.
std::string runs_text(const Comparison& comparison);
/// The same of all games, also those that are not compared.
std::string runs_text_of_all_games(const Comparison& comparison);

/// The table in columns of text for a terminal.
std::string to_text(const Table& table);

/// As a tabular of LaTeX, for the package booktabs.
std::string to_latex(const Table& table);

/// As a table of Markdown.
std::string to_markdown(const Table& table);

struct TextFile {
    std::string name{};  // "aggregates.csv"
    std::string text{};
};

/// With all digits: scores (a row per run), run_curves (see recorded_runs.h), setup, settings (all of them),
/// and one by the name of each figure: aggregates, sample_efficiency, performance_profiles,
/// probability_of_improvement, game_curves, game_scores, events, zones, rewards; those that the comparison
/// has nothing for are left out. Where there is no interval, its cells are empty.
std::vector<TextFile> csv_files(const Comparison& comparison);

/// The figures that have a table, too.
inline constexpr std::array<std::string_view, 3> kFiguresWithTable{"aggregates", "probability_of_improvement",
                                                                   "game_scores"};

/// The tables for a paper (.tex) and for a page (.md): setup, settings, and those of kFiguresWithTable.
std::vector<TextFile> table_files(const Comparison& comparison);

}  // namespace cale
