#include "replay/rollout.h"

#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr std::int64_t kStack = 3;

/// Three steps of two environments whose frames are of two pixels.
RolloutConfig small_config() {
    return {.length = 3, .num_envs = 2, .observation = {kStack, {1, 2}}, .action_size = 3};
}

/// Stacks that tell from their pixels which step, environment and frame they are: 40 t + 10 env + frame.
torch::Tensor observations(std::int64_t step) {
    auto made = torch::empty({2, kStack, 1, 2}, torch::kUInt8);
    for (std::int64_t env = 0; env < 2; ++env)
        for (std::int64_t frame = 0; frame < kStack; ++frame) made[env][frame] = 40 * step + 10 * env + frame;
    return made;
}

torch::Tensor actions(std::int64_t step) {
    return torch::full({2, 3}, static_cast<double>(step)) + torch::tensor({{0.25f}, {0.5f}});
}

const std::vector<std::uint8_t> kFinalFrames{201, 202, 211, 212};

void add(Rollout& rollout, const std::vector<StepResult>& results) {
    rollout.set_observations(observations(rollout.steps));
    rollout.add(actions(rollout.steps), results, kFinalFrames);
}

std::vector<StepResult> rewards(float first, float second) {
    return {{.reward = first}, {.reward = second}};
}

Rollout filled() {
    Rollout rollout(small_config());
    for (int step = 0; step < 3; ++step) add(rollout, rewards(1, 2));
    return rollout;
}

TEST(Rollout, KeepsItsStepsInOrder) {
    Rollout rollout(small_config());
    for (int step = 0; step < 3; ++step) {
        EXPECT_FALSE(rollout.full());
        EXPECT_EQ(rollout.steps, step);
        add(rollout, rewards(static_cast<float>(step), -1));
    }
    EXPECT_TRUE(rollout.full());
    for (std::int64_t step = 0; step < 3; ++step) {
        EXPECT_TRUE(torch::equal(rollout.observation[step], observations(step)));
        EXPECT_TRUE(torch::equal(rollout.action[step], actions(step)));
        EXPECT_TRUE(torch::equal(rollout.reward[step], torch::tensor({static_cast<float>(step), -1.0f})));
    }
    EXPECT_TRUE(torch::equal(rollout.terminal, torch::zeros({3, 2})));
    EXPECT_TRUE(rollout.truncations.empty());
}

TEST(Rollout, DiscreteActionsAreNumbers) {
    auto config = small_config();
    config.action_size = 0;
    Rollout rollout(config);
    rollout.set_observations(observations(0));
    rollout.add(torch::tensor({3, 17}, torch::kInt64), rewards(0, 0), kFinalFrames);
    EXPECT_TRUE(torch::equal(rollout.action[0], torch::tensor({3, 17}, torch::kInt64)));
}

TEST(Rollout, ObservationsAreBytes) {
    Rollout rollout(small_config());
    EXPECT_THROW(rollout.set_observations(observations(0).to(torch::kFloat32)), std::invalid_argument);
}

TEST(Rollout, AFullOneTakesNothingMoreUntilItIsCleared) {
    auto rollout = filled();
    EXPECT_THROW(rollout.set_observations(observations(0)), std::logic_error);
    EXPECT_THROW(rollout.add(actions(0), rewards(0, 0), kFinalFrames), std::logic_error);
    rollout.clear();
    EXPECT_FALSE(rollout.full());
    EXPECT_EQ(rollout.steps, 0);
    add(rollout, rewards(7, 8));
    EXPECT_TRUE(torch::equal(rollout.reward[0], torch::tensor({7.0f, 8.0f})));
    EXPECT_EQ(rollout.steps, 1);
}

TEST(Rollout, RewardsAreClippedAndThenScaled) {
    auto config = small_config();
    config.reward_scale = 0.5;
    Rollout scaled(config);
    add(scaled, rewards(10, -6));
    EXPECT_TRUE(torch::equal(scaled.reward[0], torch::tensor({5.0f, -3.0f})));
    config.reward_clip = 4;
    Rollout clipped(config);
    add(clipped, rewards(10, -6));
    EXPECT_TRUE(torch::equal(clipped.reward[0], torch::tensor({2.0f, -2.0f})));
    add(clipped, rewards(3, 0));
    EXPECT_TRUE(torch::equal(clipped.reward[1], torch::tensor({1.5f, 0.0f})));
}

TEST(Rollout, ATruncationKeepsTheObservationThatItWasLeftWith) {
    Rollout rollout(small_config());
    add(rollout, {{.terminal = true}, {}});
    add(rollout, {{}, {.truncated = true}});
    EXPECT_TRUE(torch::equal(rollout.terminal.slice(0, 0, 2), torch::tensor({{1.0f, 0.0f}, {0.0f, 1.0f}})));
    ASSERT_EQ(rollout.truncations.size(), 1u);
    const auto& cut = rollout.truncations[0];
    EXPECT_EQ(cut.step, 1);
    EXPECT_EQ(cut.env, 1);
    // The two newest frames of the stack and the final one of the second environment.
    auto left_with = torch::empty({kStack, 1, 2}, torch::kUInt8);
    left_with[0] = 51;
    left_with[1] = 52;
    left_with[2][0][0] = 211;
    left_with[2][0][1] = 212;
    EXPECT_TRUE(torch::equal(cut.observation, left_with));
    rollout.clear();
    EXPECT_TRUE(rollout.truncations.empty());
}

