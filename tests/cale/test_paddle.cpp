#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/games.h"
#include "cale/random_play.h"
#include "cale/real_time.h"
#include "cale/vector_env.h"
#include "message_of.h"
#include "support/golden.h"

namespace {

using cale::ContinuousAction;
using cale::Env;
using cale::EnvConfig;
using cale::Event;
using cale::Joystick;
using testing::ElementsAre;
using testing::HasSubstr;

// ALE's paddles: a step of 23,000 on a way of 762,746, the middle of which is where a game begins.
constexpr double kWay = 790'196 - 27'450, kStep = 23'000;

EnvConfig absolute(const char* game) {
    EnvConfig config;
    config.game = game;
    config.obs = cale::Obs::ram;
    config.paddle = cale::Paddle::absolute;
    config.sticky_probability = 0;
    config.frame_skip = 1;
    return config;
}

ContinuousAction at(float position, float fire = 0) {
    return cale::stick(Joystick::paddle, std::array{position, fire});
}

/// A position and a button, the same for the same t.
ContinuousAction random_action(std::uint64_t t) {
    const auto uniform = [t](std::uint64_t what) {
        return static_cast<float>(golden::bits(what, t) % 1025) / 1024;
    };
    return at(uniform(1), uniform(2));
}

struct Played {
    explicit Played(const EnvConfig& config, std::uint32_t seed = 1) : env(config, seed) {
        env.reset(memory);
    }
    cale::StepResult step(const ContinuousAction& action) { return env.step(action, memory); }

