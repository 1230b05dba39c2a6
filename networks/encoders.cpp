#include "networks/encoders.h"

namespace cale {

Trunk::Trunk(torch::nn::Module& owner, const EncoderConfig& config, const at::Generator& generator)
    : stack_(owner, trunk_layers(config), config.observation, initialiser_of(config), generator),
      precision_(config.precision) {}

TwoBranchEncoderImpl::TwoBranchEncoderImpl(const EncoderConfig& config, const at::Generator& generator)
    : actor_layers(chain({trunk_layers(config), branch_layers(config, /*of_critic=*/false)})),
      trunk_(*this, config, generator),
      critic_(*this, branch_layers(config, /*of_critic=*/true), {trunk_.features()}, initialiser_of(config),
              generator),
      actor_(*this, branch_layers(config, /*of_critic=*/false), {trunk_.features()}, initialiser_of(config),
             generator) {}

}  // namespace cale
