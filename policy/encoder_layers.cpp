#include "policy/encoder_layers.h"

#include <cstdint>
#include <initializer_list>
#include <utility>

namespace cale {
namespace {

Layer relu() {
    return Layer::of(Layer::Kind::relu);
}

/// The convolutions, each with ReLU; flattened.
Layers convolutions(std::initializer_list<Layer> of) {
    Layers layers;
    for (const auto& convolution : of) layers.insert(layers.end(), {convolution, relu()});
    layers.push_back(Layer::of(Layer::Kind::flatten));
    return layers;
}

}  // namespace

Layers phi_sac(Padding padding) {
    return convolutions({Layer::conv("conv1", 32, 3, 2, padding), Layer::conv("conv2", 32, 3, 1, padding),
                         Layer::conv("conv3", 32, 3, 1, padding), Layer::conv("conv4", 32, 3, 1, padding)});
}

Layers phi_dqn(Padding padding, bool rows) {
    return convolutions({Layer::conv("conv1", 32, 8, 4, padding, rows),
                         Layer::conv("conv2", 64, 4, 2, padding, rows),
                         Layer::conv("conv3", 64, 3, 1, padding, rows)});
}

Layers impala() {
    Layers layers;
    for (const auto& [stage, channels] : {std::pair{"stage1", 16}, {"stage2", 32}, {"stage3", 32}}) {
        const auto conv = [&, stage = stage, channels = channels](const char* name) {
            return Layer::conv(std::string(stage) + name, channels, 3, 1);
        };
        layers.push_back(conv("_conv"));
        layers.push_back(Layer::max_pool(3, 2));
        for (const auto& [first, second] :
             {std::pair{"_block1_conv1", "_block1_conv2"}, {"_block2_conv1", "_block2_conv2"}}) {
            layers.push_back(Layer::of(Layer::Kind::keep));
            layers.push_back(relu());
            layers.push_back(conv(first));
            layers.push_back(relu());
            layers.push_back(conv(second));
            layers.push_back(Layer::of(Layer::Kind::add_kept));
        }
    }
    layers.push_back(relu());
    layers.push_back(Layer::of(Layer::Kind::flatten));
    return layers;
}

Layers compact() {
    constexpr auto valid = Padding::valid;
    return convolutions({Layer::conv("conv1", 32, 3, 2, valid), Layer::conv("conv2", 32, 3, 2, valid),
                         Layer::conv("conv3", 32, 3, 2, valid), Layer::conv("conv4", 32, 3, 1, valid)});
}

Layers data_efficient() {
    return convolutions(
        {Layer::conv("conv1", 32, 5, 5, Padding::valid), Layer::conv("conv2", 64, 5, 5, Padding::valid)});
}

Layers phi_dqn_2013() {
    return convolutions(
        {Layer::conv("conv1", 16, 8, 4, Padding::valid), Layer::conv("conv2", 32, 4, 2, Padding::valid)});
}

Layers mlp(bool layer_norm) {
    constexpr std::int64_t units = 256;
    return chain(
        {Layers{Layer::of(Layer::Kind::flatten)}, hidden_layers(2, units, Layer::Kind::relu, layer_norm)});
}

Layers flat() {
    return {Layer::of(Layer::Kind::flatten)};
}

Layers tanh_branch(const std::string& name) {
    return {Layer::dense(name + "_fc", 50), Layer::layer_norm(name + "_ln"), Layer::of(Layer::Kind::tanh)};
}

Layers relu_branch(const std::string& name, bool layer_norm) {
    Layers layers{Layer::dense(name + "_fc", 512)};
    if (layer_norm) layers.push_back(Layer::layer_norm(name + "_ln"));
    layers.push_back(relu());
    return layers;
}

}  // namespace cale