TEST(Rollout, ATerminalOutweighsATruncation) {
    Rollout rollout(small_config());
    add(rollout, {{.terminal = true, .truncated = true}, {}});
    EXPECT_EQ(rollout.terminal[0][0].item<float>(), 1);
    EXPECT_TRUE(rollout.truncations.empty());
}

TEST(Rollout, ATruncationNeedsItsFinalFrame) {
    Rollout rollout(small_config());
    rollout.set_observations(observations(0));
    const std::vector<StepResult> cut{{}, {.truncated = true}};
    for (const std::size_t given : {0u, 2u}) {  // none, and the first environment's
        const std::span<const std::uint8_t> frames(kFinalFrames.data(), given);
        EXPECT_THAT([&] { rollout.add(actions(0), cut, frames); },
                    ThrowsMessage<std::invalid_argument>(HasSubstr("final frame")));
    }
    EXPECT_NO_THROW(rollout.add(actions(0), rewards(0, 0), {}));  // where nothing is cut off it needs none
}

/// Two steps, the second of which cuts the first environment off.
Rollout cut_off() {
    Rollout rollout(small_config());
    add(rollout, rewards(1, 2));
    auto results = rewards(3, 4);
    results[0].truncated = results[0].episode_over = true;
    add(rollout, results);
    return rollout;
}

TEST(Rollout, ContinuesFromItsState) {
    auto from = cut_off();
    auto to = filled();
    to.restore(from.state());
    for (auto* rollout : {&from, &to}) {
        ASSERT_EQ(rollout->steps, 2);
        add(*rollout, rewards(5, 6));
    }
    EXPECT_TRUE(torch::equal(to.observation, from.observation));
    EXPECT_TRUE(torch::equal(to.action, from.action));
    EXPECT_TRUE(torch::equal(to.reward, from.reward));
    EXPECT_TRUE(torch::equal(to.terminal, from.terminal));
    ASSERT_EQ(to.truncations.size(), 1U);
    EXPECT_EQ(to.truncations[0].step, 1);
    EXPECT_EQ(to.truncations[0].env, 0);
    EXPECT_TRUE(torch::equal(to.truncations[0].observation, from.truncations[0].observation));
}

TEST(Rollout, RefusesAStateThatDoesNotFitAndStaysAsItIs) {
    auto shorter = small_config();
    shorter.length = 1;
    Rollout rollout(shorter);
    EXPECT_THAT([&] { rollout.restore(cut_off().state()); },
                ThrowsMessage<std::runtime_error>(HasSubstr("longer than agent.rollout_steps")));
    EXPECT_EQ(rollout.steps, 0);

    auto other = filled();
    auto state = cut_off().state();
    state.at("truncation_at")[0][0] = 2;
    EXPECT_THAT([&] { other.restore(state); },
                ThrowsMessage<std::runtime_error>(HasSubstr("cut off where it has no step")));
    EXPECT_EQ(other.steps, 3);
    EXPECT_TRUE(torch::equal(other.reward, filled().reward));
}

TEST(Rollout, RefusesRewardsThatAreNoNumbers) {
    Rollout rollout(small_config());
    for (const float reward :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        EXPECT_THAT([&] { add(rollout, rewards(0, reward)); },
                    ThrowsMessage<std::invalid_argument>(HasSubstr("the reward of environment 1 is")));
        EXPECT_EQ(rollout.steps, 0);
    }
    // The first environment's truncation is not remembered without the second's reward.
    auto cut = rewards(0, std::numeric_limits<float>::quiet_NaN());
    cut[0].truncated = true;
    EXPECT_THROW(add(rollout, cut), std::invalid_argument);
    EXPECT_TRUE(rollout.truncations.empty());
}

TEST(Rollout, RefusesOtherCounts) {
    Rollout rollout(small_config());
    const auto names = [](const char* expected, const char* given) {
        return ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr(expected), HasSubstr(given)));
    };
    EXPECT_THAT([&] { rollout.add(actions(0), std::vector<StepResult>(3), kFinalFrames); },
                names("2 environments", "3"));
    EXPECT_THAT([&] { rollout.add(actions(0).slice(0, 0, 1), rewards(0, 0), kFinalFrames); },
                names("[2, 3]", "[1, 3]"));
    EXPECT_THAT([&] { rollout.add(actions(0).slice(1, 0, 1), rewards(0, 0), kFinalFrames); },
                names("[2, 3]", "[2, 1]"));
    // One observation would be taken for both environments'.
    EXPECT_THAT([&] { rollout.set_observations(observations(0).slice(0, 0, 1)); },
                names("[2, 3, 1, 2]", "[1, 3, 1, 2]"));
    EXPECT_THAT([&] { rollout.set_observations(observations(0)[0]); }, names("[2, 3, 1, 2]", "[3, 1, 2]"));
    EXPECT_EQ(rollout.steps, 0);
}

}  // namespace
}  // namespace cale
