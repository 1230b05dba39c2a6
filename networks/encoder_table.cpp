// The encoders that agents choose from: which layers each has, on which branch, and how it starts.
#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "networks/encoders.h"
#include "policy/encoder_layers.h"

namespace cale {
namespace {

/// An encoder by its name in a configuration.
struct Encoder {
    std::string_view name;
    Layers (*trunk)(const EncoderConfig& config);
    Layers (*branch)(const EncoderConfig& config, bool of_critic);
    Initialiser (*initialiser)();
};

Layers narrow_branch(const EncoderConfig&, bool of_critic) {
    return tanh_branch(of_critic ? "critic" : "actor");
}

Layers wide_branch(const EncoderConfig& config, bool of_critic) {
    return relu_branch(of_critic ? "critic" : "actor", of_critic || config.layer_norm);
}

Layers no_branch(const EncoderConfig&, bool) {
    return {};
}

/// In the order of EncoderKind.
constexpr std::array<Encoder, 8> kEncoders{{
    {"phi_sac", [](const EncoderConfig& config) { return phi_sac(config.padding); }, narrow_branch,
     [] { return orthogonal(); }},
    {"phi_dqn",
     [](const EncoderConfig& config) { return phi_dqn(config.padding, config.phi_dqn == PhiDqn::row1d); },
     wide_branch, glorot_uniform},
    {"impala", [](const EncoderConfig&) { return impala(); }, wide_branch, glorot_uniform},
    {"mlp", [](const EncoderConfig& config) { return mlp(config.layer_norm); }, narrow_branch,
     glorot_uniform},
    {"compact", [](const EncoderConfig&) { return compact(); }, narrow_branch, glorot_uniform},
    {"flat", [](const EncoderConfig&) { return flat(); }, no_branch, glorot_uniform},
    {"data_efficient", [](const EncoderConfig&) { return data_efficient(); }, narrow_branch, glorot_uniform},
    {"phi_dqn_2013", [](const EncoderConfig&) { return phi_dqn_2013(); }, narrow_branch, glorot_uniform},
}};

const Encoder& encoder_of(const EncoderConfig& config) {
    return kEncoders.at(static_cast<std::size_t>(config.encoder));
}

}  // namespace

std::span<const std::string_view> names_of(EncoderKind) {
    static const auto names = [] {
        std::array<std::string_view, kEncoders.size()> all;
        std::ranges::transform(kEncoders, all.begin(), &Encoder::name);
        return all;
    }();
    return names;
}

std::span<const std::string_view> names_of(PhiDqn) {
    static constexpr std::string_view names[] = {"conv2d", "row1d"};
    return names;
}

Layers trunk_layers(const EncoderConfig& config) {
    auto layers = encoder_of(config).trunk(config);
    const bool convolves =
        std::ranges::any_of(layers, [](const Layer& layer) { return layer.kind == Layer::Kind::conv; });
    if (convolves && config.observation.size() != 3) {
        throw std::invalid_argument("agent.encoder " + std::string(encoder_of(config).name) +
                                    " convolves frames, and an observation is " +
                                    shape_text(config.observation) +
                                    " bytes: set agent.encoder to mlp or flat, or env.obs to pixels");
    }
    return layers;
}

Layers branch_layers(const EncoderConfig& config, bool of_critic) {
    return encoder_of(config).branch(config, of_critic);
}

Initialiser initialiser_of(const EncoderConfig& config) {
    return config.initialise ? config.initialise : encoder_of(config).initialiser();
}

}  // namespace cale
