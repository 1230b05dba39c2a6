// SAC against the numbers of Dopamine's sac_agent.train.
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agents/random.h"
#include "agents/sac.h"
#include "golden_network.h"
#include "support/golden.h"

namespace cale {
namespace {

struct Case : golden::NetworkCase {
    SacConfig config;

    Case(const std::string& file_name, torch::Dtype type) : NetworkCase(file_name, type) {
        const auto hyper_node = file["hyper"];
        const bool phi_sac = hyper_node["encoder"].as<std::string>() == "SAC";
        config.network.encoder = phi_sac ? EncoderKind::phi_sac : EncoderKind::phi_dqn;
        config.network.hidden_units = hyper_node["hidden_units"].as<std::int64_t>();
        config.network.hidden_layers = std::ssize(actor_layers());
        config.replay.reward_scale = hyper("reward_scale");
        config.target_entropy = hyper("target_entropy");
        config.tau = hyper("tau");
    }
};

SacNetwork make_network(const Case& c, const std::string& weights_case) {
    SacNetwork network(EncoderConfig{.encoder = c.config.network.encoder}, c.config.network.head(),
                       make_generator(1));
    golden::load_weights(*network, c.file, weights_case);
    network->to(c.device, c.dtype);
    return network;
}

ActorCriticState<SacNetwork> make_learner(const Case& c) {
    auto log_alpha =
        torch::full({1}, c.hyper("log_alpha0"), torch::dtype(c.dtype).device(c.device)).requires_grad_();
    return {make_network(c, c.name), make_network(c, c.name + "/target"), log_alpha, c.adam()};
}

Batch make_batch(const Case& c) {
    const auto size = c.batch_size;
    const auto u = golden::uniforms(c.name, "action", {size, 3});
    constexpr double pi = std::numbers::pi;
    Batch batch;
    batch.observation = golden::observations(c.file, "obs", size);
    batch.next_observation = golden::observations(c.file, "next_obs", size);
    const auto action =
        torch::stack({u.select(1, 0), -pi + 2 * pi * u.select(1, 1), u.select(1, 2)}, 1).to(torch::kFloat32);
    golden::expect_close(action, golden::tensor(c.file["inputs"]["action"]), 1e-6, "the hashed action");
    batch.action = action.to(c.device);
    batch.n_step_return = c.input("reward");
    batch.discount = c.discount();
    return batch;
}

SacNoise noise_of(const Case& c, int step) {
    const auto node = c.file["steps"][step];
    const auto drawn = [&](const char* key) { return golden::tensor(node[key]).to(c.device, c.dtype); };
    return {drawn("eps_target"), drawn("eps_actor")};
}

class SacGolden : public ::testing::TestWithParam<golden::FileAndType> {
  protected:
    Case c{std::get<0>(GetParam()), std::get<1>(GetParam())};
};

TEST_P(SacGolden, Forward) {
    const torch::NoGradGuard no_grad;
    const auto batch = make_batch(c);
    const auto noise = noise_of(c, 0);
    const auto action = batch.action.to(c.dtype);
    const auto expect = [&](const torch::Tensor& actual, const YAML::Node& node, const std::string& what) {
        golden::expect_close(actual, golden::tensor(node[what]), c.tolerance.forward, what);
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
    const auto q = learner.network->values(critic_z, action);
    expect_policy(learner.network, features, noise.actor, online);
    expect(q.q1, online, "q1");
    expect(q.q2, online, "q2");
    const auto own = sample(learner.network->policy(features), noise.actor, learner.network->box);
    const auto q_pi = learner.network->values(critic_z, own.action);
    expect(q_pi.q1, online, "q1_pi");
    expect(q_pi.q2, online, "q2_pi");

    const auto target = c.file["forward"]["target"];
    const auto next_features = learner.target->encoder->trunk(batch.next_observation);
    expect_policy(learner.target, next_features, noise.target, target);
    const auto mean = mean_action(learner.target->policy(next_features), learner.target->box);
    const auto next_q = learner.target->values(learner.target->encoder->critic_branch(next_features), mean);
    expect(next_q.q1, target, "q1_mean_action");
    expect(next_q.q2, target, "q2_mean_action");
    const auto losses =
        sac_losses(learner.network, learner.target, learner.log_alpha, batch, noise, c.config);
    expect(losses.target_values, target, "y");
}

TEST_P(SacGolden, ThreeUpdates) {
    auto learner = make_learner(c);
    const auto batch = make_batch(c);
    const auto initial = golden::parameters(*learner.network);
    const auto initial_target = golden::parameters(*learner.target);
    const auto steps = c.file["steps"];
    for (int step = 0; step < static_cast<int>(steps.size()); ++step) {
        const auto losses = sac_update(learner, batch, noise_of(c, step), c.config);
        const double loss_tolerance = step == 0 ? c.tolerance.loss_first : c.tolerance.loss_later;
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
            c.expect_gradients(*learner.network);
        }
        const auto after = "_after" + std::to_string(step + 1);
        c.expect_moved(*learner.network, initial, "params" + after);
        c.expect_moved(*learner.target, initial_target, "target" + after);
    }
}

INSTANTIATE_TEST_SUITE_P(Files, SacGolden, ::testing::ValuesIn(golden::files_and_types("sac")),
                         golden::name_of);

}  // namespace
}  // namespace cale
