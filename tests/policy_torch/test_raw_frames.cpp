// Games played from raw frames, as another program would, held to the environment of training.
#include <gtest/gtest.h>

#include <optional>
#include <random>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/games.h"
#include "policy/cale_policy.h"
#include "policy/observer.h"
#include "policy/sample_policies.h"
#include "policy/torch/policy.h"

namespace cale {
namespace {

PolicyInfo info_of(const EnvConfig& env) {
    PolicyInfo info;
    info.threshold = env.threshold;
    info.frame_skip = env.frame_skip;
    info.life_loss_ends_episode = env.terminal_on_life_loss;
    return info;
}

std::vector<std::uint8_t> gray_of(const Emulator& emulator) {
    std::vector<std::uint8_t> pixels;
    for (const auto index : emulator.screen()) pixels.push_back(emulator.gray_palette()[index]);
    return pixels;
}
std::vector<std::uint8_t> rgb_of(const Emulator& emulator) {
    std::vector<std::uint8_t> pixels;
    for (const auto index : emulator.screen())
        pixels.insert(pixels.end(), emulator.rgb_palette()[index].begin(),
                      emulator.rgb_palette()[index].end());
    return pixels;
}

/// One step of a program that knows nothing of this project but the Observer. Returns the reward.
template <class ScreenOf>
int play_step(Emulator& emulator, Observer& observer, const Decision& decision, ScreenOf&& screen_of) {
    int reward = 0;
    do {
        const int lives = emulator.lives();
        reward += emulator.act(decision.event, decision.strength);
        observer.see(screen_of(emulator));
        if (emulator.lives() < lives) observer.lose_life();
    } while (!observer.due() && !emulator.game_over());
    return reward;
}

struct Protocol {
    const char* game;
    bool atari100k;
};

class RawFramesEmulator : public testing::TestWithParam<Protocol> {
  protected:
    EnvConfig config() const {
        return GetParam().atari100k ? protocol_atari100k(GetParam().game) : protocol_200m(GetParam().game);
    }
    static Emulator emulator_for(const EnvConfig& env, std::uint32_t seed) {
        return {find_game(env.game), find_rom(env.game, ""), static_cast<float>(env.sticky_probability),
                seed};
    }
};

TEST_P(RawFramesEmulator, AreSeenAsInTraining) {
    const auto env_config = config();
    const auto info = info_of(env_config);
    Env env(env_config, 5);
    auto emulator = emulator_for(env_config, 5);
    Observer gray(info, emulator.screen_height()), rgb(info, emulator.screen_height());
    FrameStack stack(1, 4);
    std::vector<std::uint8_t> frame(kFrameSize);
    std::mt19937 random(1);
    std::uniform_real_distribution<float> uniform(0, 1);

    std::optional<StepResult> last;
    for (int step = 0; step < 250; ++step) {
        if (!last || last->episode_over) {
            env.reset(frame);
            stack.clear(0);
            emulator.reset();
            gray.start(gray_of(emulator));
            rgb.start(rgb_of(emulator));
            last.emplace();
        } else {
            const ContinuousAction stick{uniform(random), 6 * uniform(random) - 3, uniform(random)};
            last = env.step(stick, frame);
            if (last->terminal || last->truncated) stack.clear(0);
            const auto played = decision(info, stick);
            EXPECT_EQ(played.event, static_cast<Event>(last->event));
            int reward = 0;
            do {
                const int lives = emulator.lives();
                reward += emulator.act(played.event, played.strength);
                gray.see(gray_of(emulator));
                rgb.see(rgb_of(emulator));
                if (emulator.lives() < lives) {
                    gray.lose_life();
                    rgb.lose_life();
                }
            } while (!gray.due() && !emulator.game_over());
            ASSERT_EQ(static_cast<float>(reward), last->reward) << step;
        }
        if (last->episode_over) continue;
        stack.push(0, frame);
        ASSERT_TRUE(std::ranges::equal(gray.observation(), stack.data())) << step;
        ASSERT_TRUE(std::ranges::equal(rgb.observation(), stack.data())) << step;
    }
}

TEST_P(RawFramesEmulator, GiveTheReturnsOfAnEvaluation) {
    auto env_config = config();
    // An untrained policy may never serve Breakout's next ball.
    env_config.max_frames_per_episode = 8'000;
    const auto network = test::actor(phi_dqn(), relu_branch("actor", /*layer_norm=*/false));
    auto file = test::sample_policy(test::with_observation({4, 84, 84}, network));
    file.info.life_loss_ends_episode = env_config.terminal_on_life_loss;
    const auto contents = policy_file_contents(file);
    const auto policy = Policy::parse(contents);

    // As an evaluation does it: a whole game, or its first 2,000 steps.
    std::vector<float> rewards;
    std::vector<Event> events;
    {
        Env env(env_config, 9);
        FrameStack stack(1, 4);
        std::vector<std::uint8_t> frame(kFrameSize);
        env.reset(frame);
        stack.push(0, frame);
        StepResult result;
        while (!result.episode_over) {
            result = env.step(policy.act(stack.data()).stick, frame);
            if (result.terminal || result.truncated) stack.clear(0);
            stack.push(0, frame);
            rewards.push_back(result.reward);
            events.push_back(static_cast<Event>(result.event));
        }
    }
    // With LibTorch on colour, and through the C interface on gray.
    auto emulator = emulator_for(env_config, 9);
    Observer observer(policy.info(), emulator.screen_height());
    emulator.reset();
    observer.start(rgb_of(emulator));
    auto c_emulator = emulator_for(env_config, 9);
    auto* const c_policy = cale_policy_parse(contents.data(), contents.size());
    auto* const session = cale_session_new(c_policy, c_emulator.screen_height(), 1);
    c_emulator.reset();
    auto screen = gray_of(c_emulator);
    cale_session_start(session, screen.data(), screen.size());
    for (std::size_t step = 0; step < rewards.size(); ++step) {
        const auto played = policy.act(observer.observation());
        ASSERT_EQ(played.event, events[step]) << step;
        ASSERT_EQ(static_cast<float>(play_step(emulator, observer, played, rgb_of)), rewards[step]) << step;

        cale_decision c_decision;
        ASSERT_EQ(cale_session_act(session, CALE_GREEDY, &c_decision), 1);
        ASSERT_EQ(c_decision.event, static_cast<int>(events[step])) << step;
        int reward = 0;
        do {
            const int lives = c_emulator.lives();
            reward += c_emulator.act(static_cast<Event>(c_decision.event), c_decision.strength);
            screen = gray_of(c_emulator);
            cale_session_see(session, screen.data(), screen.size());
            if (c_emulator.lives() < lives) cale_session_lose_life(session);
        } while (cale_session_due(session) == 0 && !c_emulator.game_over());
        ASSERT_EQ(static_cast<float>(reward), rewards[step]) << step;
    }
    cale_session_free(session);
    cale_policy_free(c_policy);
}

INSTANTIATE_TEST_SUITE_P(Games, RawFramesEmulator,
                         testing::Values(Protocol{"breakout", true}, Protocol{"ms_pacman", false},
                                         Protocol{"seaquest", true}),
                         [](const auto& protocol) {
                             return std::string(protocol.param.game) +
                                    (protocol.param.atari100k ? "100k" : "200m");
                         });

TEST(PaletteEmulator, LuminanceIsThatOfEveryColour) {
    const Emulator emulator(find_game("pong"), find_rom("pong", ""), 0, 0);
    for (std::size_t i = 0; i < 256; i += 2) {
        const auto& [red, green, blue] = emulator.rgb_palette()[i];
        EXPECT_EQ(luminance(red, green, blue), emulator.gray_palette()[i]) << "colour " << i;
    }
}

}  // namespace
}  // namespace cale
