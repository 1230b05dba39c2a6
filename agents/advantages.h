// Generalised advantage estimation over a rollout.
#pragma once

#include <torch/types.h>

namespace cale {

/// Advantages and returns, both of the rewards' shape.
struct Advantages {
    torch::Tensor advantage, returns;  // returns: advantage + value
};

/// Schulman et al. 2016, "High-Dimensional Continuous Control Using Generalized Advantage Estimation" (GAE),
/// equation 16, along the first axis: rewards, terminals (1 where nothing follows) and values
/// [T, N], the value of what follows the last step [N].
Advantages generalized_advantages(const torch::Tensor& reward, const torch::Tensor& terminal,
                                  const torch::Tensor& value, const torch::Tensor& next_value, double gamma,
                                  double lambda);

}  // namespace cale
