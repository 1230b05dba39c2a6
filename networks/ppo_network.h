// A policy and a value: the networks of PPO, as CALE has them and as PPO's own implementations do.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/encoders.h"
#include "networks/heads.h"

namespace cale {

/// two_branch: CALE's encoder; the policy's gradient does not reach its convolutions.
/// shared: convolutions without padding, but for impala and row1d, and 512 features that the policy and the
/// value both train.
enum class Torso { two_branch, shared };
std::span<const std::string_view> names_of(Torso);

/// A trunk and Dense `size` with ReLU, normalised before it where EncoderConfig::layer_norm: the features
/// that a policy and a value share and both train.
class SharedEncoderImpl : public torch::nn::Module {
  public:
    SharedEncoderImpl(const EncoderConfig& config, std::int64_t size, const Initialiser& initialise,
                      const at::Generator& generator);
    /// [B, observation] uint8 -> [B, size]
    torch::Tensor forward(const torch::Tensor& observation);

    /// The layers from an observation to the shared features.
    Layers layers;

  private:
    Trunk trunk_;
    LayerStack shared_;
};
using SharedEncoder = torch::nn::ModuleHolder<SharedEncoderImpl>;

/// How a standard deviation that does not depend on the state is parameterised.
///   summed  a bias and a row of weights per coordinate, all added up: as Dopamine's PPO has it, which
///           makes Adam move it by (1 + units) learning rates per step
///   direct  one number per coordinate
enum class LogStd { summed, direct };
std::span<const std::string_view> names_of(LogStd);

/// fc1, fc2, ..., then mean; beside them log_std, which starts at 0 (one number per coordinate or,
/// if summed, a dense layer that is fed ones).
class GaussianActorImpl : public torch::nn::Module {
  public:
    GaussianActorImpl(std::int64_t in, std::int64_t action_size, const HeadConfig& config, LogStd log_std,
                      at::Generator generator);
    /// [B, in] -> mean and log_std [B, A]
    SquashedGaussian forward(torch::Tensor x);

  private:
    LayerStack hidden_;
    Dense mean_{nullptr}, summed_log_std_{nullptr};
    torch::Tensor direct_log_std_;
};
using GaussianActor = torch::nn::ModuleHolder<GaussianActorImpl>;

/// The defaults are those of CALE's PPO.
struct PpoNetworkConfig {
    EncoderConfig encoder;            // its convolutions
    Torso torso = Torso::two_branch;  // what the actor and the critic share
    std::int64_t hidden_layers = 2;   // of the actor and of the critic, tanh
    std::int64_t hidden_units = 64;   // of each hidden layer
    LogStd log_std = LogStd::summed;  // how the standard deviation is parameterised
    bool layer_norm = false;          // before the activations of the actor and of the critic
};

/// A policy in B states: a Gaussian on a box of actions, or log-probabilities [B, A].
struct PpoPolicy {
    std::optional<SquashedGaussian> gaussian;  // of actions in a box
    torch::Tensor log_pi;                      // [B, A] of a set of actions
};

/// Parameters are float32 on the CPU until moved.
class PpoNetworkImpl : public torch::nn::Module {
  public:
    /// `num_actions` 0: actions of `action_box`.
    PpoNetworkImpl(const PpoNetworkConfig& config, std::int64_t num_actions, at::Generator generator,
                   ActionBox action_box = joystick_box());

    /// The network's output for B observations.
    struct Output {
        PpoPolicy policy;     // what to do
        torch::Tensor value;  // [B]
    };
    /// [B, stack, ...] uint8
    Output forward(const torch::Tensor& observation);

    ActionBox box;       // beside the parameters, as buffers
    NetworkSpec acting;  // the half that acts

  private:
    TwoBranchEncoder two_branch_{nullptr};
    SharedEncoder shared_{nullptr};
    GaussianActor gaussian_{nullptr};
    Mlp categorical_{nullptr}, critic_{nullptr};
};
using PpoNetwork = torch::nn::ModuleHolder<PpoNetworkImpl>;

/// [B] log-probabilities (densities in the box's units) of actions [B, A] or [B] int64.
torch::Tensor log_prob(const PpoPolicy& policy, const torch::Tensor& action, const ActionBox& box);
/// [B]; of a Gaussian: before it is squashed.
torch::Tensor entropy(const PpoPolicy& policy);

}  // namespace cale
