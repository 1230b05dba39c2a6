#include "agents/critic.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>
#include <torch/autograd.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agent_worlds.h"
#include "agents/random.h"

namespace cale {
namespace {

constexpr auto kDouble = torch::kFloat64;

// Distributions -----------------------------------------------------------------------

TEST(AtomSupport, SpreadsTheAtomsEvenly) {
    EXPECT_TRUE(
        torch::equal(atom_support(5, 10, kDouble), torch::tensor({-10.0, -5.0, 0.0, 5.0, 10.0}, kDouble)));
}

/// All of the probability on one return.
torch::Tensor projected(double value) {
    const auto support = torch::tensor({-1.0, 0.0, 1.0}, kDouble);
    return project_distribution(torch::full({1, 3}, value, kDouble),
                                torch::tensor({{0.5, 0.25, 0.25}}, kDouble), support);
}

TEST(ProjectDistribution, AReturnIsSharedByTheAtomsBesideIt) {
    EXPECT_TRUE(torch::allclose(projected(0.25), torch::tensor({{0.0, 0.75, 0.25}}, kDouble)));
    EXPECT_TRUE(torch::allclose(projected(-0.5), torch::tensor({{0.5, 0.5, 0.0}}, kDouble)));
    EXPECT_TRUE(torch::allclose(projected(0), torch::tensor({{0.0, 1.0, 0.0}}, kDouble)));
}

TEST(ProjectDistribution, WhatLiesOutsideCountsForTheAtomAtTheEnd) {
    EXPECT_TRUE(torch::allclose(projected(7), torch::tensor({{0.0, 0.0, 1.0}}, kDouble)));
    EXPECT_TRUE(torch::allclose(projected(-1.25), torch::tensor({{1.0, 0.0, 0.0}}, kDouble)));
}

TEST(ProjectDistribution, EachReturnKeepsItsProbability) {
    // -0.5, 0.25 and 3 with probabilities 1/2, 1/4 and 1/4, in the second row of a batch.
    const auto returns = torch::tensor({{0.0, 0.0, 0.0}, {-0.5, 0.25, 3.0}}, kDouble);
    const auto probabilities = torch::tensor({{1.0, 0.0, 0.0}, {0.5, 0.25, 0.25}}, kDouble);
    const auto expected =
        torch::tensor({{0.0, 1.0, 0.0}, {0.25, 0.25 + 0.75 * 0.25, 0.25 * 0.25 + 0.25}}, kDouble);
    EXPECT_TRUE(torch::allclose(
        project_distribution(returns, probabilities, torch::tensor({-1.0, 0.0, 1.0}, kDouble)), expected));
}

TEST(ProjectDistribution, ConservesMassAndWithinTheSupportTheMean) {
    const auto support = atom_support(51, 10, torch::kFloat32);
    const auto probabilities = torch::randn({64, 51}, make_generator(1)).softmax(1);
    const auto narrow = 0.3 * torch::randn({64, 1}, make_generator(2)) + 0.9 * support;
    const auto wide = 3 * narrow;
    for (const auto& returns : {narrow, wide}) {
        const auto mass = project_distribution(returns, probabilities, support).sum(1);
        EXPECT_TRUE(torch::allclose(mass, torch::ones({64}), 1e-5, 1e-5));
    }
    const auto kept = project_distribution(narrow, probabilities, support);
    EXPECT_TRUE(torch::allclose((kept * support).sum(1), (narrow * probabilities).sum(1), 1e-4, 1e-4));
}

// Targets -----------------------------------------------------------------------------

/// Two transitions that do not end an episode, and one that does.
Batch transitions() {
    Batch batch;
    batch.n_step_return = torch::tensor({0.5F, -1.0F, 1.0F});
    batch.discount = torch::tensor({0.5F, 0.25F, 0.0F});
    return batch;
}

torch::Tensor bonus() {
    return torch::tensor({1.0, -2.0, 3.0}, kDouble);
}

torch::Tensor logits_of(const torch::Tensor& probabilities) {
    return probabilities.log();
}

torch::Tensor support() {
    return torch::tensor({-2.0, 0.0, 2.0}, kDouble);
}

TEST(CriticTargets, OfTheMeanAreTheBootstrappedValue) {
    const TwinValues outputs{torch::tensor({{3.0}, {6.0}, {4.0}}, kDouble),
                             torch::tensor({{5.0}, {2.0}, {2.0}}, kDouble)};
    const auto targets = critic_targets(outputs, {}, TwinEstimate::minimum, bonus(), transitions(), 10);
    EXPECT_TRUE(torch::equal(targets.values,
                             torch::tensor({5 + 0.5 * (3 + 1), -10 + 0.25 * (2 - 2), 10.0}, kDouble)));
    EXPECT_FALSE(targets.distribution.defined());
    const auto mean = critic_targets(outputs, {}, TwinEstimate::mean, bonus(), transitions(), 10);
    EXPECT_TRUE(
        torch::equal(mean.values, torch::tensor({5 + 0.5 * (4 + 1), -10 + 0.25 * (4 - 2), 10.0}, kDouble)));
}

TEST(CriticTargets, TheDistributionOfTheSmallerMeanIsMovedByRewardAndBonus) {
    // Means 0.5 and -1, then -0.5 and 2.
    const TwinValues outputs{
        logits_of(torch::tensor({{0.25, 0.25, 0.5}, {0.5, 0.25, 0.25}, {0.0, 1.0, 0.0}}, kDouble)),
        logits_of(torch::tensor({{0.5, 0.5, 0.0}, {0.0, 0.0, 1.0}, {0.0, 0.0, 1.0}}, kDouble))};
    const auto targets = critic_targets(outputs, support(), TwinEstimate::minimum, bonus(), transitions(), 1);
    // First half of it at 0.5 + 0.5 (-2 + 1) = 0 and half at 0.5 + 0.5 (0 + 1) = 1. Then half at
    // -1 + 0.25 (-2 - 2) = -2 and a quarter each at -1 + 0.25 (0 - 2) = -1.5 and -1 + 0.25 (2 - 2) = -1.
    // Behind an end all of it at 1.
    EXPECT_TRUE(torch::allclose(
        targets.distribution, torch::tensor({{0.0, 0.75, 0.25},
                                             {0.5 + 0.25 * 0.75 + 0.25 * 0.5, 0.25 * 0.25 + 0.25 * 0.5, 0.0},
                                             {0.0, 0.5, 0.5}},
                                            kDouble)));
    EXPECT_TRUE(torch::allclose(targets.values,
                                torch::tensor({0.5 + 0.5 * (-1 + 1), -1 + 0.25 * (-0.5 - 2), 1.0}, kDouble)));
    EXPECT_TRUE(torch::allclose(targets.distribution.matmul(support()), targets.values));
}

TEST(CriticTargets, TwoDistributionsMayBeMixed) {
    const TwinValues outputs{logits_of(torch::tensor({{0.0, 0.5, 0.5}, {1.0, 0.0, 0.0}}, kDouble)),
                             logits_of(torch::tensor({{0.5, 0.5, 0.0}, {1.0, 0.0, 0.0}}, kDouble))};
    Batch batch;
    batch.n_step_return = torch::zeros({2});
    batch.discount = torch::ones({2});
    const auto targets =
        critic_targets(outputs, support(), TwinEstimate::mean, torch::zeros({2}, kDouble), batch, 1);
    EXPECT_TRUE(
        torch::allclose(targets.distribution, torch::tensor({{0.25, 0.5, 0.25}, {1.0, 0.0, 0.0}}, kDouble)));
}

// Losses ------------------------------------------------------------------------------

TEST(CriticLoss, OfTheMeanIsTheSumOfBothSquaredErrors) {
    const TwinValues outputs{torch::tensor({{1.0}, {2.0}}, kDouble), torch::tensor({{3.0}, {2.0}}, kDouble)};
    const auto loss = critic_loss(outputs, {}, {torch::tensor({1.0, 0.0}, kDouble), {}});
    EXPECT_DOUBLE_EQ(loss.item<double>(), ((0 + 4) + (4 + 4)) / 2.0);
}

TEST(CriticLoss, OfADistributionIsLeastWhereACriticSaysTheTarget) {
    const auto target = torch::tensor({{0.1, 0.2, 0.7}, {0.3, 0.3, 0.4}}, kDouble);
    const CriticTargets targets{torch::zeros({2}, kDouble), target};
    auto q1 = logits_of(target).requires_grad_(), q2 = torch::zeros({2, 3}, kDouble).requires_grad_();
    const auto loss = critic_loss({q1, q2}, support(), targets);
    const auto gradients = torch::autograd::grad({loss}, {q1, q2});
    EXPECT_TRUE(torch::allclose(gradients[0], torch::zeros({2, 3}, kDouble)));
    EXPECT_TRUE(torch::allclose(gradients[1], (torch::full({2, 3}, 1.0 / 3, kDouble) - target) / 2));
    const auto entropy = -(target * target.log()).sum(1).mean();
    EXPECT_NEAR(loss.item<double>(), entropy.item<double>() + std::log(3.0), 1e-12);
}

// The network -------------------------------------------------------------------------

TEST(SacNetwork, ItsCriticsHaveAnOutputForEveryAtom) {
    const CriticSettings settings{.atoms = 5, .limit = 4};
    SacNetwork network(small_encoder(), HeadConfig{1, 16}, make_generator(1), joystick_box(),
                       settings.support());
    const torch::NoGradGuard no_grad;
    const auto z = network->encoder->critic_branch(network->encoder->trunk(noise_frames(3, 1)));
    const auto action = torch::zeros({3, 3});
    const auto outputs = network->outputs(z, action);
    EXPECT_EQ(outputs.q2.sizes(), (std::vector<std::int64_t>{3, 5}));
    const auto values = network->values(z, action);
    const auto atoms = torch::tensor({-4.0F, -2.0F, 0.0F, 2.0F, 4.0F});
    EXPECT_TRUE(torch::allclose(values.q1, (outputs.q1.softmax(1) * atoms).sum(1)));
    EXPECT_TRUE(torch::allclose(values.q2, (outputs.q2.softmax(1) * atoms).sum(1)));
}

TEST(SacLosses, OfDistributionsAreThoseOfTheTargetsBestAction) {
    auto config = small_sac();
    config.critic = {.target = CriticTarget::target_mean_action, .atoms = 21, .limit = 3};
    const auto spec = joystick_world();
    auto network = make_network(config, spec, make_generator(1)),
         target = make_network(config, spec, make_generator(2));
    auto random = make_generator(3);
    Batch batch;
    batch.observation = noise_frames(4, 1);
    batch.next_observation = noise_frames(4, 2);
    batch.action = torch::rand({4, 3}, random);
    batch.n_step_return = torch::randn({4}, random);
    batch.discount = torch::tensor({0.9F, 0.0F, 0.9F, 0.5F});
    const SacNoise noise{torch::randn({4, 3}, random), torch::randn({4, 3}, random)};
    const auto log_alpha = torch::full({1}, -1.0F);
    const auto losses = sac_losses(network, target, log_alpha, batch, noise, config);

    const torch::NoGradGuard no_grad;
    const auto features = target->encoder->trunk(batch.next_observation);
    const auto policy = target->policy(features);
    const auto next =
        target->outputs(target->encoder->critic_branch(features), mean_action(policy, target->box));
    const auto bonus = -log_alpha.exp() * sample(policy, noise.target, target->box).log_prob;
    const auto targets = critic_targets(next, target->support, TwinEstimate::minimum, bonus, batch,
                                        config.replay.reward_scale);
    const auto z = network->encoder->critic_branch(network->encoder->trunk(batch.observation));
    const auto outputs = network->outputs(z, batch.action);
    EXPECT_EQ(outputs.q1.size(1), 21);
    EXPECT_TRUE(torch::allclose(losses.critic, critic_loss(outputs, network->support, targets)));
    EXPECT_TRUE(torch::allclose(losses.q2, critic_values(outputs, network->support).q2));
    EXPECT_TRUE(torch::allclose(losses.target_values, targets.values));
}

TEST(Sac, LearnsWithDistributionsToPushTheJoystickWhereTheFrameSays) {
    auto config = small_sac();
    config.network.hidden_units = 64;
    config.replay = {.min_replay = 200, .update_period = 8, .replay_capacity = 20'000, .batch_size = 32};
    config.replay.reward_scale = 10;  // so that the reward outweighs the entropy from the start
    config.critic = {.atoms = 21, .limit = 100};
    config.learning_rate = 1e-3;
    config.tau = 0.02;
    const auto spec = joystick_world(8);
    EXPECT_EQ(make_sac(config, spec)->state().at("network/critic.q2.out.weight").size(0), 21);
    EXPECT_GT(learned_after(*make_sac(config, spec), spec, 600), kSacLearned);
}

}  // namespace
}  // namespace cale
