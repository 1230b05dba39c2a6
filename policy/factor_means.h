// Action values from those of the choices that an action is made of.
#pragma once

#include <cstdint>
#include <vector>

namespace cale {

/// Returns the matrix [A, sum of factors], row by row, that makes the outputs of actions from those of their
/// choices: the mean over the sets (Seyde et al. 2023, "Solving Continuous Control via Q-learning", eq. 2).
std::vector<float> factor_means(const std::vector<std::int64_t>& factors);

}  // namespace cale
