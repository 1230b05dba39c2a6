#include "networks/sacd_network.h"

#include <torch/types.h>

namespace cale {

SacdNetworkImpl::SacdNetworkImpl(const EncoderConfig& encoder_config, const HeadConfig& head_config,
                                 std::int64_t num_actions, at::Generator generator)
    : encoder(register_module("encoder", TwoBranchEncoder(encoder_config, generator))),
      actor(register_module("actor", Mlp(encoder->size(), num_actions, head_config, generator))),
      critic(register_module("critic", TwinCritic(encoder->size(), num_actions, head_config, generator))),
      acting(acting_half(encoder_config, encoder, head_config,
                         {.kind = Head::Kind::categorical, .num_actions = num_actions})) {}

torch::Tensor SacdNetworkImpl::log_policy(const torch::Tensor& features) {
    return actor(encoder->actor_branch(features)).log_softmax(1);
}

}  // namespace cale
