#include "networks/ppo_network.h"

#include <cmath>
#include <numbers>
#include <string>

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/types.h>

namespace cale {
namespace {

at::Generator generator(std::uint64_t seed = 1) {
    return at::detail::createCPUGenerator(seed);
}

torch::Tensor frames(std::int64_t batch = 3) {
    return torch::randint(0, 256, {batch, 2, 40, 40}, generator(5), torch::kUInt8);
}

PpoNetwork make(Torso torso, std::int64_t num_actions, EncoderKind encoder = EncoderKind::phi_dqn) {
    return PpoNetwork(
        PpoNetworkConfig{.encoder = {.encoder = encoder, .observation = {2, 40, 40}}, .torso = torso},
        num_actions, generator());
}

TEST(PpoNetwork, APolicyAndAValueFromEveryTorso) {
    for (const auto torso : {Torso::two_branch, Torso::shared}) {
        for (const auto encoder :
             {EncoderKind::phi_sac, EncoderKind::phi_dqn, EncoderKind::impala, EncoderKind::mlp}) {
            auto joystick = make(torso, 0, encoder);
            const auto [gaussian, value] = joystick(frames());
            ASSERT_TRUE(gaussian.gaussian);
            EXPECT_EQ(gaussian.gaussian->mean.sizes(), (std::vector<std::int64_t>{3, 3}));
            EXPECT_FALSE(gaussian.log_pi.defined());
            EXPECT_EQ(value.sizes(), (std::vector<std::int64_t>{3}));

            auto discrete = make(torso, 4, encoder);
            const auto categorical = discrete(frames()).policy;
            ASSERT_FALSE(categorical.gaussian);
            EXPECT_EQ(categorical.log_pi.sizes(), (std::vector<std::int64_t>{3, 4}));
            EXPECT_TRUE(torch::allclose(categorical.log_pi.exp().sum(1), torch::ones({3})));
        }
    }
}

TEST(PpoNetwork, OnlyASharedTorsoIsTrainedByThePolicy) {
    for (const auto torso : {Torso::two_branch, Torso::shared}) {
        auto network = make(torso, 4);
        network(frames()).policy.log_pi.select(1, 0).sum().backward();
        EXPECT_EQ(network->named_parameters()["encoder.conv1.weight"].grad().defined(),
                  torso == Torso::shared);
        network(frames()).value.sum().backward();
        for (const auto& parameter : network->named_parameters())
            EXPECT_TRUE(parameter.value().grad().defined()) << parameter.key();
    }
}

TEST(PpoNetwork, ASharedTorsoIsThatOfMnihEtAl) {
    const PpoNetwork network(
        PpoNetworkConfig{.encoder = {.encoder = EncoderKind::phi_dqn}, .torso = Torso::shared}, 18,
        generator());
    EXPECT_EQ(network->named_parameters()["encoder.fc.weight"].sizes(),
              (std::vector<std::int64_t>{512, 7 * 7 * 64}));
    // Orthogonal of gain sqrt 2: the squares of a row sum to 2.
    const auto rows = network->named_parameters()["encoder.conv1.weight"].flatten(1).square().sum(1);
    EXPECT_TRUE(torch::allclose(rows, torch::full_like(rows, 2), 1e-4));
}

TEST(PpoNetwork, HeadsStartWithTheGainsOfTheReference) {
    const auto gain = [](const PpoNetwork& network, const char* layer) {
        return network->named_parameters()[layer]
            .norm(2, 1)
            .mean()
            .item<double>();  // of rows, at most as many as columns
    };
    const auto joystick = make(Torso::two_branch, 0), discrete = make(Torso::two_branch, 4);
    EXPECT_NEAR(gain(joystick, "actor.mean.weight"), 0.1, 1e-4);
    EXPECT_NEAR(gain(discrete, "actor.out.weight"), 0.01, 1e-5);
    EXPECT_NEAR(gain(joystick, "critic.out.weight"), 1, 1e-4);
    EXPECT_NEAR(gain(joystick, "actor.fc2.weight"), std::numbers::sqrt2, 1e-4);
    EXPECT_NEAR(gain(joystick, "critic.fc1.weight"), std::numbers::sqrt2, 1e-4);
}

TEST(PpoPolicy, EntropyOfAGaussianIsThatBeforeItIsSquashed) {
    const auto log_std = torch::tensor({{0.0f, 1.0f, -2.0f}, {0.0f, 0.0f, 0.0f}});
    const auto found = entropy(PpoPolicy{SquashedGaussian{torch::randn({2, 3}), log_std}, {}});
    const auto one = static_cast<float>(0.5 * std::log(2 * std::numbers::pi * std::numbers::e));
    EXPECT_TRUE(torch::allclose(found, torch::tensor({3 * one - 1, 3 * one})));
}

TEST(PpoPolicy, LogProbabilityAndEntropyOfActions) {
    const PpoPolicy policy{std::nullopt,
                           torch::tensor({{0.5f, 0.25f, 0.25f}, {0.125f, 0.125f, 0.75f}}).log()};
    const auto chosen = log_prob(policy, torch::tensor({0, 2}, torch::kInt64), joystick_box());
    EXPECT_TRUE(torch::allclose(chosen.exp(), torch::tensor({0.5f, 0.75f})));
    const auto found = entropy(policy);
    EXPECT_NEAR(found[0].item<double>(), 1.5 * std::numbers::ln2, 1e-6);
    EXPECT_NEAR(found[1].item<double>(), 0.75 * std::numbers::ln2 - 0.75 * std::log(0.75), 1e-6);
}

TEST(PpoPolicy, LogDensityOfJoystickActionsIsThatOfTheirSample) {
    const SquashedGaussian gaussian{torch::randn({5, 3}, generator(1)), torch::full({5, 3}, -1.0f)};
    const auto box = joystick_box();
    const auto drawn = sample(gaussian, torch::randn({5, 3}, generator(2)), box);
    EXPECT_TRUE(
        torch::allclose(log_prob(PpoPolicy{gaussian, {}}, drawn.action, box), drawn.log_prob, 1e-3, 1e-3));
}

}  // namespace
}  // namespace cale
