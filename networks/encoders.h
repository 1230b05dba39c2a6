// From observations to feature vectors: the layers of an encoder as modules.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/layer_stack.h"
#include "networks/layers.h"
#include "policy/network_spec.h"

namespace cale {

/// The encoders that agents choose from: one row each of the table in encoder_table.cpp. Their layers are in
/// policy/encoder_layers.h.
enum class EncoderKind { phi_sac, phi_dqn, impala, mlp, compact, flat, data_efficient, phi_dqn_2013 };
/// conv2d: the convolutions as Mnih et al. meant them. row1d: as Dopamine's CALE agents run
/// them, where each row of the image is convolved by itself.
enum class PhiDqn { conv2d, row1d };
std::span<const std::string_view> names_of(EncoderKind);
std::span<const std::string_view> names_of(PhiDqn);

/// What an encoder is built from.
struct EncoderConfig {
    EncoderKind encoder = EncoderKind::phi_sac;        // which layers
    PhiDqn phi_dqn = PhiDqn::conv2d;                   // which phi_dqn, where it is that
    std::vector<std::int64_t> observation{4, 84, 84};  // [stack, rows, columns], or [stack, bytes]
    Padding padding = Padding::same;                   // of phi_sac and phi_dqn
    Initialiser initialise = nullptr;                  // none: the encoder's own
    Precision precision = Precision::float32;          // of all that is computed from an observation
    bool layer_norm = false;                           // after every dense layer, not only the critic's
};

/// Returns the layers from an observation to the features. Throws std::invalid_argument where a convolutional
/// encoder is to read bytes that are no image.
Layers trunk_layers(const EncoderConfig& config);
/// Returns the layers from the features to the critic's or the actor's branch.
Layers branch_layers(const EncoderConfig& config, bool of_critic);
/// Returns how the encoder's parameters start.
Initialiser initialiser_of(const EncoderConfig& config);

/// The layers of an encoder: [B, observation] uint8 -> [B, features()]. They are submodules of the owner that
/// it is made with, named conv1, conv2, ..., stage1_conv, ... or fc1, fc2. Bytes are divided by 255. phi_sac
/// starts orthogonal, the others Glorot. (Dopamine has an impala for CALE that no configuration uses, which
/// neither scales nor flattens nor ends with a ReLU, as this one does.)
class Trunk {
  public:
    /// Throws as trunk_layers() does, and for an observation without pixels.
    Trunk(torch::nn::Module& owner, const EncoderConfig& config, const at::Generator& generator);

    /// Throws std::invalid_argument, naming both shapes, for anything but [B, observation] uint8.
    torch::Tensor operator()(const torch::Tensor& observation) const {
        return stack_(stack_.scaled(observation, precision_));
    }

    std::int64_t features() const { return stack_.features(); }  // numbers per observation

  private:
    LayerStack stack_;
    Precision precision_;
};

/// One trunk and two branches on it, as the SAC and PPO agents of CALE have: the critic's trains
/// the trunk, the actor's does not.
///   phi_sac, mlp, compact, data_efficient, phi_dqn_2013
///               Dense 50, LayerNorm, tanh on both branches: few enough for an action of three numbers to
///               count beside them in the critics
///   flat        nothing: the actor and each critic have their layers to themselves
///   the others  Dense 512, ReLU; LayerNorm before the ReLU on the critic's branch, and on the actor's where
///               EncoderConfig::layer_norm
class TwoBranchEncoderImpl : public torch::nn::Module {
  public:
    TwoBranchEncoderImpl(const EncoderConfig& config, const at::Generator& generator);

    /// [B, observation] uint8 -> [B, features]
    torch::Tensor trunk(const torch::Tensor& observation) const { return trunk_(observation); }
    /// [B, features] -> [B, size()]
    torch::Tensor critic_branch(const torch::Tensor& features) const { return critic_(features); }
    /// [B, features] -> [B, size()]; no gradient passes back to the features.
    torch::Tensor actor_branch(const torch::Tensor& features) const { return actor_(features.detach()); }

    /// Units of either branch.
    std::int64_t size() const { return actor_.features(); }

    /// The layers from an observation to the actor's branch.
    Layers actor_layers;

  private:
    Trunk trunk_;
    LayerStack critic_, actor_;
};
using TwoBranchEncoder = torch::nn::ModuleHolder<TwoBranchEncoderImpl>;

}  // namespace cale
