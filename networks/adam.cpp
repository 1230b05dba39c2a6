#include "networks/adam.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <torch/types.h>
#include <torch/utils.h>

namespace cale {
namespace {

void require_same_length(const std::vector<torch::Tensor>& target, const std::vector<torch::Tensor>& online) {
    if (target.size() != online.size()) {
        throw std::invalid_argument("the target network has " + std::to_string(target.size()) +
                                    " parameters, the online network " + std::to_string(online.size()));
    }
}

}  // namespace

Adam::Adam(std::vector<torch::Tensor> parameters, const AdamConfig& config)
    : config_(config), parameters_(std::move(parameters)) {
    if (parameters_.empty()) throw std::invalid_argument("Adam was given no parameters");
    for (const auto& parameter : parameters_) {
        first_moments_.push_back(torch::zeros_like(parameter));
        second_moments_.push_back(torch::zeros_like(parameter));
    }
    steps_ = torch::zeros({}, parameters_.front().options().dtype(torch::kFloat32).requires_grad(false));
    steps_of_each_.assign(parameters_.size(), steps_);
    if (!steps_.is_cpu()) learning_rate_ = torch::full_like(steps_, config.learning_rate);
}

void Adam::set_learning_rate(double learning_rate) {
    config_.learning_rate = learning_rate;
    if (learning_rate_.defined()) learning_rate_.fill_(learning_rate);
}

void Adam::delay(const std::vector<torch::Tensor>& parameters) {
    if (delayed_steps_.defined()) throw std::logic_error("Adam::delay was called before");
    delayed_steps_ = torch::zeros_like(steps_);
    for (std::size_t i = 0; i < parameters_.size(); ++i) {
        const auto same = [&](const torch::Tensor& parameter) { return parameter.is_same(parameters_[i]); };
        if (std::ranges::any_of(parameters, same)) steps_of_each_[i] = delayed_steps_;
    }
}

void Adam::step(bool with_delayed) {
    const torch::NoGradGuard no_grad;
    std::vector<torch::Tensor> parameters, gradients, first_moments, second_moments, steps;
    for (std::size_t i = 0; i < parameters_.size(); ++i) {
        if (!with_delayed && steps_of_each_[i].is_same(delayed_steps_)) continue;
        const auto& parameter = parameters_[i];
        const auto& gradient = parameter.grad();
        if (!gradient.defined()) throw std::logic_error("Adam::step: a parameter has no gradient");
        parameters.push_back(parameter);
        // The fused kernel walks raw memory, so both must be laid out alike.
        gradients.push_back(gradient.strides() == parameter.strides()
                                ? gradient
                                : torch::empty_like(parameter).copy_(gradient));
        first_moments.push_back(first_moments_[i]);
        second_moments.push_back(second_moments_[i]);
        steps.push_back(steps_of_each_[i]);
    }
    steps_.add_(1);
    if (with_delayed && delayed_steps_.defined()) delayed_steps_.add_(1);
    const auto update = [&](const auto& learning_rate) {
        at::_fused_adamw_(parameters, gradients, first_moments, second_moments, {}, steps, learning_rate,
                          config_.beta1, config_.beta2, config_.weight_decay, config_.epsilon,
                          /*amsgrad=*/false, /*maximize=*/false);
    };
    if (learning_rate_.defined()) {
        update(learning_rate_);
    } else {
        update(config_.learning_rate);  // a double: float32 would round it
    }
}

void Adam::zero_grad() {
    for (auto& parameter : parameters_) parameter.mutable_grad().reset();
}

std::map<std::string, torch::Tensor> Adam::state() const {
    std::map<std::string, torch::Tensor> state{{"steps", steps_}};
    if (delayed_steps_.defined()) state["delayed_steps"] = delayed_steps_;
    for (std::size_t i = 0; i < parameters_.size(); ++i) {
        state["first_moment." + std::to_string(i)] = first_moments_[i];
        state["second_moment." + std::to_string(i)] = second_moments_[i];
    }
    return state;
}

void soft_update(const std::vector<torch::Tensor>& target, const std::vector<torch::Tensor>& online,
                 double tau) {
    require_same_length(target, online);
    const torch::NoGradGuard no_grad;
    at::_foreach_lerp_(target, online, tau);
}

std::vector<torch::Tensor> gradients_of(const std::vector<torch::Tensor>& parameters) {
    std::vector<torch::Tensor> gradients;
    gradients.reserve(parameters.size());
    for (const auto& parameter : parameters) gradients.push_back(parameter.grad());
    return gradients;
}

namespace {

/// [] float64: a sum of millions of squares in float32 is too small by a thousandth.
torch::Tensor global_norm(const std::vector<torch::Tensor>& tensors) {
    return at::stack(at::_foreach_norm(tensors, 2, at::kDouble)).norm();
}

}  // namespace

std::optional<double> gradient_norm(const std::vector<torch::Tensor>& parameters) {
    const torch::NoGradGuard no_grad;
    const auto gradients = gradients_of(parameters);
    if (!std::ranges::all_of(gradients, &torch::Tensor::defined)) return std::nullopt;
    const auto norm = global_norm(gradients).item<double>();
    return std::isfinite(norm) ? std::optional(norm) : std::nullopt;
}

torch::Tensor clip_gradient_norm(const std::vector<torch::Tensor>& parameters, double maximum) {
    const torch::NoGradGuard no_grad;
    const auto gradients = gradients_of(parameters);
    auto norm = global_norm(gradients);
    at::_foreach_mul_(gradients, (maximum / norm).clamp_max(1).to(gradients.front().scalar_type()));
    return norm;
}

void hard_update(const std::vector<torch::Tensor>& target, const std::vector<torch::Tensor>& online) {
    require_same_length(target, online);
    const torch::NoGradGuard no_grad;
    at::_foreach_copy_(target, online);
}

}  // namespace cale
