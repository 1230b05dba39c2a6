// The acting half of an agent's network, computed as the agent computes it, bit for bit.
#pragma once

#include <map>
#include <string>
#include <vector>

#include <torch/nn/module.h>
#include <torch/types.h>

#include "networks/layer_stack.h"
#include "policy/network_spec.h"

namespace cale {

class ActorNetwork {
  public:
    /// With these weights, by the names of parameter_shapes(network).
    ActorNetwork(const NetworkSpec& network, const std::map<std::string, std::vector<float>>& weights,
                 torch::Device device);

    /// [N, observation] uint8 on the network's device -> Policy::output there. `watch` sees all activations.
    /// Throws std::invalid_argument, naming both shapes, for anything else.
    torch::Tensor output(const torch::Tensor& observations, const LayerStack::Watch& watch = {}) const;

  private:
    torch::Tensor action_values(const torch::Tensor& features) const;

    Head head_;
    torch::nn::Module owner_;  // of the layers' parameters
    LayerStack layers_;        // up to the head
    std::vector<Dense> last_;  // the head's
    torch::Tensor log_std_;    // [3], of a gaussian head
    torch::Tensor support_;    // [atoms], of a distribution
};

}  // namespace cale
