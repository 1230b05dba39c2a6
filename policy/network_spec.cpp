#include "policy/network_spec.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <tuple>

namespace cale {

using Kind = Layer::Kind;

std::span<const std::string_view> names_of(Padding) {
    static constexpr std::string_view names[] = {"same", "valid"};
    return names;
}

std::pair<std::int64_t, std::int64_t> same_padding(std::int64_t size, std::int64_t kernel,
                                                   std::int64_t stride) {
    const auto positions = (size + stride - 1) / stride;
    const auto total = std::max<std::int64_t>((positions - 1) * stride + kernel - size, 0);
    return {total / 2, total - total / 2};
}

Layer Layer::conv(std::string name, std::int64_t channels, std::int64_t kernel, std::int64_t stride,
                  Padding padding, bool rows) {
    return {Kind::conv, std::move(name), channels, kernel, stride, padding, rows};
}

Layer Layer::max_pool(std::int64_t kernel, std::int64_t stride) {
    return {.kind = Kind::max_pool, .kernel = kernel, .stride = stride};
}

Layer Layer::dense(std::string name, std::int64_t units, bool noisy) {
    return {.kind = Kind::dense, .name = std::move(name), .outputs = units, .noisy = noisy};
}

Layer Layer::layer_norm(std::string name) {
    return {.kind = Kind::layer_norm, .name = std::move(name)};
}

Layers prefixed(std::string_view prefix, Layers layers) {
    for (auto& layer : layers)
        if (!layer.name.empty()) layer.name.insert(0, prefix);
    return layers;
}

Layers chain(std::initializer_list<Layers> lists) {
    Layers all;
    for (const auto& list : lists) all.insert(all.end(), list.begin(), list.end());
    return all;
}

Layers hidden_layers(std::int64_t count, std::int64_t units, Layer::Kind activation, bool layer_norm) {
    Layers layers;
    for (std::int64_t i = 1; i <= count; ++i) {
        layers.push_back(Layer::dense("fc" + std::to_string(i), units));
        if (layer_norm) layers.push_back(Layer::layer_norm("ln" + std::to_string(i)));
        layers.push_back(Layer::of(activation));
    }
    return layers;
}

bool is_noisy(const NetworkSpec& network) {
    return network.head.noisy || std::ranges::any_of(network.layers, &Layer::noisy);
}

// Sizes ---------------------------------------------------------------------------------

namespace {

enum class Form { image, bytes, vector };

/// What passes through the layers of a network.
struct Signal {
    Form form = Form::vector;
    ImageSize size{};
    bool operator==(const Signal&) const = default;
};

Signal signal_of(const std::vector<std::int64_t>& shape) {
    const bool positive = std::ranges::all_of(shape, [](std::int64_t size) { return size > 0; });
    if (!positive || shape.empty() || shape.size() > 3)
        throw std::invalid_argument("a network's input has one to three dimensions of at least 1");
    if (shape.size() == 3) return {Form::image, {shape[0], shape[1], shape[2]}};
    if (shape.size() == 2) return {Form::bytes, {shape[0], 1, shape[1]}};
    return {Form::vector, {shape[0]}};
}

void require(bool fits, std::string_view layer, std::string_view wants) {
    if (fits) return;
    throw std::invalid_argument(std::string(layer).append(" needs ").append(wants));
}

/// Sets the window's sizes and how many positions it has on the image.
void set_window(SizedLayer& layer, bool same) {
    require(layer.kernel > 0 && layer.stride > 0, "a window", "a kernel and a stride of at least 1");
    layer.kernel_rows = layer.rows ? 1 : layer.kernel;
    layer.stride_rows = layer.rows ? 1 : layer.stride;
    layer.kernel_columns = layer.kernel;
    layer.stride_columns = layer.stride;
    if (same) {
        std::tie(layer.top, layer.bottom) = same_padding(layer.in.rows, layer.kernel_rows, layer.stride_rows);
        std::tie(layer.left, layer.right) =
            same_padding(layer.in.columns, layer.kernel_columns, layer.stride_columns);
    }
    const auto positions = [](std::int64_t size, std::int64_t kernel, std::int64_t stride) {
        require(size >= kernel, "a network", "frames that are no smaller than its kernels");
        return (size - kernel) / stride + 1;
    };
    layer.out.rows =
        positions(layer.in.rows + layer.top + layer.bottom, layer.kernel_rows, layer.stride_rows);
    layer.out.columns =
        positions(layer.in.columns + layer.left + layer.right, layer.kernel_columns, layer.stride_columns);
}

/// Sets the layer's sizes and `signal` to its result. Nothing is kept where that has no channels.
void pass(SizedLayer& layer, Signal& signal, Signal& kept) {
    layer.in = layer.out = signal.size;
    switch (layer.kind) {
        case Kind::conv:
            require(signal.form == Form::image, "the convolution " + layer.name, "an image");
            require(layer.outputs > 0, "the convolution " + layer.name, "a channel");
            set_window(layer, layer.rows || layer.padding == Padding::same);
            if (layer.rows) layer.kernel_slice = same_padding(1, layer.kernel, layer.stride).first;
            layer.out.channels = layer.outputs;
            break;
        case Kind::max_pool:
            require(signal.form == Form::image, "max_pool", "an image");
            set_window(layer, /*same=*/true);
            break;
        case Kind::flatten:
            require(signal.form != Form::vector, "flatten", "an image or bytes");
            signal.form = Form::vector;
            layer.out = {signal.size.count()};
            break;
        case Kind::dense:
            require(signal.form == Form::vector, "the dense layer " + layer.name, "a vector: flatten first");
            require(layer.outputs > 0, "the dense layer " + layer.name, "a unit");
            layer.out = {layer.outputs};
            break;
        case Kind::layer_norm:
            require(signal.form == Form::vector, "layer_norm", "a vector: flatten first");
            break;
        case Kind::keep:
            require(kept.size.channels == 0, "a second keep", "an add_kept before it");
            kept = signal;
            break;
        case Kind::add_kept:
            require(kept == signal, "add_kept", "a keep before it and a result of the same size");
            kept = {};
            break;
        case Kind::relu:
        case Kind::tanh:
            break;
    }
    signal.size = layer.out;
}

}  // namespace

std::vector<SizedLayer> sized_layers(const Layers& layers, const std::vector<std::int64_t>& input) {
    auto signal = signal_of(input);
    Signal kept;
    std::vector<SizedLayer> sized;
    for (const auto& layer : layers) pass(sized.emplace_back(SizedLayer{layer}), signal, kept);
    require(kept.size.channels == 0, "keep", "an add_kept behind it");
    return sized;
}

std::vector<SizedLayer> sized_layers(const NetworkSpec& network) {
    auto sized = sized_layers(network.layers, network.observation);
    const bool flattens =
        std::ranges::find(network.layers, Kind::flatten, &Layer::kind) != network.layers.end();
    require(flattens && network.observation.size() > 1, "the head", "a flattened observation");
    return sized;
}

}  // namespace cale
