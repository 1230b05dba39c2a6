#include "networks/ppo_network.h"

#include <cmath>
#include <numbers>
#include <utility>

#include <torch/types.h>

#include "networks/discrete_actions.h"

namespace cale {
namespace {

constexpr std::int64_t kSharedFeatures = 512;

}  // namespace

std::span<const std::string_view> names_of(Torso) {
    static constexpr std::string_view names[] = {"two_branch", "shared"};
    return names;
}

std::span<const std::string_view> names_of(LogStd) {
    static constexpr std::string_view names[] = {"summed", "direct"};
    return names;
}

GaussianActorImpl::GaussianActorImpl(std::int64_t in, std::int64_t action_size, const HeadConfig& config,
                                     LogStd log_std, at::Generator generator)
    : hidden_(*this, hidden_layers(config), {in}, config.initialise, generator),
      mean_(
          register_module("mean", Dense(hidden_.features(), action_size, config.initialise_out, generator))) {
    if (log_std == LogStd::summed) {
        summed_log_std_ =
            register_module("log_std", Dense(hidden_.features(), action_size, zeros(), generator));
    } else {
        direct_log_std_ = register_parameter("log_std", torch::zeros({action_size}));
    }
}

SquashedGaussian GaussianActorImpl::forward(torch::Tensor x) {
    const auto mean = mean_(hidden_(std::move(x))).to(mean_->weight.scalar_type());
    const auto log_std =
        summed_log_std_ ? summed_log_std_->weight.sum(1) + summed_log_std_->bias : direct_log_std_;
    return {mean, log_std.expand_as(mean)};
}

namespace {

Layers shared_layers(std::int64_t size, bool layer_norm) {
    Layers layers{Layer::dense("fc", size)};
    if (layer_norm) layers.push_back(Layer::layer_norm("ln"));
    layers.push_back(Layer::of(Layer::Kind::relu));
    return layers;
}

}  // namespace

SharedEncoderImpl::SharedEncoderImpl(const EncoderConfig& config, std::int64_t size,
                                     const Initialiser& initialise, const at::Generator& generator)
    : layers(chain({trunk_layers(config), shared_layers(size, config.layer_norm)})),
      trunk_(*this, config, generator),
      shared_(*this, shared_layers(size, config.layer_norm), {trunk_.features()}, initialise, generator) {}

torch::Tensor SharedEncoderImpl::forward(const torch::Tensor& observation) {
    return shared_(trunk_(observation));
}

PpoNetworkImpl::PpoNetworkImpl(const PpoNetworkConfig& config, std::int64_t num_actions,
                               at::Generator generator, ActionBox action_box)
    : box(std::move(action_box)) {
    EncoderConfig encoder = config.encoder;
    const auto hidden = orthogonal(std::numbers::sqrt2);
    std::int64_t features = kSharedFeatures;
    if (config.torso == Torso::two_branch) {
        two_branch_ = register_module("encoder", TwoBranchEncoder(encoder, generator));
        features = two_branch_->size();
    } else {
        encoder.padding = Padding::valid;
        encoder.initialise = hidden;
        shared_ = register_module("encoder", SharedEncoder(encoder, features, hidden, generator));
    }
    const auto head = [&](double gain) {
        return HeadConfig{.hidden_layers = config.hidden_layers,
                          .hidden_units = config.hidden_units,
                          .activation = Layer::Kind::tanh,
                          .initialise = hidden,
                          .initialise_out = orthogonal(gain),
                          .layer_norm = config.layer_norm};
    };
    if (num_actions == 0) {
        gaussian_ = register_module(
            "actor", GaussianActor(features, box.centre.size(0), head(0.1), config.log_std, generator));
    } else {
        categorical_ = register_module("actor", Mlp(features, num_actions, head(0.01), generator));
    }
    critic_ = register_module("critic", Mlp(features, 1, head(1), generator));
    register_buffer("box_centre", box.centre);
    register_buffer("box_half_width", box.half_width);
    acting = {encoder.observation,
              chain({prefixed("encoder.", two_branch_ ? two_branch_->actor_layers : shared_->layers),
                     prefixed("actor.", hidden_layers(head(1)))}),
              {.kind = num_actions == 0 ? Head::Kind::gaussian : Head::Kind::categorical,
               .num_actions = num_actions,
               .axes = box.centre.size(0)}};
}

PpoNetworkImpl::Output PpoNetworkImpl::forward(const torch::Tensor& observation) {
    torch::Tensor actor_z, critic_z;
    if (shared_) {
        actor_z = critic_z = shared_(observation);
    } else {
        const auto features = two_branch_->trunk(observation);
        actor_z = two_branch_->actor_branch(features);
        critic_z = two_branch_->critic_branch(features);
    }
    PpoPolicy policy;
    if (gaussian_) {
        policy.gaussian = gaussian_(actor_z);
    } else {
        policy.log_pi = categorical_(actor_z).log_softmax(1);
    }
    return {policy, critic_(critic_z).squeeze(1)};
}

torch::Tensor log_prob(const PpoPolicy& policy, const torch::Tensor& action, const ActionBox& box) {
    return policy.gaussian ? log_prob(*policy.gaussian, action, box) : gather_actions(policy.log_pi, action);
}

torch::Tensor entropy(const PpoPolicy& policy) {
    if (!policy.gaussian) return -(policy.log_pi.exp() * policy.log_pi).sum(1);
    return (0.5 * (1 + std::log(2 * std::numbers::pi)) + policy.gaussian->log_std).sum(1);
}

}  // namespace cale
