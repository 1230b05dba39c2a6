// Deep Q-networks on a discrete set of actions: a game's own, or the joystick's factored ones.
//   Mnih et al. 2015, "Human-level control through deep reinforcement learning" (DQN below)
//   van Hasselt et al. 2016, "Deep Reinforcement Learning with Double Q-learning" (option double_dqn)
//   Wang et al. 2016, "Dueling Network Architectures" (option dueling)
#pragma once

#include <memory>
#include <span>
#include <string_view>

#include <torch/types.h>

#include "agents/agent.h"
#include "agents/q_state.h"
#include "cale/fields.h"
#include "networks/q_network.h"

namespace cale {

/// The loss of an error e: e^2 (mse), or e^2 / 2 up to 1 and |e| - 1/2 beyond (huber).
enum class ValueLoss { mse, huber };
std::span<const std::string_view> names_of(ValueLoss);

/// The defaults are Dopamine's for 200 million frames.
struct DqnConfig : QSettings {
    static constexpr const char* kName = "DQN";
    static constexpr const char* kSizeSettings = "agent.hidden_units";
    static constexpr bool kDiscrete = true;

    ValueLoss loss = ValueLoss::mse;
};

template <class Visit>
void fields(DqnConfig& config, Visit&& visit) {
    fields(static_cast<QSettings&>(config), visit);
    visit("loss", config.loss, "mse: squared error; huber: linear beyond an error of 1");
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

/// Makes one gradient step. Returns the losses before it, detached.
DqnLosses dqn_update(QState& state, const Batch& batch, const DqnConfig& config);

/// Tags: losses/{td_loss, q_values}, charts/{learning_rate, epsilon, gradient_norm}.
/// State: network/<parameter>, target/<parameter>, adam/..., training_steps, random/....
/// Throws std::invalid_argument for a world whose actions are a box.
std::unique_ptr<Agent> make_dqn(const DqnConfig& config, const AgentSpec& spec);
/// Returns the network's head: one value per action.
inline QHeadConfig head_of(const DqnConfig&) {
    return {};
}

}  // namespace cale
