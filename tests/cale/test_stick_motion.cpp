// A stick that moves: its step responses against closed forms, and games played with it.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/env.h"
#include "cale/stick_motion.h"
#include "message_of.h"
#include "support/golden.h"

namespace {

using cale::ContinuousAction;
using cale::Env;
using cale::EnvConfig;
using cale::Event;
using cale::MovingStick;
using cale::StickMotion;
using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr float kPi = std::numbers::pi_v<float>;
constexpr ContinuousAction kRight{1, 0, 1}, kHalfRight{0.5F, 0, 0}, kLeft{1, kPi, 0}, kCentre{};

/// Where the stick is after each of `frames` frames of one action, from rest in the centre.
std::vector<cale::StickPosition> response(const StickMotion& motion, const ContinuousAction& action,
                                          int frames) {
    std::mt19937 random(1);
    MovingStick stick(motion);
    stick.centre(random);
    stick.command(action, random);
    std::vector<cale::StickPosition> positions;
    for (int frame = 0; frame < frames; ++frame) {
        stick.advance();
        positions.push_back(stick.position());
    }
    return positions;
}

std::vector<double> xs(const std::vector<cale::StickPosition>& positions) {
    std::vector<double> result;
    for (const auto& position : positions) result.push_back(position.x);
    return result;
}

TEST(StickMotion, WithoutMassTheStickMovesStraightAtItsSpeed) {
    EXPECT_THAT(xs(response({.stick_speed = 0.3}, kRight, 5)),
                ElementsAre(DoubleNear(0.3, 1e-12), DoubleNear(0.6, 1e-12), DoubleNear(0.9, 1e-12), 1, 1));
    const auto diagonal = response({.stick_speed = 0.25}, {1, kPi / 4, 0}, 2).back();
    EXPECT_NEAR(diagonal.x, 0.5 / std::numbers::sqrt2, 1e-7);
    EXPECT_NEAR(diagonal.y, 0.5 / std::numbers::sqrt2, 1e-7);
}

TEST(StickMotion, WithMassTheStepResponseIsTheClosedForm) {
    constexpr double kSpeed = 0.15, kTarget = 0.5;
    const auto expect_response = [&](double damping, const std::function<double(double)>& unit_step) {
        const auto x = xs(response({.stick_speed = kSpeed, .stick_damping = damping}, kHalfRight, 40));
        for (std::size_t i = 0; i < x.size(); ++i)
            EXPECT_NEAR(x[i], kTarget * unit_step(static_cast<double>(i) + 1), 1e-12) << damping << ' ' << i;
        // The unit step is at its fastest as fast as it is told to be.
        double fastest = 0;
        for (double t = 0; t < 40; t += 1e-3) fastest = std::max(fastest, unit_step(t + 1e-3) - unit_step(t));
        EXPECT_NEAR(fastest / 1e-3, kSpeed, 1e-5) << damping;
    };

    const double critical = std::numbers::e * kSpeed;
    expect_response(1, [&](double t) { return 1 - std::exp(-critical * t) * (1 + critical * t); });

    // Half of critical: the peak of the speed is where the phase is arc cosine of the ratio, 60 degrees.
    const double ratio = 1 / std::sqrt(3.0);  // zeta / sqrt(1 - zeta^2)
    const double light = kSpeed * std::exp(ratio * std::numbers::pi / 3), ring = light * std::sqrt(0.75);
    expect_response(0.5, [&](double t) {
        return 1 - std::exp(-light / 2 * t) * (std::cos(ring * t) + ratio * std::sin(ring * t));
    });

    // Twice critical: two rates, omega (2 +- sqrt 3).
    const double root = std::sqrt(3.0), sum = std::log((2 + root) / (2 - root)) / (2 * root);
    const double heavy = kSpeed * std::exp(2 * sum), slow = heavy * (2 - root), fast = heavy * (2 + root);
    expect_response(2, [&](double t) {
        return 1 - (fast * std::exp(-slow * t) - slow * std::exp(-fast * t)) / (fast - slow);
    });
}

TEST(StickMotion, AStickThatSwingsStopsAtTheRim) {
    const auto x = xs(response({.stick_speed = 0.3, .stick_damping = 0.1}, kRight, 60));
    EXPECT_EQ(*std::ranges::max_element(x), 1);
    // It leaves the rim no more: told to be there, without speed.
    const auto first = std::ranges::find(x, 1.0);
    EXPECT_TRUE(std::all_of(first, x.end(), [](double value) { return value > 1 - 1e-12; }));
    for (const double damping : {0.1, 1.0, 5.0}) {
        std::mt19937 random(1);
        MovingStick stick({.stick_speed = 2, .stick_damping = damping});
        stick.centre(random);
        for (std::uint64_t t = 0; t < 200; ++t) {
            const auto angle = static_cast<float>(golden::bits(3, t) % 1000) / 1000 * kPi;
            stick.command({1, angle, 0}, random);
            stick.advance();
            const auto& position = stick.position();
            ASSERT_LE(std::hypot(position.x, position.y), 1 + 1e-12) << damping;
        }
    }
}

TEST(StickMotion, LatencyAndTheButtonTakeTheirFrames) {
    EXPECT_THAT(xs(response({.action_latency = {3, 3}}, kRight, 5)), ElementsAre(0, 0, 0, 1, 1));
    std::vector<double> button;
    for (const auto& position : response({.button_frames = 4}, kRight, 5)) button.push_back(position.button);
    EXPECT_THAT(button, ElementsAre(0.25, 0.5, 0.75, 1, 1));
}

TEST(StickMotion, EveryLatencyOfARangeIsDrawn) {
    std::mt19937 random(1);
    std::array<int, 5> count{};
    for (int i = 0; i < 1000; ++i) ++count[static_cast<std::size_t>(cale::draw({0, 4}, random))];
    for (const int n : count) EXPECT_NEAR(n, 200, 60);
    const auto before = random;
    EXPECT_EQ(cale::draw({7, 7}, random), 7);
    EXPECT_EQ(random, before);
}

TEST(StickMotion, NoiseIsNormalAndKeepsTheStickInItsDisc) {
    std::mt19937 random(1);
    MovingStick stick({.actuation_noise = 0.1});
    stick.centre(random);
    double sum = 0, squares = 0, squares_of_y = 0, products = 0;
    constexpr int kCommands = 4000;
    int far = 0;
    for (int i = 0; i < kCommands; ++i) {
        stick.command(kCentre, random);
        stick.advance();
        far += std::abs(stick.position().x) > 0.2 ? 1 : 0;
        sum += stick.position().x;
        squares += stick.position().x * stick.position().x;
        squares_of_y += stick.position().y * stick.position().y;
        products += stick.position().x * stick.position().y;
    }
    EXPECT_NEAR(sum / kCommands, 0, 0.01);
    EXPECT_NEAR(std::sqrt(squares / kCommands), 0.1, 0.005);
    EXPECT_NEAR(std::sqrt(squares_of_y / kCommands), 0.1, 0.005);
    EXPECT_NEAR(products / kCommands, 0, 0.001);
    EXPECT_NEAR(far, 0.0455 * kCommands, 40) << "beyond two standard deviations";
    for (int i = 0; i < 100; ++i) {
        stick.command(kRight, random);
        stick.advance();
        ASSERT_LE(std::hypot(stick.position().x, stick.position().y), 1 + 1e-12);
    }
}

TEST(StickMotion, MirroredCommandsMoveTheStickInMirroredWays) {
    // Across the diagonal, where x and y change places; on the way it swings into the rim and slides along
    // it.
    for (const auto& motion :
         {StickMotion{.stick_speed = 0.3}, StickMotion{.stick_speed = 0.3, .stick_damping = 0.1},
          StickMotion{.stick_speed = 0.15, .stick_damping = 2}}) {
        std::mt19937 random(1);
        MovingStick stick(motion), mirrored(motion);
        stick.centre(random);
        mirrored.centre(random);
        double farthest_from_diagonal = 0;
        for (std::uint64_t t = 0; t < 200; ++t) {
            const float angle = static_cast<float>(golden::bits(3, t / 5) % 1000) / 500 * kPi;
            stick.command({1, angle, 0}, random);
            mirrored.command({1, kPi / 2 - angle, 0}, random);
            stick.advance();
            mirrored.advance();
            ASSERT_NEAR(stick.position().x, mirrored.position().y, 1e-5) << t;
            ASSERT_NEAR(stick.position().y, mirrored.position().x, 1e-5) << t;
            farthest_from_diagonal =
                std::max(farthest_from_diagonal, std::abs(stick.position().x - stick.position().y));
        }
        EXPECT_GT(farthest_from_diagonal, 0.5);
    }
}

TEST(StickMotion, NoiseMovesAPaddleAlongItsAxisAlone) {
    std::mt19937 random(1);
    MovingStick paddle({.actuation_noise = 0.1}, /*one_axis=*/true);
    paddle.centre(random);
    for (int i = 0; i < 100; ++i) {
        paddle.command({1, kPi / 2, 0}, random);
        paddle.advance();
        ASSERT_EQ(paddle.position().y, 0);
    }
    EXPECT_NE(paddle.position().x, 0);
}

TEST(StickMotion, ImpossibleSettingsAreNamed) {
    const auto refusal = [](const StickMotion& motion) {
        EnvConfig config;
        config.motion = motion;
        return message_of<std::invalid_argument>([&] { Env(config, 1); });
    };
    EXPECT_THAT(refusal({.stick_speed = 0}), HasSubstr("stick_speed must be 0.001 to 2, not '0'"));
    EXPECT_THAT(refusal({.stick_damping = 1}), HasSubstr("env.stick_damping is set, but env.stick_speed"));
    EXPECT_THAT(refusal({.action_latency = {5, 3}}),
                HasSubstr("action_latency must be an integer, or two such as 0-8, not '5-3'"));
    EXPECT_THAT(refusal({.observation_latency = {0, 1000}}), HasSubstr("observation_latency must be 0 to"));
}

// ---- games ---------------------------------------------------------------------------

EnvConfig game(const char* name, const StickMotion& motion = {}) {
    EnvConfig config = cale::protocol_200m(name);
    config.motion = motion;
    return config;
}

ContinuousAction random_action(std::uint64_t t) {
    const auto uniform = [t](std::uint64_t which) {
        return static_cast<float>(golden::bits(which, t) % 10'000) / 10'000;
    };
    return {uniform(1), (2 * uniform(2) - 1) * kPi, uniform(3)};
}

/// What a game showed, and gave, step by step.
struct Trace {
    std::vector<std::vector<std::uint8_t>> observations;  // the first one is that of the reset
    std::vector<float> rewards;
    std::vector<cale::StepResult> results;
};

using ActionOf = std::function<ContinuousAction(std::uint64_t)>;

Trace play(Env& env, const EnvConfig& config, std::uint64_t steps, const ActionOf& action = random_action) {
    std::vector<std::uint8_t> frame(static_cast<std::size_t>(cale::observation_space(config).frame_size()));
    Trace trace;
    env.reset(frame);
    trace.observations.push_back(frame);
    for (std::uint64_t t = 0; t < steps; ++t) {
        trace.results.push_back(env.step(action(t), frame));
        trace.rewards.push_back(trace.results.back().reward);
        trace.observations.push_back(frame);
        if (trace.results.back().episode_over) break;
    }
    return trace;
}
Trace play(const EnvConfig& config, std::uint64_t steps, const ActionOf& action = random_action) {
    Env env(config, 1);
    return play(env, config, steps, action);
}

TEST(EmulatorStickMotion, AStickThatCrossesItsDiscInAFrameIsCalesJoystick) {
    for (const char* name : {"ms_pacman", "breakout"}) {
        const auto at_once = play(game(name), 300);
        const auto moving = play(game(name, {.stick_speed = 2}), 300);
        EXPECT_EQ(moving.observations, at_once.observations) << name;
        EXPECT_EQ(moving.rewards, at_once.rewards) << name;
        // How far a paddle goes is how far the stick is pushed.
        auto config = game(name);
        config.paddle_strength = cale::PaddleStrength::radius;
        const auto pushed = play(config, 300);
        config.motion.stick_speed = 2;
        EXPECT_EQ(play(config, 300).observations, pushed.observations) << name;
        EXPECT_EQ(pushed.observations == at_once.observations, config.game == "ms_pacman");
    }
}

TEST(EmulatorStickMotion, AnActionOfFourFramesLatencyIsThatOfTheStepBefore) {
    const auto late = play(game("ms_pacman", {.action_latency = {4, 4}}), 200);
    const auto shifted =
        play(game("ms_pacman"), 200, [](std::uint64_t t) { return t == 0 ? kCentre : random_action(t - 1); });
    EXPECT_EQ(late.observations, shifted.observations);
}

TEST(EmulatorStickMotion, AnObservationOfFourFramesLatencyIsThatOfTheStepBefore) {
    for (const auto obs : {cale::Obs::pixels, cale::Obs::ram}) {
        auto config = game("ms_pacman");
        config.obs = obs;
        const auto now = play(config, 200);
        config.motion.observation_latency = {4, 4};
        const auto late = play(config, 200);
        EXPECT_EQ(late.rewards, now.rewards);
        EXPECT_EQ(late.observations[0], now.observations[0]);
        EXPECT_EQ(late.observations[1], now.observations[0]);
        for (std::size_t t = 2; t < late.observations.size(); ++t)
            ASSERT_EQ(late.observations[t], now.observations[t - 1]) << t;
    }
}

TEST(EmulatorStickMotion, SeveralEventsOccurBetweenTwoActions) {
    auto config = game("ms_pacman", {.stick_speed = 0.25, .button_frames = 4});
    config.sticky_probability = 0;
    const auto trace = play(config, 3, [](std::uint64_t t) { return t == 1 ? kLeft : kRight; });
    const auto seen = [&](std::size_t step) {
        const auto& events = trace.results[step].frame_events;
        return std::vector<Event>{Event(events[0]), Event(events[1]), Event(events[2]), Event(events[3])};
    };
    // x is 0.25, 0.5, 0.75, 1 and the button as much; beyond 0.5 they count.
    EXPECT_THAT(seen(0), ElementsAre(Event::noop, Event::noop, Event::right_fire, Event::right_fire));
    EXPECT_THAT(seen(1), ElementsAre(Event::right_fire, Event::noop, Event::noop, Event::noop));
    EXPECT_THAT(seen(2), ElementsAre(Event::noop, Event::noop, Event::right_fire, Event::right_fire));
    for (const auto& result : trace.results) EXPECT_TRUE(result.stick_moves);
}

TEST(EmulatorStickMotion, TheConsoleSawWhatStuck) {
    // Right, centre, left, centre: Breakout's paddle stays away from its ends, where it cannot be seen to
    // move.
    const auto to_and_fro = [](std::uint64_t t) {
        return ContinuousAction{t % 2 == 0 ? 1.0F : 0.0F, t % 4 == 0 ? 0 : kPi, t % 3 == 0 ? 1.0F : 0.0F};
    };
    for (const char* name : {"ms_pacman", "breakout"}) {
        auto config = game(name);
        const auto frames_that_stuck = [&](double sticky) {
            config.sticky_probability = sticky;
            int different = 0;
            for (const auto& result : play(config, 200, to_and_fro).results) {
                EXPECT_FALSE(result.stick_moves);
                for (int frame = 0; frame < result.frames; ++frame)
                    different += result.frame_events[static_cast<std::size_t>(frame)] != result.event;
            }
            return different;
        };
        EXPECT_EQ(frames_that_stuck(0), 0) << name;
        // Of 200 changes 1/4 + 1/16 + ... of a frame is late.
        EXPECT_NEAR(frames_that_stuck(0.25), 200 / 3.0, 25) << name;
    }
}

TEST(EmulatorStickMotion, DiscreteActionsMoveTheSameStick) {
    auto config = game("ms_pacman", {.stick_speed = 0.2, .stick_damping = 0.7, .action_latency = {2, 2}});
    const auto joystick = play(config, 100, [](std::uint64_t t) {
        return cale::factored_stick(static_cast<std::int64_t>(golden::bits(9, t) % 18));
    });
    config.action_space = cale::ActionSet::full;
    Env env(config, 1);
    std::vector<std::uint8_t> frame(cale::kFrameSize);
    env.reset(frame);
    for (std::uint64_t t = 0; t < 100; ++t) {
        const auto event = cale::factored_events()[golden::bits(9, t) % 18];
        env.step(static_cast<std::int64_t>(event), frame);
        ASSERT_EQ(frame, joystick.observations[t + 1]) << t;
    }
}

TEST(EmulatorStickMotion, AGameIsResumedExactlyWithAllOfIt) {
    auto config = game("qbert", {.stick_speed = 0.2,
                                 .stick_damping = 0.6,
                                 .button_frames = 3,
                                 .action_latency = {0, 8},
                                 .observation_latency = {0, 8},
                                 .actuation_noise = 0.1});
    config.noop_max = 5;
    for (const auto obs : {cale::Obs::pixels, cale::Obs::ram}) {
        config.obs = obs;
        Env env(config, 7), other(config, 8);
        play(env, config, 50);  // a game before, whose draws count
        play(env, config, 60);
        other.resume(env.record());
        std::vector<std::uint8_t> mine(
            static_cast<std::size_t>(cale::observation_space(config).frame_size()));
        auto theirs = mine;
        for (std::uint64_t t = 60; t < 400; ++t) {
            const auto result = env.step(random_action(t), mine);
            const auto same = other.step(random_action(t), theirs);
            ASSERT_EQ(mine, theirs) << t;
            ASSERT_EQ(result.reward, same.reward);
            ASSERT_EQ(result.frame_events, same.frame_events);
            if (!result.episode_over) continue;
            env.reset(mine);
            other.reset(theirs);
            ASSERT_EQ(mine, theirs) << t;
        }
        EXPECT_EQ(env.stick()->x, other.stick()->x);
    }
}

TEST(EmulatorStickMotion, ARecordOfAnotherJoystickIsRefused) {
    const auto config = game("pong"), moving = game("pong", {.stick_speed = 0.2});
    Env env(config, 1), other(moving, 1);
    play(env, config, 10);
    play(other, moving, 10);
    const auto sentence = [](Env& to, const cale::GameRecord& record) {
        return message_of<std::runtime_error>([&] { to.resume(record); });
    };
    EXPECT_THAT(sentence(other, env.record()), HasSubstr("another configuration's"));
    EXPECT_THAT(sentence(env, other.record()), HasSubstr("another configuration's"));
    auto damaged = other.record();
    damaged.commands[3].radius = 2;
    EXPECT_THAT(sentence(other, damaged), HasSubstr("damaged"));
}

}  // namespace
