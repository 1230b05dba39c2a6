// Whole runs of the Python CALE stack, replayed (tests/golden/README-environment.md).
#include <algorithm>
#include <cmath>
#include <map>

#include <gtest/gtest.h>

#include "cale/env.h"
#include "cale/games.h"
#include "support/golden.h"

namespace {

using cale::ActionSpace;

class Crc32 {
  public:
    void add(std::span<const std::uint8_t> bytes) {
        for (const std::uint8_t byte : bytes) {
            state_ ^= byte;
            for (int bit = 0; bit < 8; ++bit) state_ = (state_ >> 1) ^ (state_ % 2 * 0xEDB88320u);
        }
    }
    std::int64_t value() const { return ~state_; }

  private:
    std::uint32_t state_ = ~0u;
};

std::int64_t crc_of(std::span<const std::uint8_t> bytes) {
    Crc32 crc;
    crc.add(bytes);
    return crc.value();
}

cale::ContinuousAction continuous_action(std::uint64_t seed, std::uint64_t t) {
    const double theta = -M_PI + 2 * M_PI * golden::uniform(seed, 3 * t + 1);
    return {static_cast<float>(golden::uniform(seed, 3 * t)), static_cast<float>(theta),
            static_cast<float>(golden::uniform(seed, 3 * t + 2))};
}

cale::EnvConfig config_of(const YAML::Node& run) {
    static const std::map<std::string, ActionSpace> kSpaces{{"continuous", ActionSpace::continuous},
                                                            {"minimal", ActionSpace::minimal},
                                                            {"full", ActionSpace::full}};
    cale::EnvConfig config;
    config.game = run["game"].as<std::string>();
    config.action_space = kSpaces.at(run["actions"].as<std::string>());
    if (!run["tau"].IsNull()) config.threshold = run["tau"].as<double>();
    config.paddle_strength = cale::PaddleStrength::radius;
    config.sticky_probability = run["sticky"].as<double>();
    config.terminal_on_life_loss = run["life_loss"].as<bool>();
    config.max_frames_per_episode = 1'000'000'000;
    return config;
}

using Rows = std::vector<std::vector<std::int64_t>>;

void replay(const YAML::Node& run) {
    cale::Env env(config_of(run), run["ale_seed"].as<std::uint32_t>());
    EXPECT_EQ(env.screen_height(), run["screen"][0].as<int>());
    EXPECT_EQ(env.screen_width(), run["screen"][1].as<int>());
    EXPECT_EQ(env.actions().size(), run["n_actions"].as<std::size_t>());

    std::vector<std::uint8_t> frame(cale::kFrameSize);
    env.reset(frame);
    EXPECT_EQ(crc_of(frame), run["reset"]["crc"].as<std::int64_t>());
    EXPECT_EQ(env.lives(), run["reset"]["lives"].as<int>());

    const auto seed = run["action_seed"].as<std::uint64_t>();
    const auto steps = run["steps"].as<std::int64_t>();
    const bool reset_on_terminal = run["reset_on"].as<std::string>() == "terminal";
    const auto first_count = run["first"].size();
    Rows first;
    Rows ends;
    Rows blocks;
    std::int64_t total_reward = 0;
    std::int64_t terminals = 0;
    Crc32 block;
    for (std::int64_t t = 0; t < steps; ++t) {
        const auto index = static_cast<std::uint64_t>(t);
        cale::StepResult result;
        if (env.actions().empty()) {
            result = env.step(continuous_action(seed, index), frame);
        } else {
            const auto count = static_cast<double>(env.actions().size());
            result = env.step(static_cast<std::int64_t>(golden::uniform(seed, index) * count), frame);
        }
        const std::int64_t crc = crc_of(frame);
        const auto reward = static_cast<std::int64_t>(result.reward);
        if (first.size() < first_count) first.push_back({t, static_cast<int>(result.event), reward, crc});
        block.add(frame);
        total_reward += reward;

        EXPECT_FALSE(result.truncated);
        if (result.terminal) {
            ++terminals;
            std::int64_t reset_crc = -1;
            if (result.episode_over || reset_on_terminal) {
                env.reset(frame);
                reset_crc = crc_of(frame);
            }
            ends.push_back({t, result.episode_over, result.frames, reset_crc});
        }
        if ((t + 1) % 100 == 0) {
            blocks.push_back({t + 1, total_reward, terminals, env.lives(), std::exchange(block, {}).value()});
        }
    }
    EXPECT_EQ(first, run["first"].as<Rows>());
    EXPECT_EQ(ends, run["ends"].as<Rows>());
    EXPECT_EQ(blocks, run["blocks"].as<Rows>());
    EXPECT_EQ(crc_of(env.ram()), run["final"]["ram_crc"].as<std::int64_t>());
    EXPECT_EQ(env.frame_number(), run["final"]["frame"].as<std::int64_t>());
}

TEST(GoldenEnvironment, EveryRunOfTheReference) {
    const auto cases = golden::load("environment.yaml")["cases"];
    ASSERT_GT(cases.size(), 0u);
    for (const auto& run : cases) {
        SCOPED_TRACE(run["name"].as<std::string>());
        replay(run);
    }
}

}  // namespace
