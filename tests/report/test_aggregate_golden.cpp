// The statistics of rliable 1.2.0 (tests/golden/aggregate_statistics.yaml): every agent, metric,
// threshold and pair that a file has.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "report/aggregate.h"
#include "support/golden.h"

namespace cale {
namespace {

// Both sides are Monte Carlo.
constexpr double kOfWidth = 0.02;

std::vector<YAML::Node> statistics_files() {
    std::vector<YAML::Node> files;
    for (const auto& name : golden::files_with({"scores", "point"})) files.push_back(golden::load(name));
    return files;
}

/// The files have scores[run][game].
Scores scores_of(const YAML::Node& file, const std::string& agent) {
    const auto by_run = file["scores"][agent].as<std::vector<std::vector<double>>>();
    Scores scores(by_run.front().size());
    for (const auto& run : by_run)
        for (std::size_t game = 0; game < scores.size(); ++game) scores[game].push_back(run[game]);
    return scores;
}

std::vector<std::string> keys_of(const YAML::Node& map) {
    std::vector<std::string> keys;
    for (const auto& entry : map) keys.push_back(entry.first.as<std::string>());
    return keys;
}

/// `lattice`: by how much an interval's end moves when one more of finitely many values is counted.
void expect_interval(const Estimate& ours, double low, double high, double lattice) {
    const double tolerance = kOfWidth * (high - low) + lattice + 1e-12;
    EXPECT_NEAR(ours.low, low, tolerance);
    EXPECT_NEAR(ours.high, high, tolerance);
}

std::size_t count(const Scores& scores) {
    std::size_t total = 0;
    for (const auto& runs : scores) total += runs.size();
    return total;
}

/// The smallest difference between two scores: what a mean over N of them moves by is no less than its N-th
/// part.
double smallest_gap(const Scores& scores) {
    std::set<double> sorted;
    for (const auto& runs : scores) sorted.insert(runs.begin(), runs.end());
    double gap = sorted.size() > 1 ? *sorted.rbegin() - *sorted.begin() : 0;
    for (auto next = sorted.begin(); next != sorted.end(); ++next)
        if (next != sorted.begin()) gap = std::min(gap, *next - *std::prev(next));
    return gap;
}

/// Of the mean over how many scores the metric is.
double averaged(Metric metric, const Scores& scores) {
    const auto all = static_cast<double>(count(scores));
    if (metric == Metric::iqm) return all - 2 * std::floor(all / 4);
    if (metric == Metric::median) return static_cast<double>(scores.front().size());
    return all;
}

TEST(AggregateGolden, MetricsAndTheirIntervals) {
    int compared = 0;
    for (const auto& file : statistics_files()) {
        for (const auto& agent : keys_of(file["point"])) {
            const auto scores = scores_of(file, agent);
            const auto aggregates = aggregate(scores);
            for (const auto& metric : keys_of(file["point"][agent])) {
                SCOPED_TRACE(agent + " " + metric);
                const auto names = names_of(Metric{});
                const auto at = std::find(names.begin(), names.end(), metric);
                ASSERT_NE(at, names.end());
                const auto& ours = aggregates[static_cast<std::size_t>(at - names.begin())];
                EXPECT_NEAR(ours.value, file["point"][agent][metric].as<double>(), 1e-12);
                const auto theirs = file["interval95"][agent][metric];
                ASSERT_TRUE(theirs);
                expect_interval(
                    ours, theirs[0].as<double>(), theirs[1].as<double>(),
                    smallest_gap(scores) / averaged(static_cast<Metric>(at - names.begin()), scores));
                ++compared;
            }
        }
    }
    EXPECT_GT(compared, 0);
}

TEST(AggregateGolden, PerformanceProfiles) {
    int compared = 0;
    for (const auto& file : statistics_files()) {
        const auto profile = file["performance_profile"];
        if (!profile) continue;
        const auto thresholds = profile["tau"].as<std::vector<double>>();
        for (const auto& agent : keys_of(profile)) {
            if (agent == "tau") continue;
            const auto scores = scores_of(file, agent);
            const auto ours = performance_profile(scores, thresholds);
            for (std::size_t i = 0; i < thresholds.size(); ++i) {
                SCOPED_TRACE(agent + " above " + std::to_string(thresholds[i]));
                EXPECT_NEAR(ours[i].value, profile[agent][i].as<double>(), 1e-12);
                const auto band = file["performance_profile_ci95"][agent];
                expect_interval(ours[i], band[0][i].as<double>(), band[1][i].as<double>(),
                                1.0 / static_cast<double>(count(scores)));
                ++compared;
            }
        }
    }
    EXPECT_GT(compared, 0);
}

TEST(AggregateGolden, ProbabilityOfImprovement) {
    int compared = 0;
    const std::string prefix = "probability_of_improvement_", between = "_over_";
    for (const auto& file : statistics_files()) {
        for (const auto& key : keys_of(file)) {
            if (!key.starts_with(prefix)) continue;
            SCOPED_TRACE(key);
            const auto middle = key.find(between, prefix.size());
            ASSERT_NE(middle, key.npos);
            const auto x = scores_of(file, key.substr(prefix.size(), middle - prefix.size()));
            const auto y = scores_of(file, key.substr(middle + between.size()));
            const auto ours = probability_of_improvement(x, y);
            EXPECT_NEAR(ours.value, file[key]["point"].as<double>(), 1e-12);
            const auto theirs = file[key]["interval95"];
            const auto pairs = x.front().size() * y.front().size() * x.size();
            expect_interval(ours, theirs[0].as<double>(), theirs[1].as<double>(),
                            1.0 / static_cast<double>(pairs));
            ++compared;
        }
    }
    EXPECT_GT(compared, 0);
}

}  // namespace
}  // namespace cale
