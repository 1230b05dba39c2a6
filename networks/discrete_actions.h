// Actions that are numbers: their values, and random ones in their place.
#pragma once

#include <cstdint>

#include <ATen/core/Generator.h>
#include <torch/types.h>

namespace cale {

/// values[b, actions[b]] of values [B, A] and actions [B] int64: [B].
inline torch::Tensor gather_actions(const torch::Tensor& values, const torch::Tensor& actions) {
    return values.gather(1, actions.unsqueeze(1)).squeeze(1);
}

/// Replaces each of `actions` [N] int64, on the CPU, by a uniform one out of `num_actions` with this
/// probability, as epsilon_greedy() of networks/heads.h does with coordinates.
inline torch::Tensor epsilon_greedy(const torch::Tensor& actions, double epsilon, std::int64_t num_actions,
                                    const at::Generator& random) {
    const auto chosen = torch::rand({actions.size(0)}, random) <= epsilon;
    const auto uniform = torch::randint(0, num_actions, actions.sizes(), random, torch::kInt64);
    return torch::where(chosen, uniform, actions);
}

}  // namespace cale
