// bf16: convolutions and products of bfloat16 on parameters of float32.
#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "networks/actor_critic.h"
#include "networks/encoders.h"
#include "networks/ppo_network.h"
#include "networks/q_network.h"

namespace cale {
namespace {

at::Generator generator() {
    return at::detail::createCPUGenerator(1);
}

torch::Tensor frames() {
    return torch::randint(0, 256, {8, 2, 36, 36}, generator(), torch::kUInt8);
}

EncoderConfig encoder(EncoderKind kind, Precision precision) {
    return {.encoder = kind, .observation = {2, 36, 36}, .precision = precision, .layer_norm = true};
}

/// Makes a network and returns something to minimise: one number of the network's outputs, which must be
/// float32.
using Loss = std::function<torch::Tensor(Precision, std::vector<torch::Tensor>& parameters)>;

Loss of_sac(EncoderKind kind) {
    return [=](Precision precision, std::vector<torch::Tensor>& parameters) {
        SacNetwork network(encoder(kind, precision), HeadConfig{.hidden_units = 32, .layer_norm = true},
                           generator());
        parameters = network->parameters();
        const auto features = network->encoder->trunk(frames());
        const auto action = torch::rand({8, 3}, generator());
        const auto q = network->values(network->encoder->critic_branch(features), action);
        const auto policy = network->policy(features);
        EXPECT_EQ(q.q1.scalar_type(), torch::kFloat32);
        EXPECT_EQ(policy.mean.scalar_type(), torch::kFloat32);
        const auto noise = torch::randn({8, 3}, generator());
        return (q.q1 - 1).square().mean() + q.q2.square().mean() +
               sample(policy, noise, network->box).log_prob.mean();
    };
}

Loss of_values(EncoderKind kind, bool noisy) {
    return [=](Precision precision, std::vector<torch::Tensor>& parameters) {
        QNetwork network(encoder(kind, precision),
                         QHeadConfig{.num_actions = 18,
                                     .hidden_units = 32,
                                     .num_atoms = 11,
                                     .dueling = true,
                                     .noisy = noisy,
                                     .factors = {3, 3, 2},
                                     .layer_norm = true},
                         generator());
        parameters = network->parameters();
        const auto noise = network->head->draw_noise(generator());
        const auto values = network(frames(), noisy ? &noise : nullptr);
        EXPECT_EQ(values.scalar_type(), torch::kFloat32);
        return -values.log_softmax(2).select(1, 3).select(1, 4).mean();
    };
}

Loss of_ppo(Torso torso, std::int64_t num_actions) {
    return [=](Precision precision, std::vector<torch::Tensor>& parameters) {
        PpoNetwork network(
            PpoNetworkConfig{.encoder = encoder(EncoderKind::phi_dqn, precision), .torso = torso},
            num_actions, generator());
        parameters = network->parameters();
        const auto [policy, value] = network(frames());
        EXPECT_EQ(value.scalar_type(), torch::kFloat32);
        EXPECT_EQ(num_actions > 0 ? policy.log_pi.scalar_type() : policy.gaussian->mean.scalar_type(),
                  torch::kFloat32);
        const auto action =
            num_actions > 0 ? torch::zeros({8}, torch::kInt64) : torch::rand({8, 3}, generator());
        return (value - 1).square().mean() - log_prob(policy, action, network->box).mean();
    };
}

struct Case {
    std::string name;
    Loss loss;
};

std::ostream& operator<<(std::ostream& out, const Case& instance) {
    return out << instance.name;
}

class Bf16 : public testing::TestWithParam<Case> {};

/// The gradients of all parameters, one behind the other. Each must be float32, as its parameter.
torch::Tensor gradient(const Loss& loss, Precision precision) {
    std::vector<torch::Tensor> parameters, flat;
    loss(precision, parameters).backward();
    for (const auto& parameter : parameters) {
        EXPECT_EQ(parameter.scalar_type(), torch::kFloat32);
        if (!parameter.grad().defined()) continue;
        EXPECT_EQ(parameter.grad().scalar_type(), torch::kFloat32);
        flat.push_back(parameter.grad().flatten());
    }
    return torch::cat(flat);
}

TEST_P(Bf16, GradientsAreThoseOfFloat32UpToTheRounding) {
    const auto exact = gradient(GetParam().loss, Precision::float32);
    const auto rounded = gradient(GetParam().loss, Precision::bf16);
    ASSERT_EQ(exact.sizes(), rounded.sizes());
    const auto error = ((rounded - exact).norm() / exact.norm()).item<double>();
    // A number is off by up to 2^-9 = 0.002. LayerNorm divides by a small spread behind that: 0.01 to 0.09
    // here.
    EXPECT_LT(error, 0.15);
    EXPECT_GT(error, 1e-5) << "nothing was rounded";
}

INSTANTIATE_TEST_SUITE_P(
    Networks, Bf16,
    testing::Values(Case{"sac_phi_sac", of_sac(EncoderKind::phi_sac)},
                    Case{"sac_phi_dqn", of_sac(EncoderKind::phi_dqn)},
                    Case{"sac_impala", of_sac(EncoderKind::impala)},
                    Case{"sac_compact", of_sac(EncoderKind::compact)},
                    Case{"sac_mlp", of_sac(EncoderKind::mlp)}, Case{"sac_flat", of_sac(EncoderKind::flat)},
                    Case{"der", of_values(EncoderKind::phi_dqn, true)},
                    Case{"rainbow_data_efficient", of_values(EncoderKind::data_efficient, true)},
                    Case{"rainbow_phi_dqn_2013", of_values(EncoderKind::phi_dqn_2013, true)},
                    Case{"dqn", of_values(EncoderKind::phi_dqn, false)},
                    Case{"ppo", of_ppo(Torso::two_branch, 0)}, Case{"ppo_shared", of_ppo(Torso::shared, 4)}),
    [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace cale
