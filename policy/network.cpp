#include "policy/network.h"

#include <algorithm>
#include <tuple>
#include <utility>

namespace cale {
namespace {

using Kind = Layer::Kind;

/// Adds layers one behind the other.
class Chain {
  public:
    explicit Chain(const PolicyNetwork& network)
        : network_(network), size_{network.stack, network.frame_height, network.frame_width} {}

    void conv(const std::string& name, std::int64_t out, std::int64_t kernel, std::int64_t stride) {
        const bool rows = network_.encoder == PolicyNetwork::Encoder::phi_dqn &&
                          network_.phi_dqn == PolicyNetwork::Rows::row1d;
        // Impala's residual blocks add what goes into them to what comes out: both have one size.
        const bool same = rows || network_.padding == PolicyNetwork::Padding::same ||
                          network_.encoder == PolicyNetwork::Encoder::impala;
        Layer layer{.kind = Kind::conv, .name = name};
        window(layer, rows ? 1 : kernel, kernel, rows ? 1 : stride, stride, same);
        if (rows) layer.kernel_slice = same_padding(1, kernel, stride).first;
        layer.out.channels = out;
        add(layer);
    }
    void max_pool() {
        Layer layer{.kind = Kind::max_pool};
        window(layer, 3, 3, 2, 2, true);
        add(layer);
    }
    void dense(const std::string& name, std::int64_t out) {
        add({.kind = Kind::dense, .name = name, .out = {out, 1, 1}});
    }
    void apply(Kind kind, const std::string& name = "") {
        add({.kind = kind,
             .name = name,
             .out = kind == Kind::flatten ? ImageSize{size_.count(), 1, 1} : size_});
    }
    std::vector<Layer> layers() && { return std::move(layers_); }

  private:
    /// Zeros before and after an axis, as networks/layers.h has them.
    static std::pair<std::int64_t, std::int64_t> same_padding(std::int64_t size, std::int64_t kernel,
                                                              std::int64_t stride) {
        const auto positions = (size + stride - 1) / stride;
        const auto total = std::max<std::int64_t>((positions - 1) * stride + kernel - size, 0);
        return {total / 2, total - total / 2};
    }

    void window(Layer& layer, std::int64_t kernel_rows, std::int64_t kernel_columns, std::int64_t stride_rows,
                std::int64_t stride_columns, bool same) const {
        layer.kernel_rows = kernel_rows;
        layer.kernel_columns = kernel_columns;
        layer.stride_rows = stride_rows;
        layer.stride_columns = stride_columns;
        if (same) {
            std::tie(layer.top, layer.bottom) = same_padding(size_.rows, kernel_rows, stride_rows);
            std::tie(layer.left, layer.right) = same_padding(size_.columns, kernel_columns, stride_columns);
        }
        const auto positions = [](std::int64_t size, std::int64_t kernel, std::int64_t stride) {
            if (size < kernel) throw FileDamage("its frames are smaller than a kernel of its network");
            return (size - kernel) / stride + 1;
        };
        layer.out = {size_.channels,
                     positions(size_.rows + layer.top + layer.bottom, kernel_rows, stride_rows),
                     positions(size_.columns + layer.left + layer.right, kernel_columns, stride_columns)};
    }

    void add(Layer layer) {
        layer.in = size_;
        size_ = layer.out;
        layers_.push_back(std::move(layer));
    }

