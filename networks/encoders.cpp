#include "networks/encoders.h"

#include <array>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

#include <torch/nn/module.h>
#include <torch/nn/modules/normalization.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "networks/shapes.h"

namespace cale {
namespace {

constexpr double kLayerNormEpsilon = 1e-6;  // Flax's, not PyTorch's 1e-5

/// [B, C, H, W] bytes as numbers from 0 to 1, channels last: several times faster to convolve on a CPU than
/// channels first. There it is one pass by table; LibTorch's own three cost 8 % of an update of DQN.
torch::Tensor scaled_pixels(const torch::Tensor& bytes, at::ScalarType type) {
    if (!bytes.is_cpu() || type != at::kFloat) {
        return bytes.to(type).div_(255).contiguous(at::MemoryFormat::ChannelsLast);
    }
    static const auto table = [] {
        std::array<float, 256> values{};
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i) / 255;
        return values;
    }();
    const auto planes = bytes.contiguous();
    const auto channels = bytes.size(1), pixels = bytes.size(2) * bytes.size(3);
    auto scaled =
        torch::empty(bytes.sizes(), torch::dtype(at::kFloat).memory_format(at::MemoryFormat::ChannelsLast));
    const auto* from = planes.const_data_ptr<std::uint8_t>();
    auto* to = scaled.data_ptr<float>();
    at::parallel_for(0, bytes.size(0), /*grain_size=*/4, [&](std::int64_t begin, std::int64_t end) {
        for (std::int64_t image = begin * channels * pixels; image < end * channels * pixels;
             image += channels * pixels) {
            for (std::int64_t channel = 0; channel < channels; ++channel) {
                for (std::int64_t pixel = 0; pixel < pixels; ++pixel)
                    to[image + pixel * channels + channel] = table[from[image + channel * pixels + pixel]];
            }
        }
    });
    return scaled;
}

torch::Tensor max_pool_same(const torch::Tensor& x) {
    const auto [top, bottom] = same_padding(x.size(2), 3, 2);
    const auto [left, right] = same_padding(x.size(3), 3, 2);
    const auto padded =
        at::constant_pad_nd(x, {left, right, top, bottom}, -std::numeric_limits<double>::infinity());
    return at::max_pool2d(padded, 3, 2);
}

}  // namespace

std::span<const std::string_view> names_of(EncoderKind) {
    static constexpr std::array<std::string_view, 3> names{"phi_sac", "phi_dqn", "impala"};
    return names;
}

std::span<const std::string_view> names_of(PhiDqn) {
    static constexpr std::array<std::string_view, 2> names{"conv2d", "row1d"};
    return names;
}

Trunk::Trunk(torch::nn::Module& owner, const EncoderConfig& config, at::Generator generator)
    : config_(config) {
    if (config.stack < 1 || config.frame_height < 1 || config.frame_width < 1) {
        throw std::invalid_argument("an encoder needs at least one frame of at least one pixel, not " +
                                    shape_text({config.stack, config.frame_height, config.frame_width}));
    }
    std::int64_t channels = config.stack;
    // Impala's residual blocks add what goes into them to what comes out: both have one size.
    const auto padding = config.encoder == EncoderKind::impala ? Padding::same : config.padding;
    const auto add = [&](const std::string& name, std::int64_t out, std::int64_t kernel, std::int64_t stride,
                         const Initialiser& own) {
        const auto& initialise = config.initialise ? config.initialise : own;
        convs_.push_back(
            owner.register_module(name, Conv(channels, out, kernel, stride, initialise, generator, padding)));
        channels = out;
    };
    switch (config.encoder) {
        case EncoderKind::phi_sac:
            add("conv1", 32, 3, 2, orthogonal());
            for (const auto* name : {"conv2", "conv3", "conv4"}) add(name, 32, 3, 1, orthogonal());
            break;
        case EncoderKind::phi_dqn:
            add("conv1", 32, 8, 4, glorot_uniform());
            add("conv2", 64, 4, 2, glorot_uniform());
            add("conv3", 64, 3, 1, glorot_uniform());
            break;
        case EncoderKind::impala:
            for (const auto& [stage, out] : {std::pair{"stage1", 16}, {"stage2", 32}, {"stage3", 32}}) {
                for (const auto* conv :
                     {"_conv", "_block1_conv1", "_block1_conv2", "_block2_conv1", "_block2_conv2"})
                    add(std::string(stage) + conv, out, 3, 1, glorot_uniform());
            }
            break;
    }
    const torch::NoGradGuard no_grad;
    features_ =
        (*this)(torch::zeros({1, config.stack, config.frame_height, config.frame_width}, torch::kUInt8))
            .size(1);
}

