// Dense and convolutional layers whose initial values are drawn from a generator of
// the caller's: torch::nn::Linear and Conv2d would draw theirs from the global one.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

namespace cale {

/// Fills a weight, [out, in] or [out, in, rows, columns], on the CPU.
using Initialiser = std::function<void(torch::Tensor& weight, at::Generator generator)>;

/// A (semi-)orthogonal [out, in * rows * columns] matrix times `gain` (Saxe et al. 2014).
Initialiser orthogonal(double gain = 1);
/// Uniform within +-sqrt(6 / (fan_in + fan_out)); fans count the receptive field (Glorot & Bengio 2010).
Initialiser glorot_uniform();

/// x W^T + b. weight [out, in], bias [out], which starts at zero.
class DenseImpl : public torch::nn::Module {
  public:
    DenseImpl(std::int64_t in, std::int64_t out, const Initialiser& initialise, at::Generator generator);
    /// [B, in] -> [B, out]
    torch::Tensor forward(const torch::Tensor& x) const;

    torch::Tensor weight, bias;
};
using Dense = torch::nn::ModuleHolder<DenseImpl>;

/// Zeros (before, after) an axis that make a convolution return ceil(size / stride)
/// positions. An odd total puts the extra zero after, as JAX's and TensorFlow's "SAME" do.
std::pair<std::int64_t, std::int64_t> same_padding(std::int64_t size, std::int64_t kernel,
                                                   std::int64_t stride);

/// A square convolution with "SAME" padding. weight [out, in, kernel, kernel], bias [out], zero at first.
class ConvImpl : public torch::nn::Module {
  public:
    ConvImpl(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride,
             const Initialiser& initialise, at::Generator generator);

    /// [B, in, H, W] -> [B, out, ceil(H / stride), ceil(W / stride)]
    torch::Tensor forward(const torch::Tensor& x) const;

    /// Convolves every row by itself: [B, in, H, W] -> [B, out, H, ceil(W / stride)].
    /// The kernel's first axis runs along the row; of its second axis only the position
    /// that "SAME" padding puts on an axis of one pixel is used.
    torch::Tensor forward_rows(const torch::Tensor& x) const;

    torch::Tensor weight, bias;

  private:
    std::int64_t kernel_, stride_;
};
using Conv = torch::nn::ModuleHolder<ConvImpl>;

}  // namespace cale
