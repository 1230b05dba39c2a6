// Data-efficient Rainbow, each of whose components is an option: with the settings of 200 million
// frames it is Rainbow, with all of them off it is DQN.
//   Hessel et al. 2018, "Rainbow: Combining Improvements in Deep Reinforcement Learning"
//   van Hasselt et al. 2019, "When to use parametric models in reinforcement learning?" (DER)
//   Bellemare et al. 2017, "A Distributional Perspective on Reinforcement Learning" (C51 below)
//   Schaul et al. 2016, "Prioritized Experience Replay" (PER below)
#pragma once

#include <cstdint>
#include <memory>

#include <torch/types.h>

#include "agents/agent.h"
#include "agents/q_state.h"
#include "cale/fields.h"
#include "networks/q_network.h"

namespace cale {

/// The defaults are Dopamine's for 100,000 agent steps.
struct DerConfig : QSettings {
    static constexpr const char* kName = "DER";
    static constexpr const char* kSizeSettings = "agent.hidden_units or agent.num_atoms";
    static constexpr bool kDiscrete = true;

    DerConfig() {
        dueling = double_dqn = true;
        replay = {.update_horizon = 10, .min_replay = 1'600, .update_period = 1, .reward_clip = 1};
        target_update_period = epsilon.epsilon_decay_period = 2'000;
        learning_rate = 1e-4;
    }

    bool distributional = true;
    std::int64_t num_atoms = 51;
    double value_limit = 10;
    bool noisy = true, noisy_evaluation = false, random_warmup = false;
    double noisy_sigma = 0.1;
    bool prioritised = true;
    double priority_exponent = 0.5, importance_exponent = 0.5;
};

template <class Visit>
void fields(DerConfig& config, Visit&& visit) {
    fields(static_cast<QSettings&>(config), visit);
    visit("distributional", config.distributional, "learn the return's distribution (C51); off: its mean");
    visit("num_atoms", config.num_atoms, Range{2, 10'000},
          "where distributional: returns that a distribution is made of");
    visit("value_limit", config.value_limit, Range{1e-6, 1e9},
          "where distributional: atoms lie between plus and minus this");
    visit("noisy", config.noisy, "explore by noise in the weights; off: epsilon-greedily");
    visit("noisy_sigma", config.noisy_sigma, Range{0, 10},
          "where noisy: initial noise of a weight is this over sqrt(inputs)");
    visit("noisy_evaluation", config.noisy_evaluation,
          "where noisy: with the noise in evaluations and policy files, too; off: without");
    visit("random_warmup", config.random_warmup,
          "where noisy: random actions for the first min_replay decisions");
    visit("prioritised", config.prioritised, "replay surprising transitions more often; off: all alike");
    visit("priority_exponent", config.priority_exponent, Range{0, 3},
          "where prioritised: alpha, loss to this power");
    visit("importance_exponent", config.importance_exponent, Range{0, 3},
          "where prioritised: beta of the importance weights");
}

/// PER's importance weights (N P)^-beta [B], over their largest, by which N cancels.
torch::Tensor importance_weights(const torch::Tensor& probability, double exponent);
/// PER's priorities [B] to the power of alpha: a transition's loss [B] stands for the TD error, as in
/// Rainbow.
torch::Tensor priorities(const torch::Tensor& loss, double exponent);

/// The draws of one update.
struct DerNoise {
    QNoise online;  // of the online network, for the loss
    QNoise target;  // at the next state, where the online network takes it, too
};

/// Only `loss` carries a gradient.
struct DerLosses {
    torch::Tensor loss;            // [] mean of weight x loss
    torch::Tensor per_transition;  // [B] cross-entropy, or squared error if not distributional
    torch::Tensor priorities;      // [B]
    torch::Tensor q;               // [B] values of the stored actions
    torch::Tensor target;          // [B, atoms] projected distribution, or [B] y
};

/// A pure function of its arguments; `loss_weights` [B]. Throws std::invalid_argument, naming both
/// shapes, where they do not fit together.
DerLosses der_losses(QNetwork& network, QNetwork& target, const Batch& batch,
                     const torch::Tensor& loss_weights, const DerNoise& noise, const DerConfig& config);

/// Makes one gradient step. Returns the losses before it, detached.
DerLosses der_update(QState& state, const Batch& batch, const torch::Tensor& loss_weights,
                     const DerNoise& noise, const DerConfig& config);

/// Tags: losses/{cross_entropy or td_loss, q_values}, charts/{learning_rate, epsilon, gradient_norm}.
/// State: network/<parameter>, target/<parameter>, adam/..., training_steps, random/....
/// Throws std::invalid_argument for a world whose actions are a box.
std::unique_ptr<Agent> make_der(const DerConfig& config, const AgentSpec& spec);
/// Returns how its network represents action values.
QHeadConfig head_of(const DerConfig& config);

}  // namespace cale
