// The joystick in an observation of the memory.
#include "cale/joystick_log.h"

#include <array>
#include <cstdint>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/env.h"
#include "cale/joystick.h"
#include "message_of.h"
#include "support/golden.h"

namespace {

using cale::ContinuousAction;
using cale::Env;
using cale::EnvConfig;
using cale::Event;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr float kPi = std::numbers::pi_v<float>;

EnvConfig memory_of(const char* game) {
    auto config = cale::protocol_atari100k(game);
    config.obs = cale::Obs::ram;
    config.observe_joystick = true;
    return config;
}

/// The joystick's bytes of an observation.
std::vector<int> joystick_of(const std::vector<std::uint8_t>& observation) {
    return {observation.begin() + cale::kRamSize, observation.end()};
}

TEST(JoystickLog, HasWhatWasToldWhereTheStickIsAndTheEventsOfTheFrames) {
    const std::array<std::uint8_t, 3> events = {std::uint8_t(Event::noop), std::uint8_t(Event::up_left_fire),
                                                std::uint8_t(Event::down)};
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(cale::joystick_log_size(4)));
    cale::write_joystick_log(
        {.command = {1, kPi, 0.5F}, .position = {.x = 0.2, .y = -1, .button = 0.25}, .events = events},
        bytes);
    EXPECT_THAT(bytes, ElementsAre(1, 128, 128,    // LEFT, the button half down
                                   153, 1, 64,     // (0.2, -1)
                                   128, 128, 0,    // NOOP
                                   38, 218, 255,   // UPLEFTFIRE, at the rim
                                   128, 1, 0,      // DOWN
                                   128, 128, 0));  // not played
}

TEST(EmulatorJoystickLog, FollowsTheMemoryInAnObservation) {
    auto config = memory_of("ms_pacman");
    config.motion = {.stick_speed = 0.25, .action_latency = {1, 1}, .observation_latency = {4, 4}};
    ASSERT_THAT(cale::observation_space(config).shape, ElementsAre(128 + 18));
    auto plain = config;
    plain.observe_joystick = false;
    Env env(config, 1), other(plain, 1);
    std::vector<std::uint8_t> observation(128 + 18), memory(128);
    env.reset(observation);
    other.reset(memory);
    EXPECT_THAT(joystick_of(observation),
                ElementsAre(128, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0));
    const auto step = [&](const ContinuousAction& action) {
        env.step(action, observation);
        other.step(action, memory);
        EXPECT_EQ(std::vector(observation.begin(), observation.begin() + 128), memory);
        return joystick_of(observation);
    };
    // A frame passes until the stick knows; then it is at 0.25, 0.5 and 0.75, of which the last counts.
    EXPECT_THAT(step({1, 0, 1}), ElementsAre(255, 128, 255, 223, 128, 255, 128, 128, 0, 128, 128, 255, 128,
                                             128, 255, 255, 128, 255));
    EXPECT_THAT(step({0, 0, 0}),
                ElementsAre(128, 128, 0, 160, 128, 0, 255, 128, 255, 255, 128, 0, 128, 128, 0, 128, 128, 0));
}

TEST(EmulatorJoystickLog, KnowsWhatStuck) {
    auto config = memory_of("breakout");
    config.action_space = cale::ActionSet::full;
    config.sticky_probability = 1;
    Env env(config, 1);
    std::vector<std::uint8_t> observation(128 + 18);
    env.reset(observation);
    env.step(std::int64_t{3}, observation);
    EXPECT_THAT(joystick_of(observation),
                ElementsAre(255, 128, 0, 255, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0));
}

TEST(EmulatorJoystickLog, IsTheSameAfterAGameWasResumed) {
    for (const bool moves : {false, true}) {
        auto config = memory_of("qbert");
        config.sticky_probability = 0.25;
        config.noop_max = 5;
        if (moves) config.motion = {.stick_speed = 0.2, .action_latency = {0, 8}, .actuation_noise = 0.1};
        const auto action = [](std::uint64_t t) {
            return cale::factored_stick(static_cast<std::int64_t>(golden::bits(9, t) % 18));
        };
        Env env(config, 7), other(config, 8);
        std::vector<std::uint8_t> mine(128 + 18), theirs(128 + 18);
        env.reset(mine);
        for (std::uint64_t t = 0; t < 60; ++t) env.step(action(t), mine);
        other.resume(env.record());
        for (std::uint64_t t = 60; t < 160; ++t) {
            const auto result = env.step(action(t), mine);
            other.step(action(t), theirs);
            ASSERT_EQ(mine, theirs) << t;
            if (!result.episode_over) continue;
            env.reset(mine);
            other.reset(theirs);
            ASSERT_EQ(mine, theirs) << t;
        }
    }
}

TEST(EmulatorJoystickLog, IsForObservationsOfTheMemory) {
    auto config = memory_of("pong");
    config.obs = cale::Obs::pixels;
    EXPECT_THAT(message_of<std::invalid_argument>([&] { Env(config, 1); }),
                HasSubstr("env.observe_joystick is for observations of the memory: set env.obs to ram"));
    Env env(memory_of("pong"), 1);
    std::vector<std::uint8_t> memory(128);
    EXPECT_THAT(message_of<std::invalid_argument>([&] { env.reset(memory); }),
                HasSubstr("has 146 bytes, not 128"));
}

TEST(EmulatorJoystickLog, EveryGameBeginsInTheCentre) {
    Env env(memory_of("ms_pacman"), 1);
    std::vector<std::uint8_t> observation(128 + 18);
    for (int game = 0; game < 2; ++game) {
        env.reset(observation);
        EXPECT_THAT(joystick_of(observation),
                    ElementsAre(128, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0, 128, 128, 0))
            << game;
        env.step(ContinuousAction{1, 0, 1}, observation);
    }
}

}  // namespace
