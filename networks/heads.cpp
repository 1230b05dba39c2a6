#include "networks/heads.h"

#include <cmath>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace cale {

Layers hidden_layers(const HeadConfig& config) {
    if (config.hidden_layers < 0 || config.hidden_units < 1) {
        throw std::invalid_argument("a head has 0 or more hidden_layers of 1 or more hidden_units, not " +
                                    std::to_string(config.hidden_layers) + " of " +
                                    std::to_string(config.hidden_units));
    }
    return hidden_layers(config.hidden_layers, config.hidden_units, config.activation, config.layer_norm);
}

MlpImpl::MlpImpl(std::int64_t in, std::int64_t out, const HeadConfig& config, at::Generator generator)
    : hidden_(*this, hidden_layers(config), {in}, config.initialise, generator),
      out_(register_module("out", Dense(hidden_.features(), out, config.initialise_out, generator))) {}

torch::Tensor MlpImpl::forward(torch::Tensor x) {
    return out_(hidden_(std::move(x))).to(out_->weight.scalar_type());
}

std::span<const std::string_view> names_of(TwinEstimate) {
    static constexpr std::string_view names[] = {"minimum", "mean"};
    return names;
}

TwinCriticImpl::TwinCriticImpl(std::int64_t in, std::int64_t out, const HeadConfig& config,
                               at::Generator generator)
    : q1_(register_module("q1", Mlp(in, out, config, generator))),
      q2_(register_module("q2", Mlp(in, out, config, generator))) {}

TwinValues TwinCriticImpl::forward(const torch::Tensor& x) {
    return {q1_(x), q2_(x)};
}

ActionBox joystick_box() {
    constexpr double pi = std::numbers::pi;  // in double precision: its logarithm is part of every density
    return {torch::tensor({0.5F, 0.0F, 0.5F}), torch::tensor({0.5F, static_cast<float>(pi), 0.5F}),
            std::log(0.5) + std::log(pi) + std::log(0.5)};
}

ActionBox action_box(const ActionSpace& space) {
    const auto* const limits = std::get_if<Box>(&space);
    const auto joystick = joystick_space();
    if (limits == nullptr || (limits->low == joystick.low && limits->high == joystick.high))
        return joystick_box();  // pi in double precision
    if (limits->low.size() != limits->high.size())
        throw std::invalid_argument("an action's coordinates must have as many lower limits as upper ones");
    std::vector<float> centres, half_widths;
    double log_half_widths = 0;
    for (std::size_t i = 0; i < limits->low.size(); ++i) {
        const float low = limits->low[i], high = limits->high[i];
        if (!std::isfinite(low) || !std::isfinite(high) || !(low < high))
            throw std::invalid_argument(
                "the limits of an action's coordinates must be finite, low below high");
        const float centre = std::midpoint(low, high);
        float half_width = high / 2 - low / 2;
        // Where tanh is 1 or -1, a rounding must not carry the action out of the box.
        while (centre + half_width > high || centre - half_width < low)
            half_width = std::nextafter(half_width, 0.0F);
        centres.push_back(centre);
        half_widths.push_back(half_width);
        log_half_widths += std::log(double{half_width});
    }
    return {torch::tensor(centres), torch::tensor(half_widths), log_half_widths};
}

SquashedGaussian squashed_gaussian(const torch::Tensor& actor_output) {
    const auto size = actor_output.size(1) / 2;
    return {actor_output.narrow(1, 0, size), actor_output.narrow(1, size, size)};
}

namespace {

/// log N(u) - log |d action / d u|, with log(1 - tanh(u)^2) = 2 (log 2 - u - softplus(-2 u)). `noise` is
/// (u - mean) / std.
torch::Tensor log_density(const SquashedGaussian& policy, const torch::Tensor& u, const torch::Tensor& noise,
                          const ActionBox& box) {
    constexpr double log_2 = std::numbers::ln2;
    const double log_sqrt_2_pi = 0.5 * std::log(2 * std::numbers::pi);
    const auto per_coordinate =
        -0.5 * noise.square() - policy.log_std - log_sqrt_2_pi - 2 * (log_2 - u - at::softplus(-2 * u));
    return per_coordinate.sum(1) - box.log_half_widths;
}

}  // namespace

PolicySample sample(const SquashedGaussian& policy, const torch::Tensor& noise, const ActionBox& box) {
    const auto u = policy.mean + policy.log_std.exp() * noise;
    return {torch::addcmul(box.centre, box.half_width, u.tanh()), log_density(policy, u, noise, box)};
}

torch::Tensor log_prob(const SquashedGaussian& policy, const torch::Tensor& action, const ActionBox& box) {
    constexpr double largest = 0.99999994;  // the largest float below 1
    const auto u = ((action - box.centre) / box.half_width).clamp(-largest, largest).atanh();
    return log_density(policy, u, (u - policy.mean) * (-policy.log_std).exp(), box);
}

torch::Tensor mean_action(const SquashedGaussian& policy, const ActionBox& box) {
    return torch::addcmul(box.centre, box.half_width, policy.mean.tanh());
}

torch::Tensor uniform_actions(const ActionBox& box, std::int64_t count, at::Generator random) {
    if (box.landmarks.defined())
        return box.landmarks.index_select(
            0, torch::randint(0, box.landmarks.size(0), {count}, random, torch::kInt64));
    return box.centre + box.half_width * (2 * torch::rand({count, box.centre.size(0)}, random) - 1);
}

torch::Tensor epsilon_greedy(const torch::Tensor& actions, double epsilon, const ActionBox& box,
                             at::Generator random) {
    const auto chosen = torch::rand({actions.size(0), 1}, random) <= epsilon;
    return torch::where(chosen, uniform_actions(box, actions.size(0), random), actions);
}

}  // namespace cale
