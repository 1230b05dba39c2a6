// The figures of a report, one for each type of figure in the CALE paper.
//
// Every picture states its number of runs; one that aggregates over games theirs, too; one with intervals how
// they were computed.
#pragma once

#include <string>
#include <vector>

#include "report/comparison.h"
#include "report/picture.h"

namespace cale {

/// The four aggregate metrics of every group, side by side, with intervals; baselines as diamonds.
Picture aggregate_figure(const Comparison& comparison);
/// The part of runs above a human-normalised score, with pointwise bands.
Picture profile_figure(const Comparison& comparison);
/// A row per pair of groups, the first 100.
Picture improvement_figure(const Comparison& comparison);
/// IQM over agent steps, with bands; baselines as horizontal lines.
Picture efficiency_figure(const Comparison& comparison);
/// A panel per game: the mean over the runs of the game's own score over agent steps, with bands.
Picture game_curves_figure(const Comparison& comparison);
/// How often each joystick event was chosen: a panel per game for up to four games, else the mean over the
/// games of which every group with events has some.
Picture event_figure(const Comparison& comparison);

/// A figure of a report.
struct Figure {
    std::string name{};     // of its files: "aggregates"
    std::string title{};    // of its section in the page
    std::string caption{};  // how to read it
    Picture picture{};
};

/// Returns the figures that the comparison has data for, in reading order.
std::vector<Figure> figures(const Comparison& comparison);
/// The last of them: those that show games one by one.
std::vector<Figure> game_figures(const Comparison& comparison);

}  // namespace cale
