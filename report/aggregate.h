// Statistics of many runs on many games, as Agarwal et al. 2021, "Deep Reinforcement Learning at the
// Edge of the Statistical Precipice", define them and their library rliable computes them.
//
// Every interval is a percentile interval of a stratified bootstrap: a resample draws, game by game,
// as many of the game's runs as there are, with replacement; the games stay as they are. The draws of
// resample r follow from (seed, r) alone, so an interval does not depend on the number of threads.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "cale/games.h"

namespace cale {

/// A score for each run of each game: scores[game][run]. Games may have different numbers of runs;
/// where scores are pooled (IQM, optimality gap, profiles), a game then counts by its runs.
using Scores = std::vector<std::vector<double>>;

/// How intervals are computed: as percentiles of the resamples' statistics.
struct Bootstrap {
    std::int64_t resamples = 50'000;
    double confidence = 0.95;
    std::uint64_t seed = 0;
    int threads = 0;  // 0: as many as there are cores
};

/// A statistic of the runs as they are, and the interval that the bootstrap gives it.
struct Estimate {
    double value = 0;
    double low = 0;
    double high = 0;
};

enum class Metric { iqm, median, mean, optimality_gap };
inline constexpr std::size_t kMetricCount = 4;
std::span<const std::string_view> names_of(Metric);  // "iqm", "median", "mean", "optimality_gap"

/// By Metric. IQM: the mean of the middle half of all scores, floor(N/4) cut from either end. Median
/// and mean: of the games' means. Optimality gap: by how much scores miss 1, those above not counted.
using Aggregates = std::array<Estimate, kMetricCount>;

/// Whether two numbers, low <= high, are alike but for their last digits, as means of equal numbers may be.
bool nearly_equal(double low, double high);

/// (score - random) / (human - random): 0 plays like the random agent, 1 like the human.
/// Throws std::invalid_argument for the games that have no human score.
double human_normalised(double score, const Game& game);

// All functions below throw std::invalid_argument where a game has no run, a score is not finite, there is no
// game, no resample is asked for, or the confidence is not between 0 and 1.

/// Returns all four statistics, each with its interval.
Aggregates aggregate(const Scores& scores, const Bootstrap& bootstrap = {});

/// The mean over the runs of one game.
Estimate mean_of_runs(const std::vector<double>& runs, const Bootstrap& bootstrap = {});

/// For each of the ascending `thresholds`: the part of all runs whose score is greater. Throws
/// std::invalid_argument where they do not ascend.
std::vector<Estimate> performance_profile(const Scores& scores, const std::vector<double>& thresholds,
                                          const Bootstrap& bootstrap = {});

/// The probability that a run of x scores more than a run of y on the same game, ties by half (the
/// Mann-Whitney statistic), averaged over the games. Runs of x and y are resampled independently.
/// Throws std::invalid_argument if x and y do not have the same number of games.
Estimate probability_of_improvement(const Scores& x, const Scores& y, const Bootstrap& bootstrap = {});

}  // namespace cale
