// The corrected rule, and at the end Dopamine's, on cases worked by hand: gamma 0.5, stacks of 3, rewards
// that are powers of two, so that every figure is exact.
#include <gtest/gtest.h>

#include "numbered_frames.h"
#include "replay/accumulator.h"

namespace cale {
namespace {

using Transitions = std::vector<NumberedTransition>;

ReplayBuffer replay_of(std::int64_t horizon, std::int64_t num_envs = 1) {
    ReplayConfig config = numbered_config();
    config.update_horizon = horizon;
    config.num_envs = num_envs;
    return ReplayBuffer(config);
}

TEST(Accumulation, SumsDiscountedRewards) {
    const std::vector<StoredStep> steps{{0, 1}, {1, 10}, {2, 100}};
    EXPECT_DOUBLE_EQ(n_step_return(steps, 0.5), 1 + 5 + 25);
    EXPECT_DOUBLE_EQ(n_step_return(std::span(steps).first(1), 0.5), 1);
    EXPECT_DOUBLE_EQ(n_step_return({}, 0.5), 0);
}

TEST(Accumulation, OneStepReturnsUpToATerminal) {
    ReplayBuffer replay = replay_of(1);
    add(replay, {.frame = 1, .reward = 1, .action = 11});
    EXPECT_EQ(replay.size(), 0);  // its next observation is not known yet
    add(replay, {.frame = 2, .reward = 2, .action = 12});
    EXPECT_EQ(replay.size(), 1);
    add(replay, {.frame = 3, .reward = 4, .terminal = true, .action = 13});
    EXPECT_EQ(read_all(replay), (Transitions{{{0, 0, 1}, 11, 1, 0.5, {0, 1, 2}},
                                             {{0, 1, 2}, 12, 2, 0.5, {1, 2, 3}},
                                             {{1, 2, 3}, 13, 4, 0, {1, 2, 3}}}));
    EXPECT_EQ(replay.add_count(), 3);
}

TEST(Accumulation, OneStepReturnsUpToATruncation) {
    ReplayBuffer replay = replay_of(1);
    add(replay, {.frame = 1, .reward = 1, .action = 11});
    add(replay, {.frame = 2, .reward = 2, .truncated = true, .final_frame = 9, .action = 12});
    EXPECT_EQ(read_all(replay),
              (Transitions{{{0, 0, 1}, 11, 1, 0.5, {0, 1, 2}}, {{0, 1, 2}, 12, 2, 0.5, {1, 2, 9}}}));
}

TEST(Accumulation, ThreeStepReturnsUpToATerminal) {
    ReplayBuffer replay = replay_of(3);
    for (std::uint32_t t = 1; t <= 4; ++t)
        add(replay, {.frame = t, .reward = static_cast<float>(8 << t), .action = t});
    add(replay, {.frame = 5, .reward = 256, .terminal = true, .action = 5});
    // Rewards 16, 32, 64, 128, 256.
    EXPECT_EQ(read_all(replay), (Transitions{{{0, 0, 1}, 1, 16 + 16 + 16, 0.125, {2, 3, 4}},
                                             {{0, 1, 2}, 2, 32 + 32 + 32, 0.125, {3, 4, 5}},
                                             {{1, 2, 3}, 3, 64 + 64 + 64, 0, {3, 4, 5}},
                                             {{2, 3, 4}, 4, 128 + 128, 0, {3, 4, 5}},
                                             {{3, 4, 5}, 5, 256, 0, {3, 4, 5}}}));
}

TEST(Accumulation, ThreeStepReturnsUpToATruncation) {
    ReplayBuffer replay = replay_of(3);
    for (std::uint32_t t = 1; t <= 4; ++t)
        add(replay, {.frame = t, .reward = static_cast<float>(8 << t), .action = t});
    add(replay, {.frame = 5, .reward = 256, .truncated = true, .final_frame = 6, .action = 5});
    EXPECT_EQ(read_all(replay), (Transitions{{{0, 0, 1}, 1, 16 + 16 + 16, 0.125, {2, 3, 4}},
                                             {{0, 1, 2}, 2, 32 + 32 + 32, 0.125, {3, 4, 5}},
                                             {{1, 2, 3}, 3, 64 + 64 + 64, 0.125, {4, 5, 6}},
                                             {{2, 3, 4}, 4, 128 + 128, 0.25, {4, 5, 6}},
                                             {{3, 4, 5}, 5, 256, 0.5, {4, 5, 6}}}));
}

TEST(Accumulation, EpisodesShorterThanTheHorizon) {
    ReplayBuffer replay = replay_of(3);
    add(replay, {.frame = 1, .reward = 1, .terminal = true, .action = 1});
    add(replay, {.frame = 2, .reward = 2, .truncated = true, .final_frame = 3, .action = 2});
    add(replay, {.frame = 4, .reward = 4, .action = 4});
    add(replay, {.frame = 5, .reward = 8, .terminal = true, .action = 5});
    EXPECT_EQ(read_all(replay), (Transitions{{{0, 0, 1}, 1, 1, 0, {0, 0, 1}},
                                             {{0, 0, 2}, 2, 2, 0.5, {0, 2, 3}},
                                             {{0, 0, 4}, 4, 4 + 4, 0, {0, 4, 5}},
                                             {{0, 4, 5}, 5, 8, 0, {0, 4, 5}}}));
}

// A lost life ends the agent's episode; the game goes on and the next step starts anew.
TEST(Accumulation, StacksDoNotCrossTheBorderOfALife) {
    ReplayBuffer replay = replay_of(1);
    add(replay, {.frame = 1});
    add(replay, {.frame = 2, .terminal = true});
    add(replay, {.frame = 3});
    add(replay, {.frame = 4});
    const auto found = read_all(replay);
    ASSERT_EQ(found.size(), 3u);
    EXPECT_EQ(found[2].observation, (std::vector<std::uint32_t>{0, 0, 3}));
    EXPECT_EQ(found[2].next_observation, (std::vector<std::uint32_t>{0, 3, 4}));
}

TEST(Accumulation, ATerminalOutweighsATruncation) {
    ReplayBuffer replay = replay_of(1);
    add(replay, {.frame = 1, .reward = 1, .terminal = true, .truncated = true});
    EXPECT_EQ(read_all(replay), (Transitions{{{0, 0, 1}, 0, 1, 0, {0, 0, 1}}}));
}

TEST(Accumulation, EnvironmentsDoNotMix) {
    ReplayBuffer replay = replay_of(2, 2);
    add(replay, {.frame = 1, .reward = 1, .action = 1}, 0);
    add(replay, {.frame = 101, .reward = 100, .action = 101}, 1);
    add(replay, {.frame = 2, .reward = 2, .action = 2}, 0);
    add(replay, {.frame = 102, .reward = 200, .terminal = true, .action = 102}, 1);
    add(replay, {.frame = 3, .reward = 4, .action = 3}, 0);
    add(replay, {.frame = 103, .reward = 400, .action = 103}, 1);
    EXPECT_EQ(read_all(replay), (Transitions{{{0, 0, 101}, 101, 200, 0, {0, 101, 102}},
                                             {{0, 101, 102}, 102, 200, 0, {0, 101, 102}},
                                             {{0, 0, 1}, 1, 2, 0.25, {1, 2, 3}}}));
}

TEST(Accumulation, ATruncationNeedsItsFinalFrame) {
    ReplayBuffer replay = replay_of(1);
    EXPECT_THROW(add(replay, {.frame = 1, .truncated = true}), std::invalid_argument);
    add(replay, {.frame = 1});  // the refused step has left nothing behind
    add(replay, {.frame = 2});
    EXPECT_EQ(read_all(replay), (Transitions{{{0, 0, 1}, 0, 0, 0.5, {0, 1, 2}}}));
}

/// The returns of the transitions that end the episode, of eight steps with a stack of 4 and rewards 1, 10,
/// ..., 10^7.
TEST(Accumulation, DopaminesThreeStepReturnsAtATerminal) {
    ReplayConfig config = numbered_config();
    config.observation.stack = 4;
    config.update_horizon = 3;
    config.replay_terminal = ReplayTerminal::dopamine;
    ReplayBuffer replay(config);
    float reward = 1;
    for (std::uint32_t t = 1; t <= 8; ++t, reward *= 10)
        add(replay, {.frame = t, .reward = reward, .terminal = t == 8, .action = t});
    std::vector<float> returns;
    for (const auto& transition : read_all(replay))
        if (transition.discount == 0) returns.push_back(transition.n_step_return);
    EXPECT_EQ(returns, (std::vector<float>{310'000, 310'000, 310'000, 310'000, 3'100'000, 6'000'000}));
}

}  // namespace
}  // namespace cale
