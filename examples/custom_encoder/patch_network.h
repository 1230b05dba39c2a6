// An encoder that this project does not have, and a network around it.
#pragma once

#include <cstdint>
#include <vector>

#include <ATen/core/Generator.h>
#include <networks/layer_stack.h>
#include <networks/q_network.h>
#include <policy/network_spec.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

namespace example {

/// Cuts a frame into patches of 12 x 12 pixels, each of which becomes a vector, as vision transformers begin
/// (Dosovitskiy et al. 2021); a 3x3 convolution lets neighbours know of each other. Of layers that policy
/// files know, so a policy that was trained with it is exported and played as any other.
cale::Layers patch_layers(std::int64_t channels);

/// Those layers as a module.
class PatchEncoderImpl : public torch::nn::Module {
  public:
    PatchEncoderImpl(const std::vector<std::int64_t>& observation, std::int64_t channels,
                     const at::Generator& generator);
    /// [B, stack, H, W] uint8 -> [B, size()]
    torch::Tensor forward(const torch::Tensor& observation) const {
        return stack_(stack_.scaled(observation));
    }
    std::int64_t size() const { return stack_.features(); }

  private:
    cale::LayerStack stack_;
};
using PatchEncoder = torch::nn::ModuleHolder<PatchEncoderImpl>;

/// The encoder, and cale's own head for action values.
class PatchNetworkImpl : public torch::nn::Module {
  public:
    PatchNetworkImpl(const std::vector<std::int64_t>& observation, std::int64_t channels,
                     const cale::QHeadConfig& head, const at::Generator& generator);
    /// [B, stack, H, W] uint8 -> [B, A]
    torch::Tensor forward(const torch::Tensor& observation);

    cale::NetworkSpec acting;  // what a policy file says of it

  private:
    PatchEncoder encoder_{nullptr};
    cale::QHead head_{nullptr};
};
using PatchNetwork = torch::nn::ModuleHolder<PatchNetworkImpl>;

}  // namespace example
