// A console that waits for nobody, by a clock that the test turns.
#include "cale/real_time.h"

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "message_of.h"
#include "support/golden.h"

namespace {

using cale::ContinuousAction;
using cale::Env;
using cale::EnvConfig;
using cale::RealTimeGame;
using cale::StepResult;
using testing::HasSubstr;

using Bytes = std::vector<std::uint8_t>;

/// Lets the console play so many frames and no more.
class Clock {
  public:
    cale::FrameClock frames() {
        return [this]() -> std::int64_t {
            std::unique_lock lock(mutex_);
            waiting_ = allowed_ == 0;
            changed_.notify_all();
            changed_.wait(lock, [this] { return allowed_ > 0 || answer_ != 0 || fails_; });
            waiting_ = false;
            if (fails_) throw std::runtime_error("the clock has stopped");
            if (allowed_ == 0) return answer_;
            --allowed_;
            return std::exchange(late_, 0);
        };
    }
    /// Returns when these frames have been played, and what they brought is known.
    void play(int frames, std::int64_t late = 0) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [this] { return waiting_; });
        allowed_ = frames;
        late_ = late;
        waiting_ = false;
        changed_.notify_all();
        changed_.wait(lock, [this] { return waiting_; });
    }
    /// Does not wait for them.
    void allow(int frames) {
        set([=, this] { allowed_ = frames; });
    }
    bool is_asked() {
        const std::lock_guard lock(mutex_);
        return waiting_;
    }
    void stop() {
        set([this] { answer_ = -1; });
    }
    void fail() {
        set([this] { fails_ = true; });
    }

  private:
    template <class Change>
    void set(const Change& change) {
        const std::lock_guard lock(mutex_);
        change();
        changed_.notify_all();
    }

    std::mutex mutex_;
    std::condition_variable changed_;
    int allowed_ = 0;
    std::int64_t answer_ = 0, late_ = 0;
    bool waiting_ = false, fails_ = false;
};

/// A game in real time with its clock. Stops the console before either is gone.
struct Played {
    explicit Played(const EnvConfig& config, std::uint32_t seed = 1)
        : game(config, seed, clock.frames()),
          frame(static_cast<std::size_t>(cale::observation_space(config).frame_size())),
          last_frame(frame.size()) {
        game.reset(frame);
    }
    ~Played() { clock.stop(); }

    void announce(const ContinuousAction& action) {
        const std::vector<float> coordinates{action.radius, action.theta, action.fire};
        game.announce(cale::Actions(std::span<const float>(coordinates)));
    }
    StepResult step(const ContinuousAction& action) {
        const std::vector<float> coordinates{action.radius, action.theta, action.fire};
        return step(cale::Actions(std::span<const float>(coordinates)));
    }
    StepResult step(const cale::Actions& actions) {
        std::vector<StepResult> results(1);
        game.step(actions, frame, last_frame, results);
        return results[0];
    }

    Clock clock;
    RealTimeGame game;
    Bytes frame, last_frame;
};

ContinuousAction random_action(std::uint64_t t) {
    const auto uniform = [t](std::uint64_t which) { return static_cast<float>(golden::uniform(which, t)); };
    return {uniform(1), 6 * uniform(2) - 3, uniform(3)};
}

EnvConfig pacman(const cale::StickMotion& motion = {}) {
    EnvConfig config = cale::protocol_200m("ms_pacman");
    config.motion = motion;
    return config;
}

