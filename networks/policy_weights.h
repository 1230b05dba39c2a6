// The weights of the half of a network that acts, as a policy file stores them.
#pragma once

#include <torch/nn/module.h>

#include "networks/layers.h"
#include "policy/network_spec.h"

namespace cale {

/// Returns the parameters of `spec` by the names of parameter_shapes(), float32 on the CPU in memory of their
/// own: those of `module` that are called so. Of noisy layers `weight` and `bias` are the means; log standard
/// deviations that are a sum (LogStd::summed) are stored as that sum. Throws std::invalid_argument that names
/// a parameter which the module lacks or has in another shape.
TensorMap policy_weights(const NetworkSpec& spec, const torch::nn::Module& module);

}  // namespace cale
