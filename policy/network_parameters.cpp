#include "policy/network_parameters.h"

#include <numeric>

namespace cale {

using Kind = Layer::Kind;

std::int64_t num_outputs(const Head& head) {
    return head.factors.empty() ? head.num_actions : std::reduce(head.factors.begin(), head.factors.end());
}

std::vector<SizedLayer> head_layers(const Head& head, std::int64_t inputs) {
    const auto dense = [&](const char* name, std::int64_t outputs) {
        SizedLayer layer{Layer::dense(name, outputs, head.noisy)};
        layer.in = {inputs};
        layer.out = {outputs};
        return layer;
    };
    switch (head.kind) {
        case Head::Kind::squashed_gaussian:
            return {dense("actor.out", 2 * head.axes)};
        case Head::Kind::gaussian:
            return {dense("actor.mean", head.axes)};
        case Head::Kind::categorical:
            return {dense("actor.out", head.num_actions)};
        case Head::Kind::values:
            break;
    }
    const auto outputs = num_outputs(head) * head.num_atoms;
    if (head.dueling) return {dense("head.adv", outputs), dense("head.value", head.num_atoms)};
    return {dense("head.out", outputs)};
}

std::vector<ParameterShape> parameter_shapes(const NetworkSpec& network) {
    std::vector<ParameterShape> parameters;
    const auto add = [&](const SizedLayer& layer) {
        std::vector<std::int64_t> weight{layer.out.channels};
        if (layer.kind == Kind::conv) {
            weight = {layer.outputs, layer.in.channels, layer.kernel, layer.kernel};
        } else if (layer.kind == Kind::dense) {
            weight = {layer.outputs, layer.in.channels};
        } else if (layer.kind != Kind::layer_norm) {
            return;
        }
        parameters.push_back({layer.name + ".weight", weight});
        parameters.push_back({layer.name + ".bias", {layer.out.channels}});
        if (!layer.noisy) return;
        parameters.push_back({layer.name + ".weight_sigma", weight});
        parameters.push_back({layer.name + ".bias_sigma", {layer.out.channels}});
    };
    const auto layers = sized_layers(network);
    for (const auto& layer : layers) add(layer);
    for (const auto& layer : head_layers(network.head, layers.back().out.channels)) add(layer);
    if (network.head.kind == Head::Kind::gaussian)
        parameters.push_back({"actor.log_std", {network.head.axes}});
    return parameters;
}

std::int64_t output_size(const Head& head) {
    return head.continuous() ? 2 * head.axes : head.num_actions;
}

}  // namespace cale