TEST(EmulatorRealTime, AnAgentThatKeepsUpPlaysTheSameGame) {
    for (const auto& motion : {cale::StickMotion{}, cale::StickMotion{.stick_speed = 0.2}}) {
        for (const auto obs : {cale::Obs::pixels, cale::Obs::ram}) {
            auto config = pacman(motion);
            config.obs = obs;
            Played played(config);
            Env env(config, 1);
            Bytes expected(played.frame.size());
            env.reset(expected);
            EXPECT_EQ(played.frame, expected);
            for (std::uint64_t t = 0; t < 100; ++t) {
                played.announce(random_action(t));
                played.clock.play(4);
                const auto result = played.step(random_action(t));
                const auto same = env.step(random_action(t), expected);
                ASSERT_EQ(played.frame, expected) << t;
                ASSERT_EQ(result.reward, same.reward) << t;
                ASSERT_EQ(result.frames, 4) << t;
                ASSERT_EQ(result.frame_events, same.frame_events) << t;
            }
            EXPECT_EQ(played.game.metrics().at("realtime/missed_frames"), 0);
        }
    }
}

TEST(EmulatorRealTime, WhatASlowAgentMissedIsAddedUp) {
    const auto config = pacman();
    Played played(config);
    Env env(config, 1);
    Bytes expected(played.frame.size());
    env.reset(expected);
    played.announce(random_action(0));
    float reward = 0;
    for (int step = 0; step < 150; ++step) reward += env.step(random_action(0), expected).reward;
    played.clock.play(600, /*late=*/3);
    const auto result = played.step(random_action(1));
    EXPECT_EQ(result.frames, 600);
    EXPECT_EQ(result.reward, reward);
    EXPECT_GT(reward, 0);
    EXPECT_EQ(played.frame, expected);
    EXPECT_EQ(played.game.metrics().at("realtime/missed_frames"), 596);
    EXPECT_EQ(played.game.metrics().at("realtime/late_frames"), 3);
}

TEST(EmulatorRealTime, TheEndOfAGameIsNeverPassedOver) {
    auto config = pacman();
    config.max_frames_per_episode = 40;
    Played played(config);
    played.announce(ContinuousAction{});
    played.clock.play(100);
    for (int game = 0; game < 2; ++game) {
        const auto end = played.step(ContinuousAction{});
        EXPECT_TRUE(end.truncated && end.episode_over);
        EXPECT_EQ(end.frames, 40);
        EXPECT_NE(played.frame, played.last_frame);
    }
    const auto rest = played.step(ContinuousAction{});
    EXPECT_FALSE(rest.episode_over);
    EXPECT_EQ(rest.frames, 20);
}

TEST(EmulatorRealTime, ALostLifeThatCountsIsNeverPassedOver) {
    auto config = pacman();
    config.terminal_on_life_loss = true;
    Env env(config, 1);
    Played played(config);
    Bytes expected(played.frame.size());
    env.reset(expected);
    int frames = 0;
    StepResult same;
    while (!same.terminal) {
        same = env.step(ContinuousAction{}, expected);
        frames += same.frames;
    }
    ASSERT_FALSE(same.episode_over) << "MsPacman has more lives than one";
    played.announce(ContinuousAction{});
    played.clock.play(frames + 40);
    const auto lost = played.step(ContinuousAction{});
    EXPECT_TRUE(lost.terminal && !lost.episode_over);
    EXPECT_EQ(lost.frames, frames);
    EXPECT_EQ(played.frame, expected);
    const auto rest = played.step(ContinuousAction{});
    EXPECT_FALSE(rest.terminal);
    EXPECT_EQ(rest.frames, 40);
}

TEST(EmulatorRealTime, EventsAreCheckedBeforeTheyArePressed) {
    auto config = pacman();
    config.action_space = cale::ActionSet::minimal;
    Played played(config);
    EXPECT_EQ(cale::num_actions(played.game.action_space()), 9);
    const std::vector<std::int64_t> up{1}, none{9};
    played.game.announce(cale::Actions(std::span<const std::int64_t>(up)));
    played.clock.play(4);
    const auto result = played.step(cale::Actions(std::span<const std::int64_t>(up)));
    EXPECT_EQ(static_cast<cale::Event>(result.event), cale::Event::up);
    EXPECT_EQ(message_of<std::out_of_range>(
                  [&] { played.step(cale::Actions(std::span<const std::int64_t>(none))); }),
              "there is no action 9 among the 9 discrete actions of this game");
    EXPECT_EQ(message_of<std::invalid_argument>([&] { played.step(ContinuousAction{}); }),
              "a game in real time: its action is a number");
    Bytes small(3);
    std::vector<StepResult> results(1);
    EXPECT_THROW(played.game.step(cale::Actions(std::span<const std::int64_t>(up)), small, small, results),
                 std::invalid_argument);
}

