#include "report/aggregate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <vector>

namespace cale {
namespace {

using ::testing::DoubleNear;
using ::testing::Each;
using ::testing::Field;

const Estimate& metric(const Aggregates& aggregates, Metric which) {
    return aggregates[static_cast<std::size_t>(which)];
}

const Bootstrap kQuick{.resamples = 4'000};

TEST(Aggregate, CheckedByHand) {
    // Sorted: -1 0 0.5 1 2 3 4 10; the middle half is 0.5 1 2 3.
    const Scores scores{{0, 2, 10, 4}, {1, -1}, {0.5, 3}};
    const auto result = aggregate(scores, kQuick);
    EXPECT_DOUBLE_EQ(metric(result, Metric::iqm).value, 6.5 / 4);
    EXPECT_DOUBLE_EQ(metric(result, Metric::median).value, 1.75) << "of the games' means 4, 0, 1.75";
    EXPECT_DOUBLE_EQ(metric(result, Metric::mean).value, (4 + 0 + 1.75) / 3);
    EXPECT_DOUBLE_EQ(metric(result, Metric::optimality_gap).value, (2 + 1 + 0.5) / 8);
}

TEST(Aggregate, MedianOfAnEvenNumberOfGamesIsBetweenTheMiddleTwo) {
    const auto result = aggregate({{0}, {10}, {4}, {1}}, kQuick);
    EXPECT_DOUBLE_EQ(metric(result, Metric::median).value, 2.5);
}

TEST(Aggregate, IntervalsOfAMeanAreThoseOfTheBinomial) {
    // Of twenty runs ten score 1: a resample's mean is a binomial part of twenty.
    std::vector<double> runs(20, 0.0);
    std::fill_n(runs.begin(), 10, 1.0);
    const auto mean = mean_of_runs(runs, {.resamples = 50'000});
    EXPECT_DOUBLE_EQ(mean.value, 0.5);
    // P(X <= 5) = 0.0207, P(X <= 6) = 0.0577
    EXPECT_DOUBLE_EQ(mean.low, 0.3);
    EXPECT_DOUBLE_EQ(mean.high, 0.7);
    const auto narrower = mean_of_runs(runs, {.resamples = 50'000, .confidence = 0.6});
    EXPECT_DOUBLE_EQ(narrower.low, 0.4);
    EXPECT_DOUBLE_EQ(narrower.high, 0.6);
}

TEST(Aggregate, ResamplesRunsWithinTheirGamesOnly) {
    // Every run of a game is the same: nothing varies, though the games do.
    const auto result = aggregate({{0, 0, 0}, {5, 5, 5}, {9, 9, 9}}, kQuick);
    for (const auto& estimate : result) {
        EXPECT_DOUBLE_EQ(estimate.low, estimate.value);
        EXPECT_DOUBLE_EQ(estimate.high, estimate.value);
    }
}

TEST(Aggregate, TheNumberOfThreadsChangesNothing) {
    const Scores scores{{0.11, 0.73, 0.42, 0.05, 0.97}, {2.03, 1.57, 0.31, 0.88, 1.91}, {0.93, 0.81}};
    const auto one = aggregate(scores, {.resamples = 20'000, .threads = 1});
    const auto five = aggregate(scores, {.resamples = 20'000, .threads = 5});
    const auto other_seed = aggregate(scores, {.resamples = 20'000, .seed = 1});
    for (std::size_t i = 0; i < kMetricCount; ++i) {
        EXPECT_EQ(one[i].low, five[i].low);
        EXPECT_EQ(one[i].high, five[i].high);
    }
    EXPECT_NE(metric(one, Metric::mean).low, metric(other_seed, Metric::mean).low);
}

TEST(Aggregate, ProfileCountsWhatIsAbove) {
    const auto profile = performance_profile({{0, 1}, {1, 3}}, {-1, 0, 0.5, 1, 3}, kQuick);
    const std::vector<double> expected{1, 0.75, 0.75, 0.25, 0};
    ASSERT_EQ(profile.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_DOUBLE_EQ(profile[i].value, expected[i]);
    EXPECT_DOUBLE_EQ(profile[2].low, 0.5) << "the first game's 0 drawn twice";
    EXPECT_DOUBLE_EQ(profile[2].high, 1);
}

TEST(Aggregate, ImprovementCountsTiesByHalf) {
    const auto of_two_games = probability_of_improvement({{1, 2}, {0}}, {{1, 0, 3}, {5}}, kQuick);
    // 1 beats 0, ties with 1; 2 beats 1 and 0: 3.5 of 6. On the second game none.
    EXPECT_DOUBLE_EQ(of_two_games.value, 3.5 / 12);
    EXPECT_LT(of_two_games.low, of_two_games.value);
    EXPECT_GT(of_two_games.high, of_two_games.value);
    const Scores same{{1, 2, 2}, {4, 4}};
    EXPECT_DOUBLE_EQ(probability_of_improvement(same, same, kQuick).value, 0.5);
}

TEST(Aggregate, ImprovementResamplesBothSides) {
    const auto one_sided = probability_of_improvement({{1}}, {{0, 2}}, kQuick);
    EXPECT_DOUBLE_EQ(one_sided.low, 0);
    EXPECT_DOUBLE_EQ(one_sided.high, 1);
    const auto other_sided = probability_of_improvement({{0, 2}}, {{1}}, kQuick);
    EXPECT_DOUBLE_EQ(other_sided.low, 0);
    EXPECT_DOUBLE_EQ(other_sided.high, 1);
}

TEST(Aggregate, NormalisesByRandomAndHuman) {
    const auto& pong = find_game("pong");
    EXPECT_DOUBLE_EQ(human_normalised(*pong.random_score, pong), 0);
    EXPECT_DOUBLE_EQ(human_normalised(*pong.human_score, pong), 1);
    EXPECT_THROW(human_normalised(100, find_game("air_raid")), std::invalid_argument);
}

TEST(Aggregate, RefusesWhatHasNoStatistic) {
    EXPECT_THROW(aggregate({}), std::invalid_argument);
    EXPECT_THROW(aggregate({{1}, {}}), std::invalid_argument);
    EXPECT_THROW(aggregate({{1, NAN}}), std::invalid_argument);
    EXPECT_THROW(aggregate({{1}}, {.resamples = 0}), std::invalid_argument);
    EXPECT_THROW(aggregate({{1}}, {.confidence = 1}), std::invalid_argument);
    EXPECT_THROW(performance_profile({{1}}, {1, 0}), std::invalid_argument);
    EXPECT_THROW(probability_of_improvement({{1}}, {{1}, {2}}), std::invalid_argument);
}

}  // namespace
}  // namespace cale
