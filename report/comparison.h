// Computes the contents of a report: groups of runs compared with each other, and with the literature.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "report/aggregate.h"
#include "report/baselines.h"
#include "report/groups.h"
#include "report/runs.h"

namespace cale {

/// A value that changes with the agent steps.
struct Curve {
    std::vector<double> steps{};
    std::vector<Estimate> values{};
};

/// The results of a group on one game.
struct GameResult {
    const Game* game = nullptr;
    std::vector<const Run*> runs{};                  // by seed
    Estimate mean{};                                 // of the runs' scores, as the game counts them
    Curve curve{};                                   // the same
    std::vector<double> event_shares{};              // by Event, the mean of the runs'; empty if none has any
    std::vector<RewardQuantile> reward_quantiles{};  // the mean of the runs'; empty if none has any
    std::vector<ZoneRow> zones{};                    // the mean of the runs, over equal parts of the longest

    bool has_interval() const { return runs.size() > 1; }
};

/// What a group of runs scored, over all games and in each.
struct GroupResult {
    std::string label{};
    std::vector<GameResult> games{};  // by name, also those that are not compared
    std::size_t least_runs = 0;       // of a compared game; of any where none is
    std::size_t most_runs = 0;
    // Over the compared games, human-normalised; without meaning where there are none.
    Scores scores{};
    Aggregates aggregates{};
    std::vector<Estimate> profile{};  // by Comparison::thresholds
    std::vector<double> curve_steps{};
    std::vector<Aggregates> curve{};  // by curve_steps

    /// One run per game gives no estimate of the variation between runs.
    bool has_interval() const { return least_runs > 1; }
    /// The result in the game of that name; none where the group has no run of it.
    const GameResult* find(std::string_view game) const;
};

/// The same of published scores.
struct BaselineResult {
    Baseline baseline{};
    Aggregates aggregates{};  // of the games' means: no interval, and another IQM than that of runs
};

/// The probability that a run of group `x` scores more than one of group `y`.
struct Improvement {
    std::size_t x = 0;
    std::size_t y = 0;
    Estimate probability{};
    bool has_interval = false;  // both have several runs in every game
};

/// A caveat that a reader must know to interpret a figure.
struct Note {
    std::string text{};                // a sentence; with items it ends with a colon
    std::vector<std::string> items{};  // what it is about
};

/// What is compared, and how.
struct ComparisonConfig {
    ScoreKind score = ScoreKind::training;
    Bootstrap bootstrap{};
    std::vector<std::string> group_by{};
    /// Of groups, by their labels (rename_groups), and of baselines, by theirs, where no group has that one.
    std::map<std::string, std::string> names{};

    /// For the bands of curves and profiles: 2,000 resamples at most, as rliable's have.
    Bootstrap for_bands() const {
        auto bands = bootstrap;
        bands.resamples = std::min<std::int64_t>(bands.resamples, 2'000);
        return bands;
    }
};

/// All numbers of a report.
struct Comparison {
    ComparisonConfig config{};
    std::vector<Group> groups{};         // holds the runs that `results` points to
    std::vector<GroupResult> results{};  // by group
    std::vector<BaselineResult> baselines{};
    // What random play scores under the rules of the runs: "random joystick (200m)" as measured for those of
    // the continuous joystick, "random (published)" for the others; on the games of those runs.
    std::vector<Baseline> random_floors{};
    // Compared: those with a human score, in their usual variant, that every group has played.
    std::vector<const Game*> games{};
    std::vector<double> thresholds{};  // of the profiles
    // Every pair of groups once; of two recorded ones only where all are recorded.
    std::vector<Improvement> improvements{};
    std::vector<LeftOut> left_out_games{};
    std::vector<LeftOut> left_out_runs{};
    std::vector<LeftOut> repeated_runs{};
    std::vector<LeftOut> left_out_baselines{};  // recorded groups among them
    std::vector<std::string> missing_runs{};    // that sweeps list, and of the grid that the others are
    std::vector<Note> notes{};                  // with all that is missing or left out

    /// Whether every run of the grid exists, is usable and is finished.
    bool is_complete() const;

    // Whether there are several runs, and so an interval to show: of a game, of the aggregates of a group,
    // and of the probability that one of a pair scores more.
    bool has_interval_of_a_game() const;
    bool has_interval_of_aggregates() const {
        return std::ranges::any_of(results, &GroupResult::has_interval);
    }
    bool has_interval_of_a_pair() const {
        return std::ranges::any_of(improvements, &Improvement::has_interval);
    }

    Comparison() = default;
    // Not copied: `results` point into `groups`.
    Comparison(Comparison&&) = default;
    Comparison& operator=(Comparison&&) = default;
};

/// The name of the floor of runs with discrete or factored actions, whose scores are Game::random_score.
inline constexpr std::string_view kPublishedRandom = "random (published)";

/// The groups' labels, in order.
std::vector<std::string> labels_of(const Comparison& comparison);

/// Throws std::runtime_error where there is no run that can be used, with the reason.
void require_runs(const FoundRuns& found);

/// Throws std::runtime_error where there is no run to report on, what group_runs() and rename_groups() throw,
/// and std::invalid_argument where a baseline is called like a group.
Comparison compare(FoundRuns found, std::vector<Baseline> baselines = {},
                   const ComparisonConfig& config = {});

}  // namespace cale
