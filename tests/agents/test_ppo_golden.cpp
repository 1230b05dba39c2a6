// PPO against the numbers of Dopamine's ppo_agent.train_minibatch, with both of its networks.
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agents/advantages.h"
#include "agents/ppo.h"
#include "agents/random.h"
#include "golden_network.h"
#include "support/golden.h"

namespace cale {
namespace {

struct Case : golden::NetworkCase {
    PpoConfig config;
    std::int64_t num_actions = 0;

    Case(const std::string& file_name, torch::Dtype type) : NetworkCase(file_name, type) {
        const auto hyper_node = file["hyper"];
        if (hyper_node["num_actions"]) {
            num_actions = hyper_node["num_actions"].as<std::int64_t>();
            config.network.encoder = EncoderKind::phi_dqn;
            config.torso = Torso::shared;
            config.network.hidden_layers = 0;
        } else {
            const bool phi_sac = hyper_node["encoder"].as<std::string>() == "SAC";
            config.network.encoder = phi_sac ? EncoderKind::phi_sac : EncoderKind::phi_dqn;
            const auto layers = actor_layers();
            config.network.hidden_layers = std::ssize(layers);
            if (!layers.empty()) config.network.hidden_units = layers.back();
        }
        config.clip = hyper("clip");
        config.clip_value_loss = hyper_node["clip_critic_loss"].as<bool>();
        config.value_coefficient = hyper("vf_coefficient");
        config.entropy_coefficient = hyper("entropy_coefficient");
        config.max_gradient_norm = hyper("max_gradient_norm");
        config.learning_rate = hyper("lr");
        config.adam_epsilon = hyper("adam_eps");
    }

    PpoNetwork network() const {
        PpoNetwork made(PpoNetworkConfig{.encoder = {.encoder = config.network.encoder},
                                         .torso = config.torso,
                                         .hidden_layers = config.network.hidden_layers,
                                         .hidden_units = config.network.hidden_units},
                        num_actions, make_generator(1));
        golden::load_weights(*made, file, name);
        made->to(device, dtype);
        return made;
    }

    torch::Tensor joystick_actions() const {
        const auto u = golden::uniforms(name, "action", {batch_size, 3});
        constexpr double pi = std::numbers::pi;
        const auto anywhere = torch::stack({u.select(1, 0), -pi + 2 * pi * u.select(1, 1), u.select(1, 2)}, 1)
                                  .to(torch::kFloat32);
        const auto centre = torch::tensor({0.5f, 0.0f, 0.5f});
        const auto near_centre = centre + hyper("action_scale") * (anywhere - centre);
        golden::expect_close(near_centre, golden::tensor(file["inputs"]["action"]), 1e-6,
                             "the hashed action");
        return near_centre.to(device, dtype);
    }

