#include "networks/q_network.h"

#include <functional>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <torch/types.h>

#include "policy/factor_means.h"

namespace cale {

NetworkSpec values_spec(std::vector<std::int64_t> observation, const Layers& encoder,
                        const QHeadConfig& config) {
    const bool noisy = config.noisy && config.noisy_evaluation;
    auto hidden = hidden_layers(1, config.hidden_units, Layer::Kind::relu, config.layer_norm);
    hidden.front().noisy = noisy;
    return {std::move(observation),
            chain({prefixed("encoder.", encoder), prefixed("head.", std::move(hidden))}),
            {.kind = Head::Kind::values,
             .num_actions = config.num_actions,
             .dueling = config.dueling,
             .num_atoms = config.num_atoms,
             .value_limit = config.value_limit,
             .noisy = noisy,
             .factors = config.factors}};
}

torch::Tensor dueling_values(const torch::Tensor& value, const torch::Tensor& advantages) {
    return value + advantages - advantages.mean(1, /*keepdim=*/true);
}

torch::Tensor factor_matrix(const std::vector<std::int64_t>& factors) {
    const auto choices = std::reduce(factors.begin(), factors.end());
    return torch::tensor(at::ArrayRef<float>(factor_means(factors))).view({-1, choices});
}

QHeadImpl::QHeadImpl(std::int64_t in, const QHeadConfig& config, at::Generator generator)
    : config_(config),
      in_(in),
      choices_(config.factors.empty() ? config.num_actions
                                      : std::reduce(config.factors.begin(), config.factors.end())) {
    if (config.num_actions < 1 || config.hidden_units < 1 || config.num_atoms < 1) {
        throw std::invalid_argument(
            "a head of action values has at least one action, hidden unit and atom, not " +
            std::to_string(config.num_actions) + ", " + std::to_string(config.hidden_units) + " and " +
            std::to_string(config.num_atoms));
    }
    const auto product =
        std::reduce(config.factors.begin(), config.factors.end(), std::int64_t{1}, std::multiplies());
    if (!config.factors.empty() && product != config.num_actions) {
        throw std::invalid_argument("a head's factors have a product of " + std::to_string(product) +
                                    ", and it has " + std::to_string(config.num_actions) + " actions");
    }
    const auto out = choices_ * config.num_atoms;
    if (!config.factors.empty()) combine_ = register_buffer("combine", factor_matrix(config.factors));
    const auto layer = [&](const char* name, std::int64_t inputs, std::int64_t outputs) {
        const auto sigma = config.noisy ? std::optional(config.initial_sigma) : std::nullopt;
        return add_dense(*this, name, inputs, outputs, glorot_uniform(), sigma, generator);
    };
    fc1_ = layer("fc1", in, config.hidden_units);
    if (config.layer_norm) {
        const auto options = torch::nn::LayerNormOptions({config.hidden_units}).eps(kLayerNormEpsilon);
        norm_ = register_module("ln1", torch::nn::LayerNorm(options));
    }
    out_ = layer(config.dueling ? "adv" : "out", config.hidden_units, out);
    if (config.dueling) value_ = layer("value", config.hidden_units, config.num_atoms);
}

torch::Tensor QHeadImpl::forward(const torch::Tensor& features, const QNoise* noise) {
    auto x = fc1_(features, noise ? &noise->hidden : nullptr);
    if (norm_) x = normalised(*norm_, x);
    x = x.relu();
    auto out = out_(x, noise ? &noise->out : nullptr)
                   .to(out_.weight().scalar_type())
                   .reshape({-1, choices_, config_.num_atoms});
    if (combine_.defined()) out = combine_.matmul(out);
    if (!config_.dueling) return out;
    const auto value =
        value_(x, noise ? &noise->value : nullptr).to(value_.weight().scalar_type()).unsqueeze(1);
    return dueling_values(value, out);
}

QNoise QHeadImpl::draw_noise(at::Generator generator, std::int64_t rows) const {
    if (!config_.noisy) return {};
    const auto normal = [&](std::int64_t size) {
        const auto shape = rows == 1 ? std::vector{size} : std::vector{rows, size};
        return torch::randn(shape, generator, generator.device());
    };
    const auto shared = normal(config_.hidden_units);
    return {{normal(in_), normal(config_.hidden_units)},
            {shared, normal(choices_ * config_.num_atoms)},
            {shared, normal(config_.num_atoms)}};
}

QNetworkImpl::QNetworkImpl(const EncoderConfig& encoder_config, const QHeadConfig& head_config,
                           at::Generator generator)
    : encoder(register_module("encoder", TrunkEncoder(encoder_config, generator))),
      head(register_module("head", QHead(encoder->size(), head_config, generator))),
      acting(values_spec(encoder_config.observation, trunk_layers(encoder_config), head_config)) {}

torch::Tensor QNetworkImpl::forward(const torch::Tensor& observation, const QNoise* noise) {
    return head(encoder(observation), noise);
}

QNoise to(const QNoise& noise, const torch::TensorOptions& options) {
    QNoise moved = noise;
    for (auto* layer : {&moved.hidden, &moved.out, &moved.value})
        for (auto* numbers : {&layer->input, &layer->output})
            if (numbers->defined()) *numbers = numbers->to(options);
    return moved;
}

}  // namespace cale
