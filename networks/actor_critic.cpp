#include "networks/actor_critic.h"

#include <utility>

#include <torch/types.h>

namespace cale {

NetworkSpec acting_half(const EncoderConfig& config, const TwoBranchEncoder& encoder,
                        const HeadConfig& hidden, const Head& head) {
    return {config.observation,
            chain({prefixed("encoder.", encoder->actor_layers), prefixed("actor.", hidden_layers(hidden))}),
            head};
}

TwinValues critic_values(const TwinValues& outputs, const torch::Tensor& support) {
    if (!support.defined()) return {outputs.q1.squeeze(1), outputs.q2.squeeze(1)};
    return {outputs.q1.softmax(1).matmul(support), outputs.q2.softmax(1).matmul(support)};
}

SacNetworkImpl::SacNetworkImpl(const EncoderConfig& encoder_config, const HeadConfig& head_config,
                               at::Generator generator, ActionBox action_box, torch::Tensor critic_support)
    : encoder(register_module("encoder", TwoBranchEncoder(encoder_config, generator))),
      box(std::move(action_box)),
      support(std::move(critic_support)),
      acting(acting_half(encoder_config, encoder, head_config,
                         {.kind = Head::Kind::squashed_gaussian, .axes = box.centre.size(0)})) {
    const auto axes = box.centre.size(0);
    actor = register_module("actor", Mlp(encoder->size(), 2 * axes, head_config, generator));
    critic = register_module(
        "critic",
        TwinCritic(encoder->size() + axes, support.defined() ? support.size(0) : 1, head_config, generator));
    register_buffer("box_centre", box.centre);
    register_buffer("box_half_width", box.half_width);
    if (support.defined()) register_buffer("support", support);
}

SquashedGaussian SacNetworkImpl::policy(const torch::Tensor& features) {
    return squashed_gaussian(actor(encoder->actor_branch(features)));
}

TwinValues SacNetworkImpl::outputs(const torch::Tensor& critic_z, const torch::Tensor& action) {
    return critic(torch::cat({critic_z, action.to(critic_z.scalar_type())}, 1));
}

TwinValues SacNetworkImpl::values(const torch::Tensor& critic_z, const torch::Tensor& action) {
    return critic_values(outputs(critic_z, action), support);
}

namespace {

std::vector<torch::Tensor> parameters_of(const torch::nn::Module& network, bool of_actor) {
    std::vector<torch::Tensor> chosen;
    for (const auto& parameter : network.named_parameters()) {
        const bool actor =
            parameter.key().starts_with("actor.") || parameter.key().starts_with("encoder.actor_");
        if (actor == of_actor) chosen.push_back(parameter.value());
    }
    return chosen;
}

}  // namespace

std::vector<torch::Tensor> actor_parameters(const torch::nn::Module& network) {
    return parameters_of(network, true);
}

std::vector<torch::Tensor> critic_parameters(const torch::nn::Module& network) {
    return parameters_of(network, false);
}

}  // namespace cale
