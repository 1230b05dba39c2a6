// SAC against the numbers of Dopamine's sac_agent.train.
#include <cmath>
#include <map>
#include <numbers>

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "agents/random.h"
#include "agents/sac.h"
#include "golden_network.h"
#include "support/golden.h"

namespace cale {
namespace {

struct Case {
    YAML::Node file;
    std::string name;
    std::int64_t batch_size = 0;
    SacConfig config;
    torch::Dtype dtype = torch::kFloat32;
};

Case read_case(const std::string& file_name, torch::Dtype dtype) {
    Case c;
    c.file = golden::load(file_name);
    c.name = c.file["case"].as<std::string>();
    c.dtype = dtype;
    const auto hyper = c.file["hyper"];
    c.batch_size = hyper["batch"].as<std::int64_t>();
    const auto encoder = hyper["encoder"].as<std::string>();
    c.config.encoder = encoder == "SAC" ? EncoderKind::phi_sac : EncoderKind::phi_dqn;
    c.config.hidden_units = hyper["hidden_units"].as<std::int64_t>();
    if (hyper["hidden_layers"]) c.config.hidden_layers = hyper["hidden_layers"].as<std::int64_t>();
    c.config.reward_scale = hyper["reward_scale"].as<double>();
    c.config.target_entropy = hyper["target_entropy"].as<double>();
    c.config.learning_rate = hyper["lr"].as<double>();
    c.config.adam_epsilon = hyper["adam_eps"].as<double>();
    c.config.tau = hyper["tau"].as<double>();
    return c;
}

SacNetwork make_network(const Case& c, const std::string& weights_case) {
    SacNetwork network(EncoderConfig{.encoder = c.config.encoder},
                       HeadConfig{c.config.hidden_layers, c.config.hidden_units}, make_generator(1));
    golden::load_weights(*network, c.file, weights_case);
    network->to(c.dtype);
    return network;
}

SacLearner make_learner(const Case& c) {
    auto log_alpha = torch::full({1}, c.file["hyper"]["log_alpha0"].as<double>(), c.dtype).requires_grad_();
    return {make_network(c, c.name), make_network(c, c.name + "/target"), log_alpha, c.config};
}

Batch make_batch(const Case& c) {
    const auto size = c.batch_size;
    const auto u = golden::uniforms(c.name, "action", {size, 3});
    constexpr double pi = std::numbers::pi;
    Batch batch;
    batch.observation = golden::observations(c.file, "obs", size);
    batch.next_observation = golden::observations(c.file, "next_obs", size);
    batch.action =
        torch::stack({u.select(1, 0), -pi + 2 * pi * u.select(1, 1), u.select(1, 2)}, 1).to(torch::kFloat32);
    golden::expect_close(batch.action, golden::tensor(c.file["inputs"]["action"]), 1e-6, "the hashed action");
    batch.n_step_return = golden::tensor(c.file["inputs"]["reward"]).to(c.dtype);
    const auto terminal = golden::tensor(c.file["inputs"]["terminal"]);
    batch.discount = (c.file["hyper"]["cumulative_gamma"].as<double>() * (1 - terminal)).to(c.dtype);
    return batch;
}

SacNoise noise_of(const Case& c, int step) {
    const auto node = c.file["steps"][step];
    return {golden::tensor(node["eps_target"]).to(c.dtype), golden::tensor(node["eps_actor"]).to(c.dtype)};
}

using Tensors = std::map<std::string, torch::Tensor>;

Tensors parameters(const SacNetwork& network) {
    Tensors copies;
    for (const auto& parameter : network->named_parameters())
        copies[parameter.key()] = parameter.value().detach().clone();
    return copies;
}

Tensors gradients(const SacNetwork& network) {
    Tensors copies;
    for (const auto& parameter : network->named_parameters())
        copies[parameter.key()] = parameter.value().grad().clone();
    return copies;
}

class SacGolden : public ::testing::TestWithParam<std::tuple<std::string, torch::Dtype>> {
  protected:
    Case c = read_case(std::get<0>(GetParam()), std::get<1>(GetParam()));
    golden::Tolerances tolerance = golden::tolerances(c.dtype);

    void expect_summaries(const Tensors& values, const YAML::Node& summaries, const std::string& prefix,
                          double l2_tolerance, double entry_tolerance, const std::string& what) {
        ASSERT_EQ(values.size(), summaries.size());
        for (const auto& [name, value] : values) {
            golden::expect_summary(value, summaries[name], prefix, c.name, name, l2_tolerance,
                                   entry_tolerance, what);
        }
    }

