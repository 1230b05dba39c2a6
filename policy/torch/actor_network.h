// The acting half of an agent's network, computed as the agent computes it, bit for bit.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include <torch/types.h>

#include "networks/encoders.h"
#include "networks/layers.h"
#include "policy/network.h"

namespace cale {

class ActorNetwork {
  public:
    /// With these weights, by the names of parameters_of(network).
    ActorNetwork(const PolicyNetwork& network, const std::map<std::string, std::vector<float>>& weights,
                 torch::Device device);

    /// [N, stack, H, W] uint8 on the network's device -> Policy::output there. Throws as Trunk does.
    torch::Tensor output(const torch::Tensor& observations) const;

  private:
    struct Encoder;
    struct Head;
    torch::Tensor branch(const torch::Tensor& features) const;
    torch::Tensor action_values(const torch::Tensor& hidden) const;

    PolicyNetwork network_;
    std::shared_ptr<Encoder> encoder_;
    std::shared_ptr<Head> head_;
    torch::Tensor support_;  // [atoms], of a distribution
};

}  // namespace cale
