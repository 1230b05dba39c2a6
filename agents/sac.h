// Soft Actor-Critic on the continuous joystick.
//   Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications" (SAC below)
//   Farebrother & Castro 2024, "CALE: Continuous Arcade Learning Environment" (CALE below)
// CALE's agent beside SAC's: one trunk for actor and critics that only the critics train, one optimiser for
// both, and a target whose action value is taken at the target actor's mean action.
#pragma once

#include <memory>

#include <torch/types.h>

#include "agents/actor_critic_state.h"
#include "agents/agent.h"
#include "agents/critic.h"
#include "cale/fields.h"
#include "networks/actor_critic.h"

namespace cale {

/// The defaults are CALE's for 200 million frames.
struct SacConfig : ActorCriticSettings {
    static constexpr const char* kName = "SAC";
    static constexpr const char* kSizeSettings =
        "agent.hidden_units, agent.hidden_layers or agent.critic_atoms";
    static constexpr bool kDiscrete = false;

    double target_entropy = -1.5;
    CriticSettings critic;
    RandomActions random_actions = RandomActions::box;
};

template <class Visit>
void fields(SacConfig& config, Visit&& visit) {
    fields(static_cast<ActorCriticSettings&>(config), visit);
    visit("target_entropy", config.target_entropy, Range{-1000, 1000},
          "entropy of the policy that alpha is adjusted for");
    fields(config.critic, visit);
    visit("random_actions", config.random_actions,
          "in the warm-up and by epsilon, in training; events: among the 18 of the joystick, a paddle's 6");
}

/// Standard normal numbers of one update, [B, A] each.
struct SacNoise {
    torch::Tensor target;  // for the action at the next state
    torch::Tensor actor;   // for the action at the state
};

/// The first three are means over the batch and carry gradients. Without the actor only critic, q1, q2 and
/// target_values are set.
struct SacLosses {
    torch::Tensor critic;          // [] see critic_loss()
    torch::Tensor actor = {};      // [] J_pi
    torch::Tensor alpha = {};      // [] J_alpha
    torch::Tensor q1, q2;          // [B] values of the stored actions
    torch::Tensor target_values;   // [B] y
    torch::Tensor entropy = {};    // [B] -log pi of the actor's own sample
    SquashedGaussian policy = {};  // the actor's
};

/// A pure function of its arguments. `log_alpha` is [1]. Without the actor, the losses of the critics alone.
/// Throws std::invalid_argument, naming both shapes, where the batch or the noise do not fit together.
SacLosses sac_losses(SacNetwork& network, SacNetwork& target_network, const torch::Tensor& log_alpha,
                     const Batch& batch, const SacNoise& noise, const SacConfig& config,
                     bool with_actor = true);

/// One gradient step on these losses, then the target follows. Returns the losses before it, without graphs.
SacLosses sac_update(ActorCriticState<SacNetwork>& state, const Batch& batch, const SacNoise& noise,
                     const SacConfig& config, bool with_actor = true);

/// Tags: ActorCriticState's, charts/{learning_rate, epsilon, mean_<coordinate>, mean_log_std}.
/// State: ActorCriticState's, training_steps, random/..., gradient_steps where the actor is delayed.
/// Throws std::invalid_argument for settings that no network can be built from, and for discrete actions.
std::unique_ptr<Agent> make_sac(const SacConfig& config, const AgentSpec& spec);
/// Returns the agent's network for the world of `spec`, on the CPU. Parameters are drawn from `generator`.
SacNetwork make_network(const SacConfig& config, const AgentSpec& spec, const at::Generator& generator);

}  // namespace cale
