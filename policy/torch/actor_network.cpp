#include "policy/torch/actor_network.h"

#include <algorithm>
#include <utility>

#include <ATen/CPUGeneratorImpl.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "networks/q_network.h"
#include "policy/network_parameters.h"

namespace cale {
namespace {

/// Weights come from a file; drawing some first would take a second.
void leave_at_zero(torch::Tensor& weight, const at::Generator&) {
    const torch::NoGradGuard no_grad;
    weight.zero_();
}

/// Without a generator layers have no values (no_values()). What is drawn from this one is replaced.
at::Generator unused_generator() {
    return at::detail::createCPUGenerator();
}

/// The same layers under names that LibTorch allows for modules: without dots.
Layers without_dots(Layers layers) {
    for (auto& layer : layers) std::ranges::replace(layer.name, '.', '/');
    return layers;
}

torch::Tensor tensor_of(const std::vector<float>& numbers, at::IntArrayRef shape) {
    return torch::tensor(at::ArrayRef<float>(numbers)).view(shape);
}

}  // namespace

ActorNetwork::ActorNetwork(const NetworkSpec& network,
                           const std::map<std::string, std::vector<float>>& weights, torch::Device device)
    : head_(network.head),
      layers_(owner_, without_dots(network.layers), network.observation, leave_at_zero, unused_generator()) {
    const torch::NoGradGuard no_grad;
    for (auto layer : head_layers(head_, layers_.features())) {
        std::ranges::replace(layer.name, '.', '/');
        const auto sigma = layer.noisy ? std::optional(0.0) : std::nullopt;
        last_.push_back(add_dense(owner_, layer.name, layer.in.channels, layer.outputs, leave_at_zero, sigma,
                                  unused_generator()));
    }
    for (auto& parameter : owner_.named_parameters()) {
        // "actor/fc1.weight" is actor.fc1.weight, and so is "actor/fc1.weight_mu".
        auto name = parameter.key();
        std::ranges::replace(name, '/', '.');
        if (name.ends_with("_mu")) name.resize(name.size() - 3);
        auto& tensor = parameter.value();
        tensor.copy_(tensor_of(weights.at(name), tensor.sizes()));
        tensor.requires_grad_(false);
    }
    owner_.to(device);
    if (head_.kind == Head::Kind::gaussian)
        log_std_ = tensor_of(weights.at("actor.log_std"), {head_.axes}).to(device);
    if (!head_.factors.empty()) combine_ = factor_matrix(head_.factors).to(device);
    if (head_.num_atoms > 1) {
        support_ = torch::linspace(-head_.value_limit, head_.value_limit, head_.num_atoms, torch::kFloat32)
                       .to(device);
    }
}

torch::Tensor ActorNetwork::output(const torch::Tensor& observations, const LayerStack::Watch& watch,
                                   const std::optional<at::Generator>& noise) const {
    auto scaled = layers_.scaled(observations);
    torch::Tensor input_noise;  // of the head's layers, which share it
    if (noise && head_.noisy)
        input_noise = torch::randn({scaled.size(0), layers_.features()}, *noise).to(scaled.device());
    const auto features = layers_(std::move(scaled), watch, noise);
    switch (head_.kind) {
        case Head::Kind::squashed_gaussian:
            return last_[0](features);
        case Head::Kind::gaussian: {
            const auto mean = last_[0](features);
            return torch::cat({mean, log_std_.expand_as(mean)}, 1);
        }
        case Head::Kind::categorical:
            return last_[0](features).log_softmax(1);
        case Head::Kind::values:
            break;
    }
    return action_values(features, input_noise, noise);
}

torch::Tensor ActorNetwork::action_values(const torch::Tensor& features, const torch::Tensor& input_noise,
                                          const std::optional<at::Generator>& noise) const {
    const bool noisy = input_noise.defined();
    const auto draw = [&](std::int64_t size) {
        return noisy ? FactorisedNoise{input_noise,
                                       torch::randn({features.size(0), size}, *noise).to(features.device())}
                     : FactorisedNoise{};
    };
    // The value's is drawn where there is no value, too, as the agent draws it.
    const auto for_out = draw(num_outputs(head_) * head_.num_atoms), for_value = draw(head_.num_atoms);
    auto values =
        last_[0](features, noisy ? &for_out : nullptr).reshape({-1, num_outputs(head_), head_.num_atoms});
    if (combine_.defined()) values = combine_.matmul(values);
    if (head_.dueling) {
        const auto value = last_[1](features, noisy ? &for_value : nullptr);
        values = dueling_values(value.unsqueeze(1), values);
    }
    return support_.defined() ? (values.softmax(2) * support_).sum(2) : values.squeeze(2);
}

}  // namespace cale
