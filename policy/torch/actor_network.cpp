#include "policy/torch/actor_network.h"

#include <ATen/CPUGeneratorImpl.h>
#include <torch/nn/module.h>
#include <torch/nn/modules/normalization.h>
#include <torch/types.h>
#include <torch/utils.h>

namespace cale {
namespace {

/// Weights come from a file; drawing some first would take a second.
void leave_at_zero(torch::Tensor& weight, const at::Generator&) {
    const torch::NoGradGuard no_grad;
    weight.zero_();
}

/// Without a generator layers have no values (no_values()); this one is not drawn from.
at::Generator unused_generator() {
    return at::detail::getDefaultCPUGenerator();
}

Dense make_dense(const Layer& layer) {
    return Dense(layer.in.channels, layer.out.channels, leave_at_zero, unused_generator());
}

EncoderConfig encoder_config(const PolicyNetwork& network) {
    return {.encoder = static_cast<EncoderKind>(network.encoder),
            .phi_dqn = static_cast<PhiDqn>(network.phi_dqn),
            .stack = network.stack,
            .frame_height = network.frame_height,
            .frame_width = network.frame_width,
            .padding = static_cast<Padding>(network.padding),
            .initialise = leave_at_zero};
}

/// The parameters of `module` become the weights called prefix + name.
void set_parameters(torch::nn::Module& module, const std::string& prefix,
                    const std::map<std::string, std::vector<float>>& weights) {
    const torch::NoGradGuard no_grad;
    for (auto& parameter : module.named_parameters()) {
        const auto& numbers = weights.at(prefix + parameter.key());
        auto& tensor = parameter.value();
        tensor.copy_(torch::tensor(at::ArrayRef<float>(numbers)).view(tensor.sizes()));
        tensor.requires_grad_(false);
    }
}

std::string last_part(const std::string& name) {
    return name.substr(name.rfind('.') + 1);
}

}  // namespace

struct ActorNetwork::Encoder : torch::nn::Module {
    explicit Encoder(const PolicyNetwork& network)
        : trunk(*this, encoder_config(network), unused_generator()) {}

    Trunk trunk;
    Dense fc{nullptr};
    torch::nn::LayerNorm ln{nullptr};
};

/// What is called actor.* or head.*: hidden layers, then the last ones.
struct ActorNetwork::Head : torch::nn::Module {
    std::vector<Dense> hidden, last;
    torch::Tensor log_std;
};

ActorNetwork::ActorNetwork(const PolicyNetwork& network,
                           const std::map<std::string, std::vector<float>>& weights, torch::Device device)
    : network_(network), encoder_(std::make_shared<Encoder>(network)), head_(std::make_shared<Head>()) {
    const auto layers = layers_of(network);
    for (const auto& layer : layers) {
        const auto name = last_part(layer.name);
        if (layer.kind == Layer::Kind::layer_norm) {
            const auto options = torch::nn::LayerNormOptions({layer.out.channels}).eps(kLayerNormEpsilon);
            encoder_->ln = encoder_->register_module(name, torch::nn::LayerNorm(options));
        } else if (layer.kind == Layer::Kind::dense && layer.name.starts_with("encoder.")) {
            encoder_->fc = encoder_->register_module(name, make_dense(layer));
        } else if (layer.kind == Layer::Kind::dense) {
            head_->hidden.push_back(head_->register_module(name, make_dense(layer)));
        }
    }
    const auto last = head_layers_of(network, layers.back().out.channels);
    for (const auto& layer : last)
        head_->last.push_back(head_->register_module(last_part(layer.name), make_dense(layer)));
    if (network.head == PolicyNetwork::Head::gaussian)
        head_->log_std = head_->register_parameter("log_std", torch::zeros({kStickSize}));

    set_parameters(*encoder_, "encoder.", weights);
    set_parameters(*head_, network.head == PolicyNetwork::Head::values ? "head." : "actor.", weights);
    encoder_->to(device);
    head_->to(device);
    if (network.num_atoms > 1) {
        support_ =
            torch::linspace(-network.value_limit, network.value_limit, network.num_atoms, torch::kFloat32)
                .to(device);
    }
}

torch::Tensor ActorNetwork::output(const torch::Tensor& observations) const {
    auto x = branch(encoder_->trunk(observations));
    const bool tanh = network_.activation == PolicyNetwork::Activation::tanh;
    for (const auto& layer : head_->hidden) x = tanh ? layer->forward(x).tanh_() : layer->forward(x).relu_();
    switch (network_.head) {
        case PolicyNetwork::Head::squashed_gaussian:
            return head_->last[0]->forward(x);
        case PolicyNetwork::Head::gaussian: {
            const auto mean = head_->last[0]->forward(x);
            return torch::cat({mean, head_->log_std.expand_as(mean)}, 1);
        }
        case PolicyNetwork::Head::categorical:
            return head_->last[0]->forward(x).log_softmax(1);
        case PolicyNetwork::Head::values:
            break;
    }
    return action_values(x);
}

torch::Tensor ActorNetwork::branch(const torch::Tensor& features) const {
    switch (network_.branch) {
        case PolicyNetwork::Branch::none:
            return features;
        case PolicyNetwork::Branch::shared:
            return encoder_->fc->forward(features).relu();
        case PolicyNetwork::Branch::actor:
            break;
    }
    const auto x = encoder_->fc->forward(features);
    if (!encoder_->ln) return x.relu();
    const auto& norm = *encoder_->ln;
    return torch::layer_norm(x, norm.options.normalized_shape(), norm.weight, norm.bias, norm.options.eps())
        .tanh();
}

torch::Tensor ActorNetwork::action_values(const torch::Tensor& hidden) const {
    auto values = head_->last[0]->forward(hidden).reshape({-1, network_.num_actions, network_.num_atoms});
    if (network_.dueling) {
        const auto state_value = head_->last[1]->forward(hidden).unsqueeze(1);
        values = state_value + values - values.mean(1, /*keepdim=*/true);
    }
    return support_.defined() ? (values.softmax(2) * support_).sum(2) : values.squeeze(2);
}

}  // namespace cale
