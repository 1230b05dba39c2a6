// What SAC's critics learn of a state and an action: the mean return, or the return's distribution
// (agents/c51.h).
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include <torch/types.h>

#include "agents/c51.h"
#include "cale/fields.h"
#include "networks/actor_critic.h"
#include "replay/types.h"

namespace cale {

/// Whose action the critics' target values: see CriticSettings::target.
enum class CriticTarget { target_mean_action, sampled_action };
std::span<const std::string_view> names_of(CriticTarget);

/// Of SAC: configuration keys critic_target, critic_atoms and critic_limit.
struct CriticSettings {
    CriticTarget target = CriticTarget::target_mean_action;
    std::int64_t atoms = 1;
    double limit = 10;

    /// Returns the atoms' returns, float32 on the CPU; undefined for a critic of the mean.
    torch::Tensor support() const;
};

template <class Visit>
void fields(CriticSettings& settings, Visit&& visit) {
    visit("critic_target", settings.target,
          "target_mean_action: value of the target actor's mean action; sampled_action: of the online "
          "actor's sample, as in Haarnoja et al.");
    visit("critic_atoms", settings.atoms, Range{1, 1'000},
          "returns that the distribution of a critic is made of (C51); 1: it learns the mean return");
    visit("critic_limit", settings.limit, Range{1e-6, 1e9},
          "several atoms lie evenly from minus this to this; scaled returns, with the entropy's part, stay "
          "between");
}

/// The targets of both critics at the stored actions.
struct CriticTargets {
    torch::Tensor values;             // [B] y, not cut at critic_limit
    torch::Tensor distribution = {};  // [B, atoms] of y, projected; undefined for critics of the mean
};

/// Returns the targets that follow from the target critics' `outputs` at the next states, those of
/// SacNetworkImpl::outputs(); `support` is [atoms] or undefined. `bonus` [B], -alpha log pi in SAC's equation
/// 3, is added to their values. Of two distributions the one with the smaller mean is taken for each
/// transition, or their mixture (`estimate`).
CriticTargets critic_targets(const TwinValues& outputs, const torch::Tensor& support, TwinEstimate estimate,
                             const torch::Tensor& bonus, const Batch& batch, double reward_scale);

/// Returns the sum of both critics' mean losses [], with gradients, for `outputs` at the stored actions:
/// squared errors, SAC's equation 5 without its factor 1/2; of distributions cross-entropies, as at the end
/// of C51's algorithm 1.
torch::Tensor critic_loss(const TwinValues& outputs, const torch::Tensor& support,
                          const CriticTargets& targets);

}  // namespace cale
