// From stacked frames to feature vectors.
//   phi_sac  Yarats et al. 2021, "Improving Sample Efficiency in Model-Free RL from Images",
//            with padded convolutions as in Farebrother & Castro 2024 (CALE)
//   phi_dqn  Mnih et al. 2015, "Human-level control through deep reinforcement learning"
//   impala   Espeholt et al. 2018, "IMPALA", figure 3 right, without the LSTM
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include <torch/nn/module.h>
#include <torch/nn/modules/normalization.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/layers.h"

namespace cale {

/// The three encoders of the paper: see Trunk.
enum class EncoderKind { phi_sac, phi_dqn, impala };
/// conv2d: the convolutions as Mnih et al. meant them. row1d: as Dopamine's CALE agents run
/// them, where each row of the image is convolved by itself.
enum class PhiDqn { conv2d, row1d };
std::span<const std::string_view> names_of(EncoderKind);
std::span<const std::string_view> names_of(PhiDqn);

/// What an encoder is built from.
struct EncoderConfig {
    EncoderKind encoder = EncoderKind::phi_sac;  // which convolutions
    PhiDqn phi_dqn = PhiDqn::conv2d;             // which phi_dqn, where it is that
    std::int64_t stack = 4;                      // frames of an observation
    std::int64_t frame_height = 84;              // rows
    std::int64_t frame_width = 84;               // columns
    Padding padding = Padding::same;             // impala always pads
    Initialiser initialise = nullptr;            // none: the encoder's own
};

/// The convolutions of an encoder: [B, stack, H, W] uint8 -> [B, features()], flattened in
/// the order (channel, row, column). They are submodules of the owner that it is made with,
/// named conv1, conv2, ... (phi_sac, phi_dqn) or stage1_conv, stage1_block1_conv1, ... (impala).
///   phi_sac  32@3x3/2, 3 times 32@3x3/1, ReLU; orthogonal
///   phi_dqn  32@8x8/4, 64@4x4/2, 64@3x3/1, ReLU; Glorot
///   impala   16, 32 and 32 channels: conv 3x3, max pool 3x3/2, two residual blocks; Glorot
/// Pixels are divided by 255; every pool pads "SAME". (Dopamine has an impala for
/// CALE that no configuration uses and that neither scales nor flattens; this one does both.)
class Trunk {
  public:
    /// Throws std::invalid_argument for a frame or a stack without pixels.
    Trunk(torch::nn::Module& owner, const EncoderConfig& config, at::Generator generator);

    /// Throws std::invalid_argument, naming both shapes, for anything but [B, stack, H, W] uint8.
    torch::Tensor operator()(const torch::Tensor& observation) const;

    std::int64_t features() const { return features_; }  // numbers per observation

  private:
    torch::Tensor stacked_convolutions(torch::Tensor x) const;
    torch::Tensor residual_stages(torch::Tensor x) const;

    EncoderConfig config_;
    std::vector<Conv> convs_;
    std::int64_t features_ = 0;
};

/// A trunk, and nothing else.
class ConvEncoderImpl : public torch::nn::Module {
  public:
    ConvEncoderImpl(const EncoderConfig& config, at::Generator generator)
        : trunk_(*this, config, std::move(generator)) {}
    /// [B, stack, H, W] uint8 -> [B, size()]
    torch::Tensor forward(const torch::Tensor& observation) const { return trunk_(observation); }
    std::int64_t size() const { return trunk_.features(); }  // numbers per observation

  private:
    Trunk trunk_;
};
using ConvEncoder = torch::nn::ModuleHolder<ConvEncoderImpl>;

/// A trunk and Dense `size` with ReLU: the features that a policy and a value share and both train.
class SharedEncoderImpl : public torch::nn::Module {
  public:
    SharedEncoderImpl(const EncoderConfig& config, std::int64_t size, const Initialiser& initialise,
                      at::Generator generator);
    /// [B, stack, H, W] uint8 -> [B, size]
    torch::Tensor forward(const torch::Tensor& observation);

  private:
    Trunk trunk_;
    Dense fc_{nullptr};
};
using SharedEncoder = torch::nn::ModuleHolder<SharedEncoderImpl>;

/// One trunk and two heads on it, as the SAC and PPO agents of CALE have: the critic's trains
/// the trunk, the actor's does not.
///   phi_sac          Dense 50, LayerNorm, tanh on both branches
///   phi_dqn, impala  Dense 512, ReLU; LayerNorm before the ReLU on the critic's branch only
class TwoBranchEncoderImpl : public torch::nn::Module {
  public:
    TwoBranchEncoderImpl(const EncoderConfig& config, at::Generator generator);

    /// [B, stack, H, W] uint8 -> [B, features]
    torch::Tensor trunk(const torch::Tensor& observation) const { return trunk_(observation); }
    /// [B, features] -> [B, size()]
    torch::Tensor critic_branch(const torch::Tensor& features);
    /// [B, features] -> [B, size()]; no gradient passes back to the features.
    torch::Tensor actor_branch(const torch::Tensor& features);

    /// Units of either branch.
    std::int64_t size() const { return size_; }

  private:
    torch::Tensor activate(const torch::Tensor& x) const;

    EncoderKind kind_;
    std::int64_t size_;
    Trunk trunk_;
    Dense critic_fc_{nullptr}, actor_fc_{nullptr};
    torch::nn::LayerNorm critic_ln_{nullptr}, actor_ln_{nullptr};
};
using TwoBranchEncoder = torch::nn::ModuleHolder<TwoBranchEncoderImpl>;

}  // namespace cale