    RolloutBatch minibatch() const {
        return {.observation = golden::observations(file, "obs", batch_size),
                .action = num_actions == 0 ? joystick_actions() : actions(),
                .old_log_prob = input("old_log_prob"),
                .old_value = input("old_value"),
                .advantage = input("advantage"),
                .returns = input("returns")};
    }
};

class PpoGolden : public ::testing::TestWithParam<golden::FileAndType> {
  protected:
    Case c{std::get<0>(GetParam()), std::get<1>(GetParam())};
};

TEST_P(PpoGolden, Forward) {
    const torch::NoGradGuard no_grad;
    auto network = c.network();
    const auto minibatch = c.minibatch();
    const auto forward = c.file["forward"];
    const auto [policy, value] = network(minibatch.observation);
    c.expect(normalized(minibatch).advantage, forward, "advantage_normalized", c.tolerance.forward);
    c.expect(value, forward, "value", c.tolerance.forward);
    c.expect(entropy(policy), forward, "entropy", c.tolerance.forward);
    const auto new_log_prob = log_prob(policy, minibatch.action, network->box);
    c.expect(new_log_prob, forward, "log_prob", c.tolerance.forward);
    c.expect((new_log_prob - minibatch.old_log_prob).exp(), forward, "ratio", c.tolerance.forward);
    if (policy.gaussian) {
        c.expect(policy.gaussian->mean, forward, "mu", c.tolerance.forward);
        c.expect(policy.gaussian->log_std, forward, "log_std", c.tolerance.forward);
    } else {
        golden::expect_close(policy.log_pi, golden::tensor(forward["logits"]).log_softmax(1),
                             c.tolerance.forward, "logits");
    }
}

TEST_P(PpoGolden, ThreeUpdates) {
    const auto anneal = c.file["hyper"]["anneal_steps"];
    const bool constant = !anneal || anneal.IsNull();
    OnPolicyState learner(c.network(), constant ? 0 : static_cast<std::int64_t>(c.hyper("anneal_steps")),
                          c.config);
    // PPO has no setting for these.
    if (const auto adam = c.adam(); adam.beta1 != AdamConfig{}.beta1 || adam.beta2 != AdamConfig{}.beta2)
        learner.adam = Adam(learner.parameters, adam);
    const auto minibatch = c.minibatch();
    const auto initial = golden::parameters(*learner.network);
    // The gradients of the file are from before they are clipped.
    ppo_losses(learner.network, normalized(minibatch), c.config).combined.backward();
    c.expect_gradients(*learner.network);
    const auto steps = c.file["steps"];
    for (std::size_t step = 0; step < steps.size(); ++step) {
        const double tolerance = step == 0 ? c.tolerance.loss_first : c.tolerance.loss_later;
        const auto losses = ppo_update(learner, minibatch, c.config);
        c.expect(losses.actor, steps[step], "actor_loss", tolerance);
        c.expect(losses.critic, steps[step], "critic_loss", tolerance);
        c.expect(losses.entropy, steps[step], "entropy_loss", tolerance);
        c.expect(losses.combined, steps[step], "combined_loss", tolerance);
        c.expect_moved(*learner.network, initial, "params_after" + std::to_string(step + 1));
    }
}

TEST_P(PpoGolden, GradientsAreScaledDownToTheLargestNorm) {
    auto network = c.network();
    ppo_losses(network, normalized(c.minibatch()), c.config).combined.backward();
    const auto norm = clip_gradient_norm(network->parameters(), c.config.max_gradient_norm);
    c.expect(norm, c.file["steps"][0], "grad_global_norm", c.tolerance.grad_l2);
    double squares = 0;
    for (const auto& parameter : network->parameters())
        squares += parameter.grad().to(torch::kFloat64).square().sum().item<double>();
    EXPECT_NEAR(std::sqrt(squares), std::min(norm.item<double>(), c.config.max_gradient_norm),
                1e-4 * c.config.max_gradient_norm);
}

TEST_P(PpoGolden, GeneralizedAdvantages) {
    const auto gae = c.file["gae"];
    const auto column = [&](const char* key) { return golden::tensor(gae[key]).to(c.dtype).unsqueeze(1); };
    const auto next_value = golden::tensor(gae["next_value"]).to(c.dtype).view({1});
    const auto estimate =
        generalized_advantages(column("reward"), column("terminal"), column("value"), next_value,
                               gae["gamma"].as<double>(), gae["lam"].as<double>());
    c.expect(estimate.advantage.squeeze(1), gae, "advantage", 1e-6);
    c.expect(estimate.returns.squeeze(1), gae, "returns", 1e-6);
}

std::vector<golden::FileAndType> both_kinds() {
    auto pairs = golden::files_and_types("ppo");
    for (const auto& pair : golden::files_and_types("ppo_discrete")) pairs.push_back(pair);
    return pairs;
}

INSTANTIATE_TEST_SUITE_P(Files, PpoGolden, ::testing::ValuesIn(both_kinds()), golden::name_of);

}  // namespace
}  // namespace cale
