// A game under way, recorded in one environment and resumed in another.
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/env.h"
#include "cale/games.h"
#include "cale/vector_env.h"
#include "support/golden.h"

namespace cale {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

/// Trials per game; more by hand: CALE_RESUME_TRIALS=10 test_cale --gtest_filter='EmulatorResume*'
int trials() {
    const char* wanted = std::getenv("CALE_RESUME_TRIALS");
    return wanted != nullptr ? std::atoi(wanted) : 1;
}

ContinuousAction random_action(std::uint64_t stream, std::uint64_t t) {
    const auto uniform = [&](std::uint64_t i) {
        return static_cast<float>(golden::uniform(stream, 3 * t + i));
    };
    return {uniform(0), 6 * uniform(1) - 3, uniform(2)};
}

/// Steps, and starts a new game where one is over.
StepResult step(Env& env, std::uint64_t stream, std::uint64_t t, std::vector<std::uint8_t>& frame) {
    const auto result = env.step(random_action(stream, t), frame);
    if (result.episode_over) env.reset(frame);
    return result;
}

std::vector<std::uint8_t> ram_of(const Env& env) {
    return {env.ram().begin(), env.ram().end()};
}

TEST(EmulatorResume, EveryGameGoesOnExactly) {
    std::uint64_t stream = 0;
    for (int trial = 0; trial < trials(); ++trial) {
        for (const auto& game : games()) {
            ++stream;
            auto config = protocol_200m(std::string(game.rom));  // with sticky actions
            config.max_frames_per_episode = 480;  // so that games begin where others have left off
            config.noop_max = 3;
            config.paddle_strength = PaddleStrength::radius;
            std::vector<std::uint8_t> frame(kFrameSize), resumed_frame(kFrameSize);
            Env original(config, static_cast<std::uint32_t>(stream));
            original.reset(frame);
            const auto before = static_cast<std::uint64_t>(130 + 240 * golden::uniform(stream, 1'000'000));
            for (std::uint64_t t = 0; t < before; ++t) step(original, stream, t, frame);

            Env resumed(config, static_cast<std::uint32_t>(stream + 1000));
            resumed.reset(resumed_frame);
            resumed.resume(original.record());
            ASSERT_EQ(ram_of(resumed), ram_of(original)) << game.rom;
            for (std::uint64_t t = before; t < before + 150; ++t) {
                const auto expected = step(original, stream, t, frame);
                const auto result = step(resumed, stream, t, resumed_frame);
                ASSERT_EQ(result.reward, expected.reward) << game.rom << ", step " << t;
                ASSERT_EQ(result.lives, expected.lives) << game.rom << ", step " << t;
                ASSERT_EQ(result.episode_over, expected.episode_over) << game.rom << ", step " << t;
                ASSERT_EQ(resumed_frame, frame) << game.rom << ", step " << t;
                ASSERT_EQ(ram_of(resumed), ram_of(original)) << game.rom << ", step " << t;
            }
            EXPECT_EQ(resumed.frame_number(), original.frame_number()) << game.rom;
        }
    }
}

TEST(EmulatorResume, VectorEnvironmentsResumeEveryGame) {
    auto config = protocol_200m("breakout");
    config.num_envs = 3;
    config.env_threads = 2;
    const std::vector<std::uint32_t> seeds{1, 2, 3}, others{4, 5, 6};
    VectorEnv original(config, seeds), resumed(config, others);
    std::vector<std::uint8_t> frames(3 * kFrameSize), final_frames(frames.size()),
        resumed_frames(frames.size());
    std::vector<StepResult> results(3);
    original.reset(frames);
    const auto play = [&](VectorEnv& env, std::uint64_t t, std::vector<std::uint8_t>& seen) {
        std::vector<ContinuousAction> actions;
        for (std::uint64_t i = 0; i < 3; ++i) actions.push_back(random_action(i, t));
        env.step(actions, seen, final_frames, results);
    };
    for (std::uint64_t t = 0; t < 80; ++t) play(original, t, frames);
    resumed.resume(original.record());
    for (std::uint64_t t = 80; t < 160; ++t) {
        play(original, t, frames);
        play(resumed, t, resumed_frames);
        ASSERT_EQ(resumed_frames, frames) << t;
    }
    auto fewer = original.record();
    fewer.pop_back();
    EXPECT_THROW(resumed.resume(fewer), std::invalid_argument);
}

TEST(EmulatorResume, RefusesWhatIsNoRecord) {
    const auto config = protocol_200m("pong");
    std::vector<std::uint8_t> frame(kFrameSize);
    Env env(config, 1);
    env.reset(frame);
    for (std::uint64_t t = 0; t < 20; ++t) step(env, 1, t, frame);
    const auto good = env.record();
    const auto expect_refused = [&](const GameRecord& record) {
        EXPECT_THAT([&] { env.resume(record); }, ThrowsMessage<std::runtime_error>(HasSubstr("damaged")));
        EXPECT_THROW(step(env, 1, 0, frame), std::logic_error) << "part of a game is none";
    };
    expect_refused({});
    for (const std::size_t length :
         {std::size_t{10}, std::size_t{6000}, good.start.size() / 2, good.start.size() - 1}) {
        auto cut = good;
        cut.start.resize(length);
        expect_refused(cut);
    }
    auto impossible = good;
    impossible.events[3] = static_cast<Event>(18);
    expect_refused(impossible);
    impossible = good;
    impossible.strengths[3] = -1;
    expect_refused(impossible);
    impossible = good;
    impossible.strengths.pop_back();
    expect_refused(impossible);
    Env other(protocol_200m("breakout"), 1);
    other.reset(frame);
    EXPECT_THAT([&] { other.resume(good); }, ThrowsMessage<std::runtime_error>(HasSubstr("another")));
    env.resume(good);
    EXPECT_EQ(env.record().events, good.events);
}

TEST(EmulatorResume, ARefusedRecordChangesNoLaterGame) {
    auto config = protocol_200m("pong");
    config.noop_max = 30;
    std::vector<std::uint8_t> frame(kFrameSize);
    Env env(config, 1), undisturbed(config, 1);
    env.reset(frame);
    undisturbed.reset(frame);
    GameRecord damaged;
    damaged.start = "no numbers";
    EXPECT_THROW(env.resume(damaged), std::runtime_error);
    for (int game = 0; game < 4; ++game) {
        env.reset(frame);
        undisturbed.reset(frame);
        EXPECT_EQ(env.frame_number(), undisturbed.frame_number()) << "as many no-ops";
        EXPECT_EQ(ram_of(env), ram_of(undisturbed));
    }
}

}  // namespace
}  // namespace cale
