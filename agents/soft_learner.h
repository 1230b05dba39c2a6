// What SAC and SAC-D update: an actor-critic network, its target, the temperature, and their optimisers.
#pragma once

#include <utility>
#include <vector>

#include <torch/types.h>

#include "agents/state.h"
#include "networks/actor_critic.h"
#include "networks/adam.h"

namespace cale {

/// `Network`: SacNetwork or SacdNetwork.
template <class Network>
struct SoftLearner {
    /// `log_alpha` [1] requires a gradient. The target starts as it is given.
    SoftLearner(Network network_, Network target_, torch::Tensor log_alpha_, const AdamConfig& adam_config)
        : network(std::move(network_)),
          target(std::move(target_)),
          log_alpha(std::move(log_alpha_)),
          parameters(network->parameters()),
          target_parameters(target->parameters()),
          actor(actor_parameters(*network)),
          critic(critic_parameters(*network)),
          adam(parameters, adam_config),
          alpha_adam({log_alpha}, adam_config) {}

    /// One gradient step on every loss [], then the target follows by `tau`.
    void step(const torch::Tensor& critic_loss, const torch::Tensor& actor_loss,
              const torch::Tensor& alpha_loss, double tau) {
        adam.zero_grad();
        alpha_adam.zero_grad();
        // The lists say where each gradient ends: the actor's loss leaves the critics alone.
        critic_loss.backward({}, /*keep_graph=*/false, /*create_graph=*/false, critic);
        actor_loss.backward({}, /*keep_graph=*/false, /*create_graph=*/false, actor);
        alpha_loss.backward({}, /*keep_graph=*/false, /*create_graph=*/false, {{log_alpha}});
        adam.step();
        alpha_adam.step();
        soft_update(target_parameters, parameters, tau);
    }

    /// Adds network/, target/, adam/, alpha_adam/ and log_alpha.
    void add_state(StateParts& parts) {
        parts.add("network/", *network);
        parts.add("target/", *target);
        parts.add("adam/", adam.state());
        parts.add("alpha_adam/", alpha_adam.state());
        parts.tensors["log_alpha"] = log_alpha.detach();
    }

    Network network, target;  // the one that acts, and the one that values what follows
    torch::Tensor log_alpha;  // [1] of the temperature
    std::vector<torch::Tensor> parameters, target_parameters;  // of the network, of the target
    std::vector<torch::Tensor> actor, critic;                  // the network's, as the losses train them
    Adam adam, alpha_adam;                                     // of the network, of log_alpha
};

}  // namespace cale