    const PolicyNetwork& network_;
    ImageSize size_;
    std::vector<Layer> layers_;
};

void add_trunk(Chain& chain, const PolicyNetwork& network) {
    const auto conv = [&](const char* name, std::int64_t out, std::int64_t kernel, std::int64_t stride) {
        chain.conv(std::string("encoder.") + name, out, kernel, stride);
    };
    switch (network.encoder) {
        case PolicyNetwork::Encoder::phi_sac:
            conv("conv1", 32, 3, 2);
            chain.apply(Kind::relu);
            for (const auto* name : {"conv2", "conv3", "conv4"}) {
                conv(name, 32, 3, 1);
                chain.apply(Kind::relu);
            }
            break;
        case PolicyNetwork::Encoder::phi_dqn:
            conv("conv1", 32, 8, 4);
            chain.apply(Kind::relu);
            conv("conv2", 64, 4, 2);
            chain.apply(Kind::relu);
            conv("conv3", 64, 3, 1);
            chain.apply(Kind::relu);
            break;
        case PolicyNetwork::Encoder::impala:
            for (const auto& [stage, out] : {std::pair{"stage1", 16}, {"stage2", 32}, {"stage3", 32}}) {
                const std::string prefix = stage;
                conv((prefix + "_conv").c_str(), out, 3, 1);
                chain.max_pool();
                for (const auto* block : {"_block1", "_block2"}) {
                    chain.apply(Kind::keep);
                    chain.apply(Kind::relu);
                    conv((prefix + block + "_conv1").c_str(), out, 3, 1);
                    chain.apply(Kind::relu);
                    conv((prefix + block + "_conv2").c_str(), out, 3, 1);
                    chain.apply(Kind::add_kept);
                }
            }
            chain.apply(Kind::relu);
            break;
    }
    chain.apply(Kind::flatten);
}

std::string hidden_name(const PolicyNetwork& network) {
    return network.head == PolicyNetwork::Head::values ? "head." : "actor.";
}

}  // namespace

std::vector<Layer> layers_of(const PolicyNetwork& network) {
    Chain chain(network);
    add_trunk(chain, network);
    const bool phi_sac = network.encoder == PolicyNetwork::Encoder::phi_sac;
    if (network.branch == PolicyNetwork::Branch::actor) {
        chain.dense("encoder.actor_fc", phi_sac ? 50 : 512);
        if (phi_sac) chain.apply(Kind::layer_norm, "encoder.actor_ln");
        chain.apply(phi_sac ? Kind::tanh : Kind::relu);
    } else if (network.branch == PolicyNetwork::Branch::shared) {
        chain.dense("encoder.fc", 512);
        chain.apply(Kind::relu);
    }
    for (std::int64_t i = 1; i <= network.hidden_layers; ++i) {
        chain.dense(hidden_name(network) + "fc" + std::to_string(i), network.hidden_units);
        chain.apply(network.activation == PolicyNetwork::Activation::tanh ? Kind::tanh : Kind::relu);
    }
    return std::move(chain).layers();
}

std::vector<Layer> head_layers_of(const PolicyNetwork& network, std::int64_t inputs) {
    const auto dense = [&](const char* name, std::int64_t outputs) {
        return Layer{.kind = Kind::dense,
                     .name = hidden_name(network) + name,
                     .in = {inputs, 1, 1},
                     .out = {outputs, 1, 1}};
    };
    switch (network.head) {
        case PolicyNetwork::Head::squashed_gaussian:
            return {dense("out", 2 * kStickSize)};
        case PolicyNetwork::Head::gaussian:
            return {dense("mean", kStickSize)};
        case PolicyNetwork::Head::categorical:
            return {dense("out", network.num_actions)};
        case PolicyNetwork::Head::values:
            break;
    }
    const auto outputs = network.num_actions * network.num_atoms;
    if (network.dueling) return {dense("adv", outputs), dense("value", network.num_atoms)};
    return {dense("out", outputs)};
}

std::vector<NamedShape> parameters_of(const PolicyNetwork& network) {
    std::vector<NamedShape> parameters;
    const auto add = [&](const Layer& layer) {
        if (!layer.has_parameters()) return;
        std::vector<std::int64_t> weight{layer.out.channels};
        if (layer.kind == Kind::conv) {
            // Kernels are stored square.
            weight = {layer.out.channels, layer.in.channels, layer.kernel_columns, layer.kernel_columns};
        } else if (layer.kind == Kind::dense) {
            weight = {layer.out.channels, layer.in.channels};
        }
        parameters.push_back({layer.name + ".weight", ElementType::f32, weight});
        parameters.push_back({layer.name + ".bias", ElementType::f32, {layer.out.channels}});
    };
    const auto layers = layers_of(network);
    for (const auto& layer : layers) add(layer);
    for (const auto& layer : head_layers_of(network, layers.back().out.channels)) add(layer);
    if (network.head == PolicyNetwork::Head::gaussian)
        parameters.push_back({"actor.log_std", ElementType::f32, {kStickSize}});
    return parameters;
}

std::int64_t output_size(const PolicyNetwork& network) {
    return network.continuous() ? 2 * kStickSize : network.num_actions;
}

}  // namespace cale
