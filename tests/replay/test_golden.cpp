// The dopamine rule against every transition that the reference's replay holds.
#include <cctype>
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "numbered_frames.h"
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
            config.stack = file["stack"].as<std::int64_t>();
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

}  // namespace
}  // namespace cale