    void expect_moved(const SacNetwork& network, const Tensors& initial, const std::string& node) {
        auto deltas = parameters(network);
        for (auto& [name, value] : deltas) value -= initial.at(name);
        expect_summaries(deltas, c.file[node], "delta_", tolerance.delta_l2, tolerance.delta_entries, node);
    }
};

TEST_P(SacGolden, Forward) {
    const torch::NoGradGuard no_grad;
    const auto batch = make_batch(c);
    const auto noise = noise_of(c, 0);
    const auto action = batch.action.to(c.dtype);
    const auto expect = [&](const torch::Tensor& actual, const YAML::Node& node, const std::string& what) {
        golden::expect_close(actual, golden::tensor(node[what]), tolerance.forward, what);
    };
    const auto expect_policy = [&](SacNetwork& network, const torch::Tensor& features,
                                   const torch::Tensor& eps, const YAML::Node& node) {
        const auto policy = network->policy(features);
        const auto sampled = sample(policy, eps, network->box);
        expect(policy.mean, node, "mu");
        expect(policy.log_std, node, "log_std");
        expect(mean_action(policy, network->box), node, "mean_action");
        expect(sampled.action, node, "sampled_action");
        expect(sampled.log_prob, node, "log_prob");
    };

    auto learner = make_learner(c);
    const auto online = c.file["forward"]["online"];
    const auto features = learner.network->encoder->trunk(batch.observation);
    const auto critic_z = learner.network->encoder->critic_branch(features);
    const auto q = learner.network->critic(critic_z, action);
    expect_policy(learner.network, features, noise.actor, online);
    expect(q.q1, online, "q1");
    expect(q.q2, online, "q2");
    const auto own = sample(learner.network->policy(features), noise.actor, learner.network->box);
    const auto q_pi = learner.network->critic(critic_z, own.action);
    expect(q_pi.q1, online, "q1_pi");
    expect(q_pi.q2, online, "q2_pi");

    const auto target = c.file["forward"]["target"];
    const auto next_features = learner.target->encoder->trunk(batch.next_observation);
    expect_policy(learner.target, next_features, noise.target, target);
    const auto mean = mean_action(learner.target->policy(next_features), learner.target->box);
    const auto next_q = learner.target->critic(learner.target->encoder->critic_branch(next_features), mean);
    expect(next_q.q1, target, "q1_mean_action");
    expect(next_q.q2, target, "q2_mean_action");
    const auto losses =
        sac_losses(learner.network, learner.target, learner.log_alpha, batch, noise, c.config);
    expect(losses.target_values, target, "y");
}

TEST_P(SacGolden, ThreeUpdates) {
    auto learner = make_learner(c);
    const auto batch = make_batch(c);
    const auto initial = parameters(learner.network);
    const auto initial_target = parameters(learner.target);
    const auto steps = c.file["steps"];
    for (int step = 0; step < static_cast<int>(steps.size()); ++step) {
        const auto losses = sac_update(learner, batch, noise_of(c, step), c.config);
        const double loss_tolerance = step == 0 ? tolerance.loss_first : tolerance.loss_later;
        const auto expect = [&](const torch::Tensor& actual, const std::string& key) {
            golden::expect_close(actual, golden::tensor(steps[step][key]), loss_tolerance,
                                 key + " of step " + std::to_string(step + 1));
        };
        expect(losses.critic, "critic_loss");
        expect(losses.actor, "policy_loss");
        expect(losses.alpha, "alpha_loss");
        expect(learner.log_alpha.detach()[0], "log_alpha_after");
        if (step == 0) {
            golden::expect_close(learner.log_alpha.grad(), golden::tensor(c.file["grad_log_alpha"]),
                                 loss_tolerance, "grad_log_alpha");
            expect_summaries(gradients(learner.network), c.file["grad"], "", tolerance.grad_l2,
                             tolerance.grad_entries, "the gradient");
        }
        const auto after = std::to_string(step + 1);
        if (c.file["params_after" + after]) expect_moved(learner.network, initial, "params_after" + after);
        if (c.file["target_after" + after])
            expect_moved(learner.target, initial_target, "target_after" + after);
    }
}

INSTANTIATE_TEST_SUITE_P(Files, SacGolden,
                         ::testing::Combine(::testing::ValuesIn(golden::files_of_kind("sac")),
                                            ::testing::Values(torch::kFloat32, torch::kFloat64)),
                         [](const auto& chosen) {
                             const auto file = std::get<0>(chosen.param);
                             const bool sharp = std::get<1>(chosen.param) == torch::kFloat64;
                             return file.substr(0, file.find('.')) + (sharp ? "_float64" : "_float32");
                         });

}  // namespace
}  // namespace cale
