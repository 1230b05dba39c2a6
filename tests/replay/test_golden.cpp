// The dopamine rule against every transition that the reference's replay holds, and
// prioritised sampling against its sum tree.
#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <numeric>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "numbered_frames.h"
#include "replay/sum_tree.h"
#include "support/golden.h"

namespace cale {
namespace {

struct Expected {
    NumberedTransition transition;
    std::uint32_t added_at = 0;
};

std::vector<Expected> expected_transitions(const YAML::Node& rows, double gamma, std::int64_t horizon) {
    std::vector<Expected> expected;
    for (const auto& row : rows) {
        const double discount = row["terminal"].as<int>() != 0 ? 0.0 : std::pow(gamma, horizon);
        expected.push_back({{row["state"].as<std::vector<std::uint32_t>>(), row["action"].as<std::int64_t>(),
                             row["return"].as<float>(), static_cast<float>(discount),
                             row["next_state"].as<std::vector<std::uint32_t>>()},
                            row["added_at"].as<std::uint32_t>()});
    }
    return expected;
}

TEST(ReplayGolden, DopamineRule) {
    int cases = 0;
    for (const auto& name : golden::files_of_kind("replay")) {
        const YAML::Node file = golden::load(name);
        for (const auto& entry : file) {
            const auto key = entry.first.as<std::string>();
            if (key.size() < 2 || key[0] != 'n' || std::isdigit(static_cast<unsigned char>(key[1])) == 0)
                continue;
            SCOPED_TRACE(name + ", " + key);
            ReplayConfig config = numbered_config();
            config.update_horizon = std::stoll(key.substr(1));
            config.gamma = file["gamma"].as<double>();
            config.observation.stack = file["stack"].as<std::int64_t>();
            config.replay_terminal = ReplayTerminal::dopamine;
            config.capacity = static_cast<std::int64_t>(entry.second.size() + file["script"].size());
            ReplayBuffer replay(config);
            std::vector<std::uint32_t> added_at;
            for (const auto& row : file["script"]) {
                NumberedStep step;
                step.frame = row[0].as<std::uint32_t>();
                step.action = row[1].as<std::int64_t>();
                step.reward = row[2].as<float>();
                step.terminal = row[3].as<int>() != 0;
                step.truncated = !step.terminal && row[4].as<int>() != 0;
                add(replay, step);
                added_at.resize(static_cast<std::size_t>(replay.size()), step.frame);
            }

            const auto expected = expected_transitions(entry.second, config.gamma, config.update_horizon);
            const auto found = read_all(replay);
            ASSERT_EQ(found.size(), expected.size());
            for (std::size_t i = 0; i < found.size(); ++i) {
                SCOPED_TRACE(i);
                auto rounded = found[i];
                const float tolerance =
                    1e-6f * std::max(1.0f, std::abs(expected[i].transition.n_step_return));
                EXPECT_NEAR(found[i].n_step_return, expected[i].transition.n_step_return, tolerance);
                rounded.n_step_return = expected[i].transition.n_step_return;
                EXPECT_EQ(rounded, expected[i].transition);
                EXPECT_EQ(added_at[i], expected[i].added_at);
            }
            ++cases;
        }
    }
    EXPECT_GT(cases, 0) << "no golden replay in " << golden::directory();
}

// This section of every file that has it.
std::vector<YAML::Node> golden_sections(const std::string& name) {
    std::vector<YAML::Node> sections;
    for (const auto& file : golden::files_of_kind("schedules"))
        if (const YAML::Node section = golden::load(file)[name]) sections.push_back(section);
    EXPECT_FALSE(sections.empty()) << "no golden " << name << " in " << golden::directory();
    return sections;
}

std::vector<double> numbers(const YAML::Node& node) {
    return node.as<std::vector<double>>();
}

void expect_close(double found, double expected) {
    EXPECT_NEAR(found, expected, 1e-6 * std::abs(expected));
}

SumTree tree_of(const std::vector<double>& values, std::int64_t capacity) {
    SumTree tree(capacity);
    for (std::size_t i = 0; i < values.size(); ++i) tree.set(static_cast<std::int64_t>(i), values[i]);
    return tree;
}

void expect_finds(const SumTree& tree, const YAML::Node& targets, const YAML::Node& index) {
    ASSERT_EQ(targets.size(), index.size());
    for (std::size_t i = 0; i < targets.size(); ++i)
        EXPECT_EQ(tree.find(targets[i].as<double>()), index[i].as<std::int64_t>()) << targets[i];
}

// By index: of a key get2 the value of index 2.
std::map<std::int64_t, double> values_after(const YAML::Node& update) {
    std::map<std::int64_t, double> values;
    for (const auto& entry : update) {
        const auto key = entry.first.as<std::string>();
        if (key.starts_with("get")) values[std::stoll(key.substr(3))] = entry.second.as<double>();
    }
    EXPECT_FALSE(values.empty());
    return values;
}

// One transition for each of these priorities, and room for another.
ReplayBuffer replay_of(const std::vector<double>& priorities) {
    const auto size = static_cast<std::int64_t>(priorities.size());
    ReplayBuffer replay = filled(size + 1, size + 1, true);
    std::vector<std::int64_t> index(priorities.size());
    std::iota(index.begin(), index.end(), 0);
    give(replay, index, priorities);
    return replay;
}

// The next transition enters with this priority, among others of which the sum is `root`.
void expect_largest_priority(ReplayBuffer& replay, double largest, double root) {
    add(replay, {.frame = 1'000'000});
    expect_close(probabilities(replay).back(), largest / (root + largest));
}

TEST(SumTreeGolden, FindsWhatTheReferenceFinds) {
    for (const auto& section : golden_sections("sum_tree")) {
        const SumTree tree = tree_of(numbers(section["set"]), section["capacity"].as<std::int64_t>());
        expect_close(tree.total(), section["root"].as<double>());
        expect_finds(tree, section["targets"], section["index"]);
    }
}

TEST(SumTreeGolden, ReplayUpdatesPrioritiesAsTheReference) {
    for (const auto& section : golden_sections("sum_tree")) {
        const auto set = numbers(section["set"]);
        ReplayBuffer untouched = replay_of(set);
        expect_largest_priority(untouched, section["max_recorded_priority"].as<double>(),
                                section["root"].as<double>());

        const YAML::Node update = section["update"];
        const auto index = update["index"].as<std::vector<std::int64_t>>();
        const auto root = update["root_after"].as<double>();
        // A replay has a priority where it has a transition, and probabilities where one is above 0.
        if (root == 0 || std::ranges::max(index) >= std::ssize(set)) continue;
        ReplayBuffer replay = replay_of(set);
        give(replay, index, numbers(update["value"]));
        const auto found = probabilities(replay);
        for (const auto& [leaf, expected] : values_after(update))
            expect_close(found.at(static_cast<std::size_t>(leaf)), expected / root);
        expect_largest_priority(replay, update["max_recorded_priority"].as<double>(), root);
    }
}

TEST(PrioritisedReplayGolden, DrawsWhatTheReferenceDrawsWithItsProbability) {
    for (const auto& section : golden_sections("prioritized")) {
        const auto priority = numbers(section["priority"]);
        expect_finds(tree_of(priority, static_cast<std::int64_t>(priority.size())), section["targets"],
                     section["index"]);

        const auto index = section["index"].as<std::vector<std::int64_t>>();
        const auto expected = numbers(section["probability"]);
        const Batch batch = replay_of(priority).gather(index);
        ASSERT_EQ(index.size(), expected.size());
        for (std::size_t i = 0; i < expected.size(); ++i) {
            const auto row = static_cast<std::int64_t>(i);
            EXPECT_EQ(batch.index[row].item<std::int64_t>(), index[i]);
            expect_close(batch.probability[row].item<float>(), expected[i]);
        }
    }
}

}  // namespace
}  // namespace cale
