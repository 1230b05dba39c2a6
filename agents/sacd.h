// Soft Actor-Critic on a discrete set of actions: a game's own, or the joystick's factored ones.
//   Christodoulou 2019, "Soft Actor-Critic for Discrete Action Settings" (SAC-D below)
//   Farebrother & Castro 2024, "CALE: Continuous Arcade Learning Environment", its appendix
// Expectations over the actions are taken exactly, as sums, where SAC samples. CALE's code for it was
// never published: the encoder is shared and trained by the critics only, as in CALE's SAC.
#pragma once

#include <memory>
#include <span>
#include <string_view>

#include <torch/types.h>

#include "agents/actor_critic_state.h"
#include "agents/agent.h"
#include "cale/fields.h"
#include "networks/sacd_network.h"

namespace cale {

/// See SacdConfig::next_policy.
enum class NextPolicy { online, target };
std::span<const std::string_view> names_of(NextPolicy);

/// The defaults are those of CALE's table of hyper-parameters.
struct SacdConfig : ActorCriticSettings {
    static constexpr const char* kName = "SAC-D";
    static constexpr bool kDiscrete = true;

    SacdConfig() {
        replay.batch_size = 64;
        exploration = Exploration::epsilon_greedy;
        learning_rate = 3e-4;
    }

    double target_entropy_scale = 0.98;
    NextPolicy next_policy = NextPolicy::online;
};

template <class Visit>
void fields(SacdConfig& config, Visit&& visit) {
    fields(static_cast<ActorCriticSettings&>(config), visit);
    visit("target_entropy_scale", config.target_entropy_scale, Range{0, 1},
          "entropy that alpha is adjusted for, as a part of the uniform policy's log |A|");
    visit("next_policy", config.next_policy,
          "whose policy weighs the actions that follow: online, as in SAC-D, or the target network's");
}

/// The first three are means over the batch and carry gradients; the rest is for the log.
/// Without the actor only critic, q1, q2 and target_values are set.
struct SacdLosses {
    torch::Tensor critic;         // [] J_Q of both critics, without the factor 1/2
    torch::Tensor actor = {};     // [] J_pi
    torch::Tensor alpha = {};     // [] J_alpha
    torch::Tensor q1, q2;         // [B] values of the stored actions
    torch::Tensor target_values;  // [B] y
    torch::Tensor entropy = {};   // [B] of the policy
};

/// A pure function of its arguments. `log_alpha` is [1]. Without the actor, the losses of the critics. Throws
/// std::invalid_argument, naming both shapes, where the batch does not fit together.
SacdLosses sacd_losses(SacdNetwork& network, SacdNetwork& target_network, const torch::Tensor& log_alpha,
                       const Batch& batch, double target_entropy, const SacdConfig& config,
                       bool with_actor = true);

/// One gradient step on these losses, then the target follows. Returns the losses before the
/// step, without their graphs.
SacdLosses sacd_update(ActorCriticState<SacdNetwork>& state, const Batch& batch, double target_entropy,
                       const SacdConfig& config, bool with_actor = true);

/// Tags: ActorCriticState's, charts/{learning_rate, epsilon}.
/// State: ActorCriticState's, training_steps, random/..., gradient_steps where the actor is delayed.
/// Throws std::invalid_argument for a world whose actions are a box.
std::unique_ptr<Agent> make_sacd(const SacdConfig& config, const AgentSpec& spec);
/// Returns the agent's network for the world of `spec`, on the CPU. Parameters are drawn from `generator`.
SacdNetwork make_network(const SacdConfig& config, const AgentSpec& spec, const at::Generator& generator);

}  // namespace cale
