// The layers of a NetworkSpec as LibTorch computes them.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <variant>
#include <vector>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/modules/normalization.h>
#include <torch/types.h>

#include "networks/layers.h"
#include "policy/network_spec.h"

namespace cale {

/// Layers one behind the other. Those with parameters are submodules of the owner that it is made with, under
/// their names.
class LayerStack {
  public:
    /// Is shown the result of every ReLU and every tanh.
    using Watch = std::function<void(const torch::Tensor&)>;

    /// On an input [stack, rows, columns], [stack, bytes] or [n]. Throws as sized_layers() does.
    LayerStack(torch::nn::Module& owner, const Layers& layers, const std::vector<std::int64_t>& input,
               const Initialiser& initialise, const at::Generator& generator);

    /// [B, input] numbers -> [B, features()], or [B, C, H, W] where nothing is flattened. The noise of noisy
    /// layers is drawn from `noise`, for each row; without it they are their means.
    torch::Tensor operator()(torch::Tensor x, const Watch& watch = {},
                             const std::optional<at::Generator>& noise = std::nullopt) const;

    /// [B, input] bytes as numbers from 0 to 1, of the layers' own type or bf16: what the layers then compute
    /// in. Throws std::invalid_argument, naming both shapes, for anything else.
    torch::Tensor scaled(const torch::Tensor& observation, Precision precision = Precision::float32) const;

    std::int64_t features() const { return features_; }  // numbers per observation

  private:
    using Parameters = std::variant<std::monostate, Conv, AnyDense, torch::nn::LayerNorm>;
    struct Item {
        Layer layer;
        Parameters parameters;
    };

    std::vector<std::int64_t> input_;
    std::int64_t features_ = 0;
    std::vector<Item> items_;
    torch::Tensor weight_;  // of the first layer that has one: its type is that of the input
};

}  // namespace cale
