#include "networks/policy_weights.h"

#include <stdexcept>
#include <string>

#include <torch/types.h>
#include <torch/utils.h>

#include "networks/layers.h"
#include "policy/network_parameters.h"

namespace cale {
namespace {

torch::Tensor stored_parameter(const torch::OrderedDict<std::string, torch::Tensor>& parameters,
                               const std::string& name) {
    if (const auto* exact = parameters.find(name)) return *exact;
    if (const auto* mean = parameters.find(name + "_mu")) return *mean;
    const auto* weight = parameters.find(name + ".weight");
    const auto* bias = parameters.find(name + ".bias");
    if (weight != nullptr && bias != nullptr) return weight->sum(1) + *bias;
    throw std::invalid_argument("the network has no parameter '" + name + "'");
}

}  // namespace

TensorMap policy_weights(const NetworkSpec& spec, const torch::nn::Module& module) {
    const torch::NoGradGuard no_grad;
    const auto parameters = module.named_parameters();
    TensorMap weights;
    for (const auto& [name, shape] : parameter_shapes(spec)) {
        const auto tensor = stored_parameter(parameters, name).detach();
        require_shape("policy_weights", "'" + name + "'", tensor, shape);
        weights[name] =
            tensor.to(torch::kCPU, torch::kFloat32, /*non_blocking=*/false, /*copy=*/true).contiguous();
    }
    return weights;
}

}  // namespace cale
