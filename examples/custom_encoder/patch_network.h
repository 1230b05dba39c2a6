// An encoder that this project does not have, and a network around it.
#pragma once

#include <cstdint>

#include <ATen/core/Generator.h>
#include <networks/layers.h>
#include <networks/q_network.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

namespace example {

/// Cuts a frame into patches of 12 x 12 pixels, each of which becomes a vector, as vision transformers begin
/// (Dosovitskiy et al. 2021); a 3x3 convolution lets neighbours know of each other.
class PatchEncoderImpl : public torch::nn::Module {
  public:
    PatchEncoderImpl(std::int64_t stack, std::int64_t height, std::int64_t width, std::int64_t channels,
                     at::Generator generator);
    /// [B, stack, H, W] uint8 -> [B, size()]
    torch::Tensor forward(const torch::Tensor& observation) const;
    std::int64_t size() const { return size_; }

  private:
    std::int64_t size_;
    cale::Conv patches_{nullptr}, neighbours_{nullptr};
};
using PatchEncoder = torch::nn::ModuleHolder<PatchEncoderImpl>;

/// The encoder, and cale's own head for action values.
class PatchNetworkImpl : public torch::nn::Module {
  public:
    PatchNetworkImpl(PatchEncoder encoder, const cale::QHeadConfig& head, at::Generator generator);
    /// [B, stack, H, W] uint8 -> [B, A]
    torch::Tensor forward(const torch::Tensor& observation);

  private:
    PatchEncoder encoder_{nullptr};
    cale::QHead head_{nullptr};
};
using PatchNetwork = torch::nn::ModuleHolder<PatchNetworkImpl>;

}  // namespace example
