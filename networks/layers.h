// Dense and convolutional layers, which compute in the type of their input. Their initial values are drawn
// from a generator of the caller's: torch::nn::Linear and Conv2d would draw theirs from the global one.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/modules/normalization.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "policy/network_spec.h"

namespace cale {

/// Tensors by name: a network's parameters, an agent's state, the contents of a safetensors file.
using TensorMap = std::map<std::string, torch::Tensor>;

/// What convolutions and products compute in. bf16: bfloat16; parameters, LayerNorm's sums, losses and
/// optimisers stay float32 (Micikevicius et al. 2018, "Mixed Precision Training", without scaled losses).
enum class Precision { float32, bf16 };
std::span<const std::string_view> names_of(Precision);

/// Fills a weight, [out, in] or [out, in, rows, columns], on the CPU.
using Initialiser = std::function<void(torch::Tensor& weight, at::Generator generator)>;

/// An undefined generator, for counting parameters. Dense layers then have shapes but no values, and take no
/// memory (LibTorch's device "meta"); convolutions, which are small, are zero.
inline at::Generator no_values() {
    return {};
}

/// A (semi-)orthogonal [out, in * rows * columns] matrix times `gain` (Saxe et al. 2014).
Initialiser orthogonal(double gain = 1);
/// Uniform within +-sqrt(6 / (fan_in + fan_out)); fans count the receptive field (Glorot & Bengio 2010).
Initialiser glorot_uniform();
/// Zeros: a last layer that begins like this gives 0 for everything.
Initialiser zeros();

/// LayerNorm, whose sums are of its own parameters' type: [B, n] -> [B, n] of the input's type.
torch::Tensor normalised(const torch::nn::LayerNormImpl& norm, const torch::Tensor& x);

/// x W^T + b. weight [out, in], bias [out], which starts at zero.
class DenseImpl : public torch::nn::Module {
  public:
    DenseImpl(std::int64_t in, std::int64_t out, const Initialiser& initialise, at::Generator generator);
    /// [B, in] -> [B, out]
    torch::Tensor forward(const torch::Tensor& x) const;

    torch::Tensor weight, bias;  // [out, in] and [out]
};
using Dense = torch::nn::ModuleHolder<DenseImpl>;

/// The standard normal numbers of one pass through a noisy layer, drawn per feature and not per
/// weight: input [in], output [out] for the whole batch, or input [B, in], output [B, out] with a draw
/// for each row.
struct FactorisedNoise {
    torch::Tensor input, output;  // [in] and [out], or [B, in] and [B, out]
};

/// A dense layer whose weights are noisy (Fortunato et al. 2018, "Noisy Networks for Exploration",
/// equations 9-11): W = mu + sigma * f(output) f(input)^T, b = mu + sigma * f(output), f(x) = sign(x)
/// sqrt|x|. mu starts uniform within +-1/sqrt(in), sigma at initial_sigma / sqrt(in).
class NoisyDenseImpl : public torch::nn::Module {
  public:
    NoisyDenseImpl(std::int64_t in, std::int64_t out, double initial_sigma, at::Generator generator);
    /// [B, in] -> [B, out]; without noise the weights are mu.
    torch::Tensor forward(const torch::Tensor& x, const FactorisedNoise* noise = nullptr) const;

    torch::Tensor weight_mu, weight_sigma;  // [out, in]
    torch::Tensor bias_mu, bias_sigma;      // [out]
};
using NoisyDense = torch::nn::ModuleHolder<NoisyDenseImpl>;

/// A layer that is either plain, and ignores noise, or noisy.
struct AnyDense {
    Dense plain{nullptr};       // or none
    NoisyDense noisy{nullptr};  // or none
    /// [B, in] -> [B, out]
    torch::Tensor operator()(const torch::Tensor& x, const FactorisedNoise* noise = nullptr) const {
        return plain ? plain->forward(x) : noisy->forward(x, noise);
    }
    torch::Tensor weight() const { return plain ? plain->weight : noisy->weight_mu; }  // [out, in]
};
/// Returns a layer, registered with its owner: noisy with an `initial_sigma`, else plain and initialised so.
AnyDense add_dense(torch::nn::Module& owner, const std::string& name, std::int64_t in, std::int64_t out,
                   const Initialiser& initialise, std::optional<double> initial_sigma,
                   const at::Generator& generator);

/// A square convolution. weight [out, in, kernel, kernel], bias [out], zero at first.
class ConvImpl : public torch::nn::Module {
  public:
    ConvImpl(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride,
             const Initialiser& initialise, at::Generator generator, Padding padding = Padding::same);

    /// [B, in, H, W] -> [B, out, H', W'], channels last
    torch::Tensor forward(const torch::Tensor& x) const;

    /// Convolves every row by itself: [B, in, H, W] -> [B, out, H, ceil(W / stride)].
    /// The kernel's first axis runs along the row; of its second axis only the position
    /// that "SAME" padding puts on an axis of one pixel is used.
    torch::Tensor forward_rows(const torch::Tensor& x) const;

    torch::Tensor weight, bias;  // [out, in, kernel, kernel] and [out]

  private:
    std::int64_t kernel_, stride_;
    Padding padding_;
};
using Conv = torch::nn::ModuleHolder<ConvImpl>;

// Shapes are checked where tensors enter: [B] against [B, 1] would broadcast in silence.

/// "[32, 4, 84, 84]"
std::string shape_text(at::IntArrayRef shape);

/// Throws std::invalid_argument that names `who` was given `what` in which shape, and which one it expects.
void require_shape(std::string_view who, std::string_view what, const torch::Tensor& tensor,
                   at::IntArrayRef expected);

}  // namespace cale