torch::Tensor Trunk::operator()(const torch::Tensor& observation) const {
    const bool matches = observation.dim() == 4 && observation.size(1) == config_.stack &&
                         observation.size(2) == config_.frame_height &&
                         observation.size(3) == config_.frame_width;
    if (!matches || observation.scalar_type() != torch::kUInt8) {
        throw std::invalid_argument(
            "the encoder reads observations of shape [B, " + std::to_string(config_.stack) + ", " +
            std::to_string(config_.frame_height) + ", " + std::to_string(config_.frame_width) +
            "] and type uint8, not " + shape_text(observation.sizes()) + " " +
            std::string(observation.dtype().name()));
    }
    auto x = scaled_pixels(observation, convs_.front()->weight.scalar_type());
    x = config_.encoder == EncoderKind::impala ? residual_stages(x) : stacked_convolutions(x);
    return x.flatten(1);
}

torch::Tensor Trunk::stacked_convolutions(torch::Tensor x) const {
    const bool rows = config_.encoder == EncoderKind::phi_dqn && config_.phi_dqn == PhiDqn::row1d;
    for (const auto& conv : convs_) x = (rows ? conv->forward_rows(x) : conv->forward(x)).relu_();
    return x;
}

torch::Tensor Trunk::residual_stages(torch::Tensor x) const {
    for (std::size_t stage = 0; stage < convs_.size(); stage += 5) {
        x = max_pool_same(convs_[stage]->forward(x));
        for (const std::size_t block : {stage + 1, stage + 3}) {
            const auto inner = convs_[block]->forward(x.relu()).relu_();
            x = x + convs_[block + 1]->forward(inner);
        }
    }
    return x.relu();
}

SharedEncoderImpl::SharedEncoderImpl(const EncoderConfig& config, std::int64_t size,
                                     const Initialiser& initialise, at::Generator generator)
    : trunk_(*this, config, generator),
      fc_(register_module("fc", Dense(trunk_.features(), size, initialise, generator))) {}

torch::Tensor SharedEncoderImpl::forward(const torch::Tensor& observation) {
    return fc_(trunk_(observation)).relu();
}

TwoBranchEncoderImpl::TwoBranchEncoderImpl(const EncoderConfig& config, at::Generator generator)
    : kind_(config.encoder),
      size_(config.encoder == EncoderKind::phi_sac ? 50 : 512),
      trunk_(*this, config, generator) {
    const bool phi_sac = kind_ == EncoderKind::phi_sac;
    const auto initialise = phi_sac ? orthogonal() : glorot_uniform();
    const auto layer_norm = torch::nn::LayerNormOptions({size_}).eps(kLayerNormEpsilon);
    critic_fc_ = register_module("critic_fc", Dense(trunk_.features(), size_, initialise, generator));
    critic_ln_ = register_module("critic_ln", torch::nn::LayerNorm(layer_norm));
    actor_fc_ = register_module("actor_fc", Dense(trunk_.features(), size_, initialise, generator));
    if (phi_sac) actor_ln_ = register_module("actor_ln", torch::nn::LayerNorm(layer_norm));
}

torch::Tensor TwoBranchEncoderImpl::critic_branch(const torch::Tensor& features) {
    return activate(critic_ln_(critic_fc_(features)));
}

torch::Tensor TwoBranchEncoderImpl::actor_branch(const torch::Tensor& features) {
    const auto x = actor_fc_(features.detach());
    return activate(actor_ln_ ? actor_ln_(x) : x);
}

torch::Tensor TwoBranchEncoderImpl::activate(const torch::Tensor& x) const {
    return kind_ == EncoderKind::phi_sac ? x.tanh() : x.relu();
}

}  // namespace cale
