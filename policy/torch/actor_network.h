// The acting half of an agent's network, computed in float32 as the agent computes it, bit for bit.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "networks/layer_stack.h"
#include "policy/network_spec.h"

namespace cale {

/// A NetworkSpec with its weights, on a device.
class ActorNetwork {
  public:
    /// With these weights, by the names of parameter_shapes(network).
    ActorNetwork(const NetworkSpec& network, const std::map<std::string, std::vector<float>>& weights,
                 torch::Device device);

    /// [N, observation] uint8 on the network's device -> Policy::output there. `watch` sees all activations.
    /// The noise of noisy layers is drawn from `noise`, in the order of QHead::draw_noise() with N rows;
    /// without it they are their means. Throws std::invalid_argument, naming both shapes, for anything else.
    torch::Tensor output(const torch::Tensor& observations, const LayerStack::Watch& watch = {},
                         const std::optional<at::Generator>& noise = std::nullopt) const;

  private:
    torch::Tensor action_values(const torch::Tensor& features, const torch::Tensor& input_noise,
                                const std::optional<at::Generator>& noise) const;

    Head head_;
    torch::nn::Module owner_;     // of the layers' parameters
    LayerStack layers_;           // up to the head
    std::vector<AnyDense> last_;  // the head's
    torch::Tensor log_std_;       // [A], of a gaussian head
    torch::Tensor combine_;       // factor_matrix(), of a head with factors
    torch::Tensor support_;       // [atoms], of a distribution
};

}  // namespace cale
