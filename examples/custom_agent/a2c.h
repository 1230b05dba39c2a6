// Advantage actor-critic, as an example of an agent that this project does not know:
// Mnih et al. 2016, "Asynchronous Methods for Deep Reinforcement Learning", in its synchronous form.
#pragma once

#include <cstdint>
#include <memory>

#include "agents/agent.h"
#include "cale/fields.h"
#include "networks/ppo_network.h"

namespace cale {

/// Every member is a key `agent.<name>` of train_a2c, because fields() visits it.
struct A2cConfig {
    // It chooses among a set of actions; the joystick is for agents that say false.
    static constexpr bool kDiscrete = true;

    EncoderKind encoder = EncoderKind::phi_dqn;
    std::int64_t rollout_length = 5;
    double gamma = 0.99;
    double value_coefficient = 0.5;
    double entropy_coefficient = 0.01;
    double max_gradient_norm = 0.5;
    double learning_rate = 7e-4;
    double adam_epsilon = 1e-5;
};

template <class Visit>
void fields(A2cConfig& config, Visit&& visit) {
    visit("encoder", config.encoder, "how observations become features; for bytes mlp, or flat: no layer");
    visit("rollout_length", config.rollout_length, Range{1, 100'000}, "steps of each environment per update");
    visit("gamma", config.gamma, Range{0, 1}, "discount per agent step");
    visit("value_coefficient", config.value_coefficient, Range{0, 1000}, "weight of the value's loss");
    visit("entropy_coefficient", config.entropy_coefficient, Range{0, 1000}, "weight of the entropy bonus");
    visit("max_gradient_norm", config.max_gradient_norm, Range{1e-9, 1e9},
          "gradients of a larger norm are scaled down to this one");
    visit("learning_rate", config.learning_rate, Range{0, 1}, "Adam's learning rate");
    visit("adam_epsilon", config.adam_epsilon, Range{0, 1}, "Adam's epsilon, outside the root");
}

/// The name is the agent's: train_a2c calls it.
std::unique_ptr<Agent> make_a2c(const A2cConfig& config, const AgentSpec& spec);

}  // namespace cale
