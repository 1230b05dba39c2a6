// The distribution of a return, of DER and of SAC's critics.
//   Bellemare et al. 2017, "A Distributional Perspective on Reinforcement Learning" (C51 below)
#pragma once

#include <cstdint>

#include <torch/types.h>

namespace cale {

/// Returns the support of a distribution: `num_atoms` returns, evenly from -limit to limit, [atoms].
torch::Tensor atom_support(std::int64_t num_atoms, double limit, const torch::TensorOptions& options);

/// C51's projection (its equation 7): a distribution [B, atoms] over the returns `returns` [B, atoms] as
/// one over `support` [atoms].
torch::Tensor project_distribution(const torch::Tensor& returns, const torch::Tensor& probabilities,
                                   const torch::Tensor& support);

/// Returns the cross-entropy [B] of a predicted distribution, by its logits [B, atoms], from `target`.
torch::Tensor cross_entropy(const torch::Tensor& target, const torch::Tensor& logits);

}  // namespace cale
