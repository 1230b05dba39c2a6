// One encoder, one actor and two critics: the network of SAC-D.
#pragma once

#include <cstdint>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include "networks/actor_critic.h"

namespace cale {

/// A categorical actor, and critics that value every action of a state.
class SacdNetworkImpl : public torch::nn::Module {
  public:
    SacdNetworkImpl(const EncoderConfig& encoder_config, const HeadConfig& head_config,
                    std::int64_t num_actions, at::Generator generator);

    /// log pi(. | s) [B, A] on the encoder's features [B, F]; its gradient does not reach the trunk.
    torch::Tensor log_policy(const torch::Tensor& features);

    TwoBranchEncoder encoder{nullptr};  // parameters encoder.*
    Mlp actor{nullptr};                 // actor.*: logits [B, A]
    TwinCritic critic{nullptr};         // critic.q1.*, critic.q2.*
    NetworkSpec acting;                 // the half that acts
};
using SacdNetwork = torch::nn::ModuleHolder<SacdNetworkImpl>;

}  // namespace cale
