// Rollouts by the rule of the reference's accumulator, worked out by hand.
#include <array>
#include <vector>

#include <gtest/gtest.h>
#include <torch/types.h>

#include "dopamine/rollout.h"

namespace cale {
namespace {

constexpr std::int64_t kStack = 4;

/// One episode of seven steps on frames of one pixel, 1 to 7, with rewards 10 to 70.
DopamineRollout seven_steps(std::int64_t length, bool cut_off = false) {
    DopamineRollout rollout({.length = length, .observation = {kStack, {1, 1}}, .action_size = 0});
    for (int step = 1; step <= 7; ++step) {
        rollout.set_observations(torch::full({1, kStack, 1, 1}, step, torch::kUInt8));
        StepResult result;
        result.reward = static_cast<float>(10 * step);
        (cut_off ? result.truncated : result.terminal) = result.episode_over = step == 7;
        const std::array<std::uint8_t, 1> none{};
        rollout.add(torch::tensor({step + 100}, torch::kInt64), {&result, 1}, none);
    }
    return rollout;
}

std::vector<std::vector<int>> states(const Rollout& rollout) {
    std::vector<std::vector<int>> rows;
    for (std::int64_t row = 0; row < rollout.config.length; ++row) {
        const auto pixels = rollout.observation[row].flatten();
        rows.emplace_back();
        for (std::int64_t i = 0; i < kStack; ++i) rows.back().push_back(pixels[i].item<int>());
    }
    return rows;
}

using States = std::vector<std::vector<int>>;

TEST(DopamineRollout, LosesTheLastRewardAndRepeatsTheStepBefore) {
    const auto rollout = seven_steps(9);
    ASSERT_TRUE(rollout.full());
    EXPECT_EQ(states(rollout), (States{{0, 0, 0, 1},
                                       {0, 0, 1, 2},
                                       {0, 1, 2, 3},
                                       {1, 2, 3, 4},
                                       {2, 3, 4, 5},
                                       {3, 4, 5, 6},
                                       {0, 4, 5, 6},
                                       {0, 0, 5, 6},
                                       {0, 0, 0, 6}}));
    const auto expected_rewards =
        torch::tensor({10.0f, 20.0f, 30.0f, 40.0f, 50.0f, 60.0f, 60.0f, 60.0f, 60.0f});
    EXPECT_TRUE(torch::equal(rollout.reward.flatten(), expected_rewards));
    EXPECT_TRUE(torch::equal(rollout.terminal.flatten(),
                             torch::tensor({0.f, 0.f, 0.f, 0.f, 0.f, 1.f, 1.f, 1.f, 1.f})));
    EXPECT_TRUE(torch::equal(rollout.action.flatten(),
                             torch::tensor({101, 102, 103, 104, 105, 106, 106, 106, 106}, torch::kInt64)));
    const auto next = rollout.next_observation.flatten();
    EXPECT_TRUE(torch::equal(next, torch::tensor({0, 0, 6, 7}, torch::kUInt8)));
}

TEST(DopamineRollout, WhatDoesNotFitComesToLieInFront) {
    EXPECT_EQ(states(seven_steps(8)), (States{{0, 0, 0, 6},
                                              {0, 0, 1, 2},
                                              {0, 1, 2, 3},
                                              {1, 2, 3, 4},
                                              {2, 3, 4, 5},
                                              {3, 4, 5, 6},
                                              {0, 4, 5, 6},
                                              {0, 0, 5, 6}}));
    EXPECT_EQ(states(seven_steps(7)), (States{{0, 0, 5, 6},
                                              {0, 0, 0, 6},
                                              {0, 1, 2, 3},
                                              {1, 2, 3, 4},
                                              {2, 3, 4, 5},
                                              {3, 4, 5, 6},
                                              {0, 4, 5, 6}}));
}

TEST(DopamineRollout, NoElementReachesOverACut) {
    auto rollout = seven_steps(20, /*cut_off=*/true);
    const auto steps = rollout.steps;
    rollout.set_observations(torch::zeros({1, kStack, 1, 1}, torch::kUInt8));
    const StepResult result;
    const std::array<std::uint8_t, 1> none{};
    rollout.add(torch::tensor({1}, torch::kInt64), {&result, 1}, none);
    EXPECT_EQ(rollout.steps, steps);
}

TEST(DopamineRollout, ElementsOfNoFrameAreRefused) {
    auto rollout = seven_steps(9);
    auto state = rollout.state();
    rollout.restore(state);
    state.at("element_frames")[3][0][kStack - 1] = kBlankFrame;
    EXPECT_THROW(rollout.restore(state), std::runtime_error);
}

TEST(DopamineRollout, StepsOfNoFrameAreRefused) {
    auto rollout = seven_steps(20);
    StepResult result;
    const std::array<std::uint8_t, 1> none{};
    rollout.set_observations(torch::zeros({1, kStack, 1, 1}, torch::kUInt8));
    rollout.add(torch::tensor({1}, torch::kInt64), {&result, 1}, none);
    auto state = rollout.state();
    ASSERT_GT(state.at("window_frames").numel(), 0) << "of the step that has no next one";
    rollout.restore(state);
    state.at("window_frames")[0] = kBlankFrame;
    EXPECT_THROW(rollout.restore(state), std::runtime_error);
}

TEST(DopamineRollout, IsForOneEnvironment) {
    EXPECT_THROW(DopamineRollout({.num_envs = 2}), std::invalid_argument);
}

TEST(DopamineRollout, ClearForgetsTheEpisodeUnderWay) {
    auto rollout = seven_steps(20);
    EXPECT_EQ(rollout.steps, 9);
    rollout.clear();
    EXPECT_EQ(rollout.steps, 0);
    StepResult result;
    const std::array<std::uint8_t, 1> none{};
    rollout.set_observations(torch::zeros({1, kStack, 1, 1}, torch::kUInt8));
    rollout.add(torch::tensor({1}, torch::kInt64), {&result, 1}, none);
    EXPECT_EQ(rollout.steps, 0) << "one step alone completes nothing";
}

}  // namespace
}  // namespace cale
