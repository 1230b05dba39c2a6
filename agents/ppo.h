// Proximal policy optimisation, on the continuous joystick or on a discrete set of actions.
//   Schulman et al. 2017, "Proximal Policy Optimization Algorithms" (PPO below)
//   Farebrother & Castro 2024, "CALE: Continuous Arcade Learning Environment": its two-branch encoder
#pragma once

#include <memory>

#include <torch/types.h>

#include "agents/agent.h"
#include "agents/on_policy.h"
#include "cale/fields.h"
#include "networks/ppo_network.h"

namespace cale {

/// The defaults are CALE's for 200 million frames.
struct PpoConfig : OnPolicySettings {
    static constexpr bool kDiscrete = false;  // the default of env.action_space: it learns with both kinds

    double clip = 0.1;
    bool clip_value_loss = true;
    double value_coefficient = 0.5;
    double entropy_coefficient = 0.01;
};

template <class Visit>
void fields(PpoConfig& config, Visit&& visit) {
    fields(static_cast<OnPolicySettings&>(config), visit);
    visit("clip", config.clip, Range{0, 10}, "how far a probability ratio counts, and a value may move");
    visit("clip_value_loss", config.clip_value_loss, "clip the value's change too");
    visit("value_coefficient", config.value_coefficient, Range{0, 1000}, "weight of the value's loss");
    visit("entropy_coefficient", config.entropy_coefficient, Range{0, 1000}, "weight of the entropy bonus");
}

/// Means over the minibatch, [] each. The first carries a gradient.
struct PpoLosses {
    torch::Tensor combined, actor, critic, entropy;  // what is minimised, and its three parts
    torch::Tensor approximate_kl, clipped_fraction;  // for the log
};

/// A pure function of its arguments; the advantages are used as they are (see normalized()). Throws
/// std::invalid_argument, naming both shapes, where the minibatch does not fit together.
PpoLosses ppo_losses(PpoNetwork& network, const RolloutBatch& minibatch, const PpoConfig& config);

/// Makes one gradient step, as the agent makes it where it is alone (on_policy()): at the scheduled learning
/// rate, on normalised advantages. Returns the losses before it, detached. For tests and benchmarks.
PpoLosses ppo_update(OnPolicyState& state, const RolloutBatch& minibatch, const PpoConfig& config);

/// Tags: losses/{loss, policy_loss, value_loss, entropy, approx_kl, clipfrac}, and those of on_policy(), as
/// the state. Throws as check_settings() does.
std::unique_ptr<Agent> make_ppo(const PpoConfig& config, const AgentSpec& spec);

}  // namespace cale