    std::vector<std::uint8_t> memory = std::vector<std::uint8_t>(cale::kRamSize);
    Env env;
};

TEST(PaddleCoordinates, LieOnTheHorizontalAxisOfTheJoystick) {
    EXPECT_EQ(at(1).radius, 1);
    EXPECT_EQ(at(1).theta, 0);
    EXPECT_EQ(at(0).radius, 1);
    EXPECT_EQ(std::cos(at(0).theta), -1);
    EXPECT_EQ(at(0.5F).radius, 0);
    EXPECT_EQ(at(0.25F, 0.75F).fire, 0.75F);
    for (const float position : {0.0F, 0.125F, 0.3F, 0.5F, 0.875F, 1.0F})
        EXPECT_FLOAT_EQ(cale::coordinates_of(Joystick::paddle, at(position)).front(), position);
    EXPECT_THAT(message_of<std::invalid_argument>([] { at(1.25F); }),
                HasSubstr("the action's position is 1.25: it must lie in [0, 1]"));
    const auto box = std::get<cale::Box>(cale::joystick_space(Joystick::paddle));
    EXPECT_THAT(box.names, ElementsAre("position", "fire"));
    // Both ends and the middle, without and with the button.
    EXPECT_THAT(box.landmarks, ElementsAre(0, 0, 0, 1, 0.5F, 0, 0.5F, 1, 1, 0, 1, 1));
}

TEST(PaddleCoordinates, AreThoseOfAnAbsolutePaddleAlone) {
    EXPECT_EQ(cale::coordinates(absolute("pong")), Joystick::paddle);
    EXPECT_EQ(cale::box_size(cale::action_space(absolute("pong"))), 2);
    const auto refusal = [](const char* game, auto change) {
        auto config = absolute(game);
        change(config);
        return message_of<std::invalid_argument>([&] { cale::action_space(config); });
    };
    EXPECT_THAT(refusal("ms_pacman", [](EnvConfig&) {}),
                HasSubstr("env.paddle=absolute: MsPacman has no paddle; the games with one are breakout"));
    EXPECT_THAT(
        refusal("pong",
                [](EnvConfig& c) { c.paddle = cale::Paddle::joystick, c.joystick = Joystick::paddle; }),
        HasSubstr("env.joystick=paddle: these are the coordinates of env.paddle=absolute; set that"));
    EXPECT_THAT(refusal("pong", [](EnvConfig& c) { c.action_space = cale::ActionSet::minimal; }),
                HasSubstr("does not go with env.action_space=minimal: set that to continuous"));
    EXPECT_THAT(refusal("pong", [](EnvConfig& c) { c.joystick = Joystick::factored; }),
                HasSubstr("does not go with env.joystick=factored: its action is a position"));
    EXPECT_THAT(refusal("pong", [](EnvConfig& c) { c.paddle_strength = cale::PaddleStrength::radius; }),
                HasSubstr("does not go with env.paddle_strength=radius"));
    // Random play on the joystick says nothing about it.
    EXPECT_TRUE(cale::random_floor(cale::protocol_atari100k("pong")));
    auto config = cale::protocol_atari100k("pong");
    config.paddle = cale::Paddle::absolute;
    EXPECT_FALSE(cale::random_floor(config));
    EXPECT_FALSE(cale::random_floor(cale::protocol_atari100k("kaboom")));
}

TEST(EmulatorPaddle, GamesHaveOneWhereTheirPropertiesSaySo) {
    const auto check = [](const cale::Game& game) {
        const cale::Emulator console(game, cale::find_rom(game.rom, ""), 0, 1);
        EXPECT_EQ(console.has_paddle(), cale::has_paddle(game)) << game.name;
        EXPECT_EQ(std::ssize(console.minimal_actions()), game.minimal_action_count) << game.name;
    };
    for (const auto& game : cale::all_games()) check(game);
    EXPECT_EQ(std::ranges::count_if(cale::all_games(), cale::has_paddle), 6);
    EXPECT_EQ(cale::find_game("ALE/Kaboom-v5").rom, "kaboom");
}

TEST(EmulatorPaddle, IsInOneFrameWhereTheActionSays) {
    for (const char* game : {"backgammon", "blackjack", "breakout", "casino", "kaboom", "pong"}) {
        SCOPED_TRACE(game);
        Played played(absolute(game));
        EXPECT_NEAR(*played.env.paddle(), 0.5, 1e-6);
        // At both ends exactly, from the other end.
        for (const float end : {0.0F, 1.0F, 0.0F}) {
            const auto result = played.step(at(end));
            EXPECT_EQ(*played.env.paddle(), end);
            EXPECT_EQ(Event(result.event), end == 0 ? Event::left : Event::right);
            EXPECT_EQ(result.frame_events[0], result.event);
        }
        for (std::uint64_t t = 0; t < 200; ++t) {
            const auto action = random_action(t);
            const double position = cale::coordinates_of(Joystick::paddle, action).front();
            if (played.step(action).episode_over)
                played.env.reset(played.memory);
            else
                EXPECT_NEAR(*played.env.paddle(), position, 0.5001 / kWay) << t;
        }
    }
}

TEST(EmulatorPaddle, AtALEsSpeedItGoesWhereTheJoystickPushesIt) {
    for (const char* game : {"breakout", "kaboom", "pong"}) {
        SCOPED_TRACE(game);
        auto config = absolute(game);
        config.motion.stick_speed = 2 * kStep / kWay;
        auto pushed = config;
        pushed.paddle = cale::Paddle::joystick;
        pushed.motion = {};
        Played placed(config), joystick(pushed);
        for (int frame = 0; frame < 60; ++frame) {
            // 16 steps reach neither end from the middle.
            const bool right = frame / 8 % 4 == 0 || frame / 8 % 4 == 3;
            const float fire = frame % 5 == 0 ? 1.0F : 0.0F;
            placed.step(at(right ? 1 : 0, fire));
            joystick.step({.radius = 1, .theta = right ? 0 : std::acos(-1.0F), .fire = fire});
            ASSERT_EQ(placed.memory, joystick.memory) << frame;
        }
    }
}

TEST(EmulatorPaddle, SticksWhereItWas) {
    auto config = absolute("breakout");
    config.sticky_probability = 1;
    Played stuck(config);
    for (int t = 0; t < 20; ++t) EXPECT_EQ(stuck.step(at(1)).frame_events[0], 0);
    EXPECT_NEAR(*stuck.env.paddle(), 0.5, 1e-6);

    config.sticky_probability = 0.25;
    Played played(config);
    int late = 0;
    for (int t = 0; t < 2000; ++t) {
        const float wanted = t % 2 == 0 ? 0.2F : 0.8F;
        const auto result = played.step(at(wanted));
        late += std::abs(*played.env.paddle() - wanted) > 0.1;
        if (result.episode_over) played.env.reset(played.memory);
    }
    EXPECT_NEAR(late, 400, 72);  // an odd number of frames late; four standard deviations
}

TEST(EmulatorPaddle, AGameIsResumedExactly) {
    for (const bool moving : {false, true}) {
        auto config = absolute("breakout");
        config.frame_skip = 4;
        config.sticky_probability = 0.25;
        config.noop_max = 5;
        if (moving) {
            config.motion = {.stick_speed = 0.1,
                             .stick_damping = 0.7,
                             .button_frames = 2,
                             .action_latency = {0, 8},
                             .observation_latency = {0, 8},
                             .actuation_noise = 0.1};
        }
        Played played(config, 7), other(config, 8);
        for (std::uint64_t t = 0; t < 100; ++t) played.step(random_action(t));
        other.env.resume(played.env.record());
        for (std::uint64_t t = 100; t < 700; ++t) {
            const auto result = played.step(random_action(t)), same = other.step(random_action(t));
            ASSERT_EQ(played.memory, other.memory) << t;
            ASSERT_EQ(result.frame_events, same.frame_events) << t;
            ASSERT_EQ(played.env.paddle(), other.env.paddle()) << t;
            if (!result.episode_over) continue;
            played.env.reset(played.memory);
            other.env.reset(other.memory);
        }
    }
}

TEST(EmulatorPaddle, ManyAreSteppedByTheirCoordinatesAndResumed) {
    auto config = absolute("kaboom");
    config.num_envs = 3;
    const std::array<std::uint32_t, 3> seeds{1, 2, 3};
    cale::VectorEnv envs(config, seeds), others(config, seeds);
    EXPECT_EQ(std::get<cale::Box>(envs.action_space()).names.front(), "position");
    std::vector<std::uint8_t> frames(3 * cale::kRamSize), last(frames.size()), same(frames.size());
    std::vector<cale::StepResult> results(3);
    envs.reset(frames);
    const std::array<float, 6> actions{0, 1, 0.25, 0, 1, 1};
    const cale::Actions coordinates = std::span<const float>(actions);
    for (int t = 0; t < 30; ++t) envs.step(coordinates, frames, last, results);
    EXPECT_EQ(*envs.env(0).paddle(), 0);
    EXPECT_NEAR(*envs.env(1).paddle(), 0.25, 1 / kWay);
    EXPECT_EQ(*envs.env(2).paddle(), 1);
    others.resume(envs.record());
    for (int t = 0; t < 30; ++t) {
        envs.step(coordinates, frames, last, results);
        others.step(coordinates, same, last, results);
        ASSERT_EQ(frames, same) << t;
    }
}

TEST(EmulatorPaddle, InRealTimeToo) {
    auto config = absolute("breakout");
    std::vector<std::uint8_t> frame(cale::kRamSize), last(frame.size());
    std::vector<cale::StepResult> results(1);
    std::atomic<double> seen = -1;
    cale::RealTimeGame game(
        config, 1, [] { return std::int64_t{0}; }, [&seen](const Env& env) { seen = *env.paddle(); });
    EXPECT_EQ(cale::box_size(game.action_space()), 2);
    game.reset(frame);
    const std::array<float, 2> action{1, 0};
    for (int t = 0; t < 20; ++t) game.step(std::span<const float>(action), frame, last, results);
    EXPECT_EQ(seen, 1);
}

TEST(EmulatorPaddle, InEveryGameTheFirstFrameSticksInTheMiddle) {
    auto config = absolute("breakout");
    config.sticky_probability = 0.25;
    Played played(config);
    int stuck = 0;
    for (int game = 0; game < 100; ++game) {
        played.env.reset(played.memory);
        played.step(at(1));
        stuck += *played.env.paddle() < 0.75;
    }
    EXPECT_NEAR(stuck, 25, 17) << "four standard deviations";
}

}  // namespace
