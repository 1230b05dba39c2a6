#include "networks/layers.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <torch/nn/init.h>
#include <torch/utils.h>

namespace cale {

std::span<const std::string_view> names_of(Precision) {
    static constexpr std::string_view names[] = {"float32", "bf16"};
    return names;
}

Initialiser orthogonal(double gain) {
    return [gain](torch::Tensor& weight, at::Generator generator) {
        const torch::NoGradGuard no_grad;
        const auto out = weight.size(0);
        const auto in = weight.numel() / out;
        auto normal = torch::empty({std::max(out, in), std::min(out, in)}, weight.options());
        normal.normal_(0, 1, generator);
        const auto [q, r] = at::linalg_qr(normal);
        // The signs make the distribution uniform over the orthogonal matrices (Mezzadri 2007).
        const auto columns = q * r.diagonal().sign() * gain;
        weight.copy_((out < in ? columns.t() : columns).reshape(weight.sizes()));
    };
}

Initialiser glorot_uniform() {
    return [](torch::Tensor& weight, at::Generator generator) {
        const torch::NoGradGuard no_grad;
        const auto receptive_field = weight.numel() / (weight.size(0) * weight.size(1));
        const auto fans = static_cast<double>((weight.size(0) + weight.size(1)) * receptive_field);
        const double bound = std::sqrt(6 / fans);
        weight.uniform_(-bound, bound, generator);
    };
}

Initialiser zeros() {
    return [](torch::Tensor& weight, const at::Generator&) { torch::nn::init::zeros_(weight); };
}

namespace {

/// Where a layer that is made with this generator is.
torch::Device device_for(const at::Generator& generator) {
    return generator.defined() ? torch::kCPU : torch::kMeta;
}

/// x W^T + b.
torch::Tensor affine(const torch::Tensor& x, const torch::Tensor& parameter_w,
                     const torch::Tensor& parameter_b) {
    const auto weight = parameter_w.to(x.scalar_type()), bias = parameter_b.to(x.scalar_type());
    if (!x.is_cpu()) return at::linear(x, weight, bias);
    // (W x^T)^T: for a small batch behind a wide trunk MKL is a third faster at it than at x W^T.
    return at::addmm(bias.unsqueeze(1), weight, x.t()).t();
}

}  // namespace

torch::Tensor normalised(const torch::nn::LayerNormImpl& norm, const torch::Tensor& x) {
    return torch::layer_norm(x.to(norm.weight.scalar_type()), norm.options.normalized_shape(), norm.weight,
                             norm.bias, norm.options.eps())
        .to(x.scalar_type());
}

DenseImpl::DenseImpl(std::int64_t in, std::int64_t out, const Initialiser& initialise,
                     at::Generator generator)
    : weight(register_parameter("weight", torch::empty({out, in}, device_for(generator)))),
      bias(register_parameter("bias", torch::zeros({out}, device_for(generator)))) {
    if (generator.defined()) initialise(weight, std::move(generator));
}

torch::Tensor DenseImpl::forward(const torch::Tensor& x) const {
    return affine(x, weight, bias);
}

NoisyDenseImpl::NoisyDenseImpl(std::int64_t in, std::int64_t out, double initial_sigma,
                               at::Generator generator)
    : weight_mu(register_parameter("weight_mu", torch::empty({out, in}, device_for(generator)))),
      weight_sigma(register_parameter("weight_sigma", torch::empty({out, in}, device_for(generator)))),
      bias_mu(register_parameter("bias_mu", torch::empty({out}, device_for(generator)))),
      bias_sigma(register_parameter("bias_sigma", torch::empty({out}, device_for(generator)))) {
    if (!generator.defined()) return;
    const torch::NoGradGuard no_grad;
    const double bound = 1 / std::sqrt(static_cast<double>(in));
    for (auto* mu : {&weight_mu, &bias_mu}) mu->uniform_(-bound, bound, generator);
    for (auto* sigma : {&weight_sigma, &bias_sigma}) sigma->fill_(initial_sigma * bound);
}

torch::Tensor NoisyDenseImpl::forward(const torch::Tensor& x, const FactorisedNoise* noise) const {
    if (noise == nullptr) return affine(x, weight_mu, bias_mu);
    const auto f = [&](const torch::Tensor& normal) {
        return (normal.sign() * normal.abs().sqrt()).to(x.scalar_type());
    };
    // The same as multiplying by W, without ever writing W down: it is as large as the layer.
    const auto perturbed = affine(x * f(noise->input), weight_sigma, bias_sigma);
    return affine(x, weight_mu, bias_mu) + perturbed * f(noise->output);
}

AnyDense add_dense(torch::nn::Module& owner, const std::string& name, std::int64_t in, std::int64_t out,
                   const Initialiser& initialise, std::optional<double> initial_sigma,
                   const at::Generator& generator) {
    AnyDense dense;
    if (initial_sigma) {
        dense.noisy = owner.register_module(name, NoisyDense(in, out, *initial_sigma, generator));
    } else {
        dense.plain = owner.register_module(name, Dense(in, out, initialise, generator));
    }
    return dense;
}

ConvImpl::ConvImpl(std::int64_t in, std::int64_t out, std::int64_t kernel, std::int64_t stride,
                   const Initialiser& initialise, at::Generator generator, Padding padding)
    : weight(register_parameter("weight", torch::zeros({out, in, kernel, kernel}))),
      bias(register_parameter("bias", torch::zeros({out}))),
      kernel_(kernel),
      stride_(stride),
      padding_(padding) {
    if (generator.defined()) initialise(weight, std::move(generator));
}

torch::Tensor ConvImpl::forward(const torch::Tensor& x) const {
    const auto kernel = weight.to(x.scalar_type()), offset = bias.to(x.scalar_type());
    if (padding_ == Padding::valid) return at::conv2d(x, kernel, offset, stride_);
    const auto [top, bottom] = same_padding(x.size(2), kernel_, stride_);
    const auto [left, right] = same_padding(x.size(3), kernel_, stride_);
    // at::conv2d pads both sides alike; the copy is only made where they differ.
    if (top == bottom && left == right) return at::conv2d(x, kernel, offset, stride_, {top, left});
    return at::conv2d(at::constant_pad_nd(x, {left, right, top, bottom}), kernel, offset, stride_);
}

torch::Tensor ConvImpl::forward_rows(const torch::Tensor& x) const {
    const auto [left, right] = same_padding(x.size(3), kernel_, stride_);
    const auto used = same_padding(1, kernel_, stride_).first;
    const auto row_kernel = weight.select(3, used).unsqueeze(2).to(x.scalar_type());  // [out, in, 1, kernel]
    return at::conv2d(at::constant_pad_nd(x, {left, right}), row_kernel, bias.to(x.scalar_type()),
                      {1, stride_});
}

std::string shape_text(at::IntArrayRef shape) {
    std::string text = "[";
    for (const auto size : shape) text += (text.size() > 1 ? ", " : "") + std::to_string(size);
    return text + "]";
}

void require_shape(std::string_view who, std::string_view what, const torch::Tensor& tensor,
                   at::IntArrayRef expected) {
    if (tensor.defined() && tensor.sizes() == expected) return;
    throw std::invalid_argument(std::string(who) + ": " + std::string(what) + " must have the shape " +
                                shape_text(expected) + ", not " +
                                (tensor.defined() ? shape_text(tensor.sizes()) : "none at all"));
}

}  // namespace cale
