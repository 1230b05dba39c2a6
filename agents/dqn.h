// Deep Q-networks on a game's own set of actions.
//   Mnih et al. 2015, "Human-level control through deep reinforcement learning" (DQN below)
//   van Hasselt et al. 2016, "Deep Reinforcement Learning with Double Q-learning" (option double_dqn)
//   Wang et al. 2016, "Dueling Network Architectures" (option dueling)
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include <torch/types.h>

#include "agents/agent.h"
#include "agents/exploration.h"
#include "agents/q_learner.h"
#include "agents/replay_memory.h"
#include "cale/fields.h"
#include "networks/heads.h"
#include "networks/q_network.h"

namespace cale {

/// Of an error e: e^2, or linear beyond 1.
enum class ValueLoss { mse, huber };
std::span<const std::string_view> names_of(ValueLoss);

/// The defaults are Dopamine's for 200 million frames.
struct DqnConfig {
    static constexpr ActionSpace kActionSpace = ActionSpace::minimal;

    EncoderKind encoder = EncoderKind::phi_dqn;
    Padding padding = Padding::same;
    std::int64_t hidden_units = 512;
    bool dueling = false;
    bool double_dqn = false;
    ValueLoss loss = ValueLoss::mse;
    ReplaySettings replay{.reward_clip = 1};
    std::int64_t target_update_period = 8'000;
    EpsilonSettings epsilon;
    double learning_rate = 6.25e-5;
    double adam_epsilon = 1.5e-4;
};

template <class Visit>
void fields(DqnConfig& config, Visit&& visit) {
    visit("encoder", config.encoder, "how frames become features: phi_sac, phi_dqn or impala");
    visit("padding", config.padding,
          "of the convolutions; same: with zeros, as Dopamine; valid: without, as Mnih et al.");
    visit("hidden_units", config.hidden_units, Range{1, 65'536}, "units of the hidden layer");
    visit("dueling", config.dueling, "a state's value and the actions' advantages apart");
    visit("double_dqn", config.double_dqn, "the online network chooses the action that the target values");
    visit("loss", config.loss, "mse: squared error; huber: linear beyond an error of 1");
    fields(config.replay, visit);
    visit("target_update_period", config.target_update_period, Range{1, 1e9},
          "agent steps between copies of the network to the target");
    fields(config.epsilon, visit);
    visit("learning_rate", config.learning_rate, Range{0, 1}, "Adam's learning rate");
    visit("adam_epsilon", config.adam_epsilon, Range{0, 1}, "Adam's epsilon, outside the root");
}

/// `loss` carries a gradient; the rest is for the log.
struct DqnLosses {
    torch::Tensor loss;           // [] mean over the batch
    torch::Tensor q;              // [B] values of the stored actions
    torch::Tensor target_values;  // [B] y
};

/// A pure function of its arguments. Throws std::invalid_argument, naming both shapes, where the
/// batch does not fit together.
DqnLosses dqn_losses(QNetwork& network, QNetwork& target, const Batch& batch, const DqnConfig& config);

/// One gradient step. Returns the losses before it, without their graph.
DqnLosses dqn_update(QLearner& learner, const Batch& batch, const DqnConfig& config);

/// Tags: losses/{td_loss, q_values}, charts/{learning_rate, epsilon}.
/// State: network/<parameter>, target/<parameter>, adam/..., training_steps, random/....
/// Throws std::invalid_argument for a world with the continuous joystick.
std::unique_ptr<Agent> make_dqn(const DqnConfig& config, const AgentSpec& spec);

/// Throws std::runtime_error, naming what is too large and the settings to lower, unless such an agent fits
/// into `available` bytes (see available_memory) once its memory is full.
void check_memory(const DqnConfig& config, const AgentSpec& spec, std::int64_t available);

}  // namespace cale
