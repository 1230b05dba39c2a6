#include "networks/adam.h"

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

void Adam::step() {
    const torch::NoGradGuard no_grad;
    std::vector<torch::Tensor> gradients;
    gradients.reserve(parameters_.size());
    for (const auto& parameter : parameters_) {
        const auto& gradient = parameter.grad();
        if (!gradient.defined()) throw std::logic_error("Adam::step: a parameter has no gradient");
        // The fused kernel walks raw memory, so both must be laid out alike.
        gradients.push_back(gradient.strides() == parameter.strides()
                                ? gradient
                                : torch::empty_like(parameter).copy_(gradient));
    }
    steps_.add_(1);
    const auto update = [&](const auto& learning_rate) {
        at::_fused_adam_(parameters_, gradients, first_moments_, second_moments_, {}, steps_of_each_,
                         learning_rate, config_.beta1, config_.beta2, /*weight_decay=*/0, config_.epsilon,
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

torch::Tensor clip_gradient_norm(const std::vector<torch::Tensor>& parameters, double maximum) {
    const torch::NoGradGuard no_grad;
    std::vector<torch::Tensor> gradients;
    for (const auto& parameter : parameters) gradients.push_back(parameter.grad());
    const auto norm = at::stack(at::_foreach_norm(gradients)).norm();
    at::_foreach_mul_(gradients, (maximum / norm).clamp_max(1));
    return norm;
}

void hard_update(const std::vector<torch::Tensor>& target, const std::vector<torch::Tensor>& online) {
    require_same_length(target, online);
    const torch::NoGradGuard no_grad;
    at::_foreach_copy_(target, online);
}

}  // namespace cale
