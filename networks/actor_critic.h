// One encoder, one actor and two critics: the network of SAC, and what that of SAC-D (sacd_network.h) shares.
#pragma once

#include <vector>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/encoders.h"
#include "networks/heads.h"

namespace cale {

/// Returns the critics' values [B] of their outputs: see SacNetworkImpl::outputs().
TwinValues critic_values(const TwinValues& outputs, const torch::Tensor& support);

/// A squashed Gaussian on a box of A axes, and critics of (state, action). float32 on the CPU until moved.
class SacNetworkImpl : public torch::nn::Module {
  public:
    SacNetworkImpl(const EncoderConfig& encoder_config, const HeadConfig& head_config,
                   at::Generator generator, ActionBox action_box = joystick_box(),
                   torch::Tensor critic_support = {});

    /// The policy on the encoder's features [B, F]; its gradient does not reach the trunk.
    SquashedGaussian policy(const torch::Tensor& features);
    /// The critics' outputs for their branch [B, Z] and an action [B, A] in the box's own units: values [B,
    /// 1] each, or the logits [B, atoms] of the returns in `support`.
    TwinValues outputs(const torch::Tensor& critic_z, const torch::Tensor& action);
    /// Q1 and Q2 [B], their means.
    TwinValues values(const torch::Tensor& critic_z, const torch::Tensor& action);

    TwoBranchEncoder encoder{nullptr};  // parameters encoder.*
    Mlp actor{nullptr};                 // actor.*: means and log standard deviations [B, 2 A]
    TwinCritic critic{nullptr};         // critic.q1.*, critic.q2.*
    ActionBox box;                      // beside the parameters, as buffers
    torch::Tensor support;              // [atoms], a buffer; undefined where the critics' outputs are values
    NetworkSpec acting;                 // the half that acts
};
using SacNetwork = torch::nn::ModuleHolder<SacNetworkImpl>;

/// Returns the specification of an actor on its branch of the encoder.
NetworkSpec acting_half(const EncoderConfig& config, const TwoBranchEncoder& encoder,
                        const HeadConfig& hidden, const Head& head);

/// The parameters that an actor's loss trains, actor.* and encoder.actor_*, and those that the
/// critics' loss trains: the rest.
std::vector<torch::Tensor> actor_parameters(const torch::nn::Module& network);
/// See actor_parameters().
std::vector<torch::Tensor> critic_parameters(const torch::nn::Module& network);

}  // namespace cale
