#include "networks/heads.h"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include <torch/torch.h>

namespace cale {

MlpImpl::MlpImpl(std::int64_t in, std::int64_t out, const HeadConfig& config, at::Generator generator) {
    if (config.hidden_layers < 0 || config.hidden_units < 1) {
        throw std::invalid_argument("a head has 0 or more hidden_layers of 1 or more hidden_units, not " +
                                    std::to_string(config.hidden_layers) + " of " +
                                    std::to_string(config.hidden_units));
    }
    for (std::int64_t layer = 1; layer <= config.hidden_layers; ++layer) {
        hidden_.push_back(register_module("fc" + std::to_string(layer),
                                          Dense(in, config.hidden_units, glorot_uniform(), generator)));
        in = config.hidden_units;
    }
    out_ = register_module("out", Dense(in, out, glorot_uniform(), generator));
}

torch::Tensor MlpImpl::forward(torch::Tensor x) {
    for (auto& layer : hidden_) x = layer(x).relu_();
    return out_(x);
}

TwinCriticImpl::TwinCriticImpl(std::int64_t features, std::int64_t action_size, const HeadConfig& config,
                               at::Generator generator)
    : q1_(register_module("q1", Mlp(features + action_size, 1, config, generator))),
      q2_(register_module("q2", Mlp(features + action_size, 1, config, generator))) {}

TwinValues TwinCriticImpl::forward(const torch::Tensor& features, const torch::Tensor& action) {
    const auto x = torch::cat({features, action}, 1);
    return {q1_(x).squeeze(1), q2_(x).squeeze(1)};
}

ActionBox joystick_box() {
    constexpr double pi = std::numbers::pi;
    return {torch::tensor({0.5f, 0.0f, 0.5f}), torch::tensor({0.5f, static_cast<float>(pi), 0.5f}),
            std::log(0.5) + std::log(pi) + std::log(0.5)};
}

SquashedGaussian squashed_gaussian(const torch::Tensor& actor_output) {
    const auto size = actor_output.size(1) / 2;
    return {actor_output.narrow(1, 0, size), actor_output.narrow(1, size, size)};
}

PolicySample sample(const SquashedGaussian& policy, const torch::Tensor& noise, const ActionBox& box) {
    const auto u = policy.mean + policy.log_std.exp() * noise;
    const auto action = torch::addcmul(box.centre, box.half_width, u.tanh());
    // log N(u) - log |d action / d u|, with log(1 - tanh(u)^2) = 2 (log 2 - u - softplus(-2 u)).
    constexpr double log_2 = std::numbers::ln2;
    const double log_sqrt_2_pi = 0.5 * std::log(2 * std::numbers::pi);
    const auto per_coordinate =
        -0.5 * noise.square() - policy.log_std - log_sqrt_2_pi - 2 * (log_2 - u - at::softplus(-2 * u));
    return {action, per_coordinate.sum(1) - box.log_half_widths};
}

torch::Tensor mean_action(const SquashedGaussian& policy, const ActionBox& box) {
    return torch::addcmul(box.centre, box.half_width, policy.mean.tanh());
}

}  // namespace cale