TEST(EmulatorRealTime, AGameThatWasNotStartedIsNotResumed) {
    cale::RealTimeGame game(pacman(), 1);
    EXPECT_THROW(game.resume(game.record()), std::logic_error);
}

TEST(EmulatorRealTime, AResumedGameBeginsAnew) {
    Played played(pacman());
    const Bytes first = played.frame;
    played.game.resume(played.game.record());
    const auto end = played.step(ContinuousAction{});
    EXPECT_TRUE(end.truncated && end.episode_over);
    EXPECT_EQ(end.frames, 0);
    EXPECT_EQ(played.frame, first);
    EXPECT_EQ(played.last_frame, Bytes(first.size()));  // the caller's own
    played.clock.play(4);
    EXPECT_EQ(played.step(ContinuousAction{}).frames, 4);
}

TEST(EmulatorRealTime, AConsoleThatFailsOrStopsIsNotWaitedFor) {
    {
        Played played(pacman());
        played.clock.fail();
        EXPECT_EQ(message_of<std::runtime_error>([&] { played.step(ContinuousAction{}); }),
                  "the clock has stopped");
        EXPECT_THROW(played.game.reset(played.frame), std::logic_error);
        RealTimeGame other(pacman(), 1);
        const std::vector<float> action{0, 0, 0};
        EXPECT_EQ(message_of<std::logic_error>(
                      [&] { other.announce(cale::Actions(std::span<const float>(action))); }),
                  "no game was started: call reset() first");
    }
    Played played(pacman());
    played.clock.stop();
    EXPECT_EQ(message_of<std::runtime_error>([&] { played.step(ContinuousAction{}); }),
              "the console has stopped");
}

TEST(EmulatorRealTime, APauseLosesNoFrame) {
    Played played(pacman());
    played.announce(ContinuousAction{});
    played.clock.play(4);
    played.game.pause(true);
    played.game.pause(false);
    played.clock.play(4, /*late=*/7);  // the frame that the console waited for before the pause
    EXPECT_EQ(played.step(ContinuousAction{}).frames, 8);
    const auto metrics = played.game.metrics();
    EXPECT_EQ(metrics.at("realtime/missed_frames"), 4);
    EXPECT_EQ(metrics.at("realtime/late_frames"), 7);
}

TEST(EmulatorRealTime, NoFrameIsPlayedInAPause) {
    Played played(pacman());
    played.announce(ContinuousAction{});
    played.clock.play(3);
    played.game.pause(true);
    played.clock.allow(1);  // the frame that the console waited for before the pause
    EXPECT_EQ(played.step(ContinuousAction{}).frames, 4);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT_FALSE(played.clock.is_asked());
    played.game.pause(false);
    played.clock.play(4);
    EXPECT_EQ(played.step(ContinuousAction{}).frames, 4);
}

TEST(EmulatorRealTime, TheConsolesClockIsNoFasterThanSixtyFramesASecond) {
    const auto clock = cale::console_clock();
    const auto start = std::chrono::steady_clock::now();
    for (int frame = 0; frame < 7; ++frame) clock();
    EXPECT_GE(std::chrono::steady_clock::now() - start, 6 * std::chrono::nanoseconds(1'000'000'000 / 60));
}

TEST(EmulatorRealTime, TheConsolesClockCountsWhatWasLate) {
    const auto clock = cale::console_clock();
    const auto start = std::chrono::steady_clock::now();
    EXPECT_EQ(clock(), 0);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    const auto late = clock();
    const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start;
    EXPECT_GE(late, 4);  // the first of them was due
    EXPECT_LE(static_cast<double>(late), 60 * passed.count());
}

}  // namespace
