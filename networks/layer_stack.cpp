#include "networks/layer_stack.h"

#include <array>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

namespace cale {
namespace {

using Kind = Layer::Kind;

/// Writes planes of bytes as numbers from 0 to 1, the channels of a pixel side by side.
template <class Number>
void scale_planes(const torch::Tensor& bytes, torch::Tensor& scaled) {
    static const auto table = [] {
        std::array<Number, 256> values{};
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i) / 255;
        return values;
    }();
    const auto planes = bytes.contiguous();
    const auto channels = bytes.size(1), pixels = bytes.size(2) * bytes.size(3);
    const auto* from = planes.const_data_ptr<std::uint8_t>();
    auto* to = scaled.data_ptr<Number>();
    at::parallel_for(0, bytes.size(0), /*grain_size=*/4, [&](std::int64_t begin, std::int64_t end) {
        for (std::int64_t image = begin * channels * pixels; image < end * channels * pixels;
             image += channels * pixels) {
            for (std::int64_t channel = 0; channel < channels; ++channel) {
                for (std::int64_t pixel = 0; pixel < pixels; ++pixel)
                    to[image + pixel * channels + channel] = table[from[image + channel * pixels + pixel]];
            }
        }
    });
}

/// [B, C, H, W] bytes as numbers from 0 to 1, channels last: several times faster to convolve on a CPU than
/// channels first. There it is one pass by table; LibTorch's own three cost 8 % of an update of DQN.
torch::Tensor scaled_pixels(const torch::Tensor& bytes, at::ScalarType type) {
    if (!bytes.is_cpu() || (type != at::kFloat && type != at::kBFloat16))
        return bytes.to(type).div_(255).contiguous(at::MemoryFormat::ChannelsLast);
    auto scaled =
        torch::empty(bytes.sizes(), torch::dtype(type).memory_format(at::MemoryFormat::ChannelsLast));
    type == at::kFloat ? scale_planes<float>(bytes, scaled) : scale_planes<at::BFloat16>(bytes, scaled);
    return scaled;
}

torch::Tensor max_pool_same(const torch::Tensor& x, std::int64_t kernel, std::int64_t stride) {
    const auto [top, bottom] = same_padding(x.size(2), kernel, stride);
    const auto [left, right] = same_padding(x.size(3), kernel, stride);
    const auto padded =
        at::constant_pad_nd(x, {left, right, top, bottom}, -std::numeric_limits<double>::infinity());
    return at::max_pool2d(padded, kernel, stride);
}

}  // namespace

LayerStack::LayerStack(torch::nn::Module& owner, const Layers& layers, const std::vector<std::int64_t>& input,
                       const Initialiser& initialise, const at::Generator& generator)
    : input_(input), features_(std::reduce(input.begin(), input.end(), std::int64_t{1}, std::multiplies())) {
    for (const auto& layer : sized_layers(layers, input)) {
        Parameters parameters;
        if (layer.kind == Kind::conv) {
            Conv conv(layer.in.channels, layer.outputs, layer.kernel, layer.stride, initialise, generator,
                      layer.padding);
            parameters = owner.register_module(layer.name, conv);
            if (!weight_.defined()) weight_ = conv->weight;
        } else if (layer.kind == Kind::dense) {
            const auto dense = add_dense(owner, layer.name, layer.in.channels, layer.outputs, initialise,
                                         layer.noisy ? std::optional(0.0) : std::nullopt, generator);
            parameters = dense;
            if (!weight_.defined()) weight_ = dense.weight();
        } else if (layer.kind == Kind::layer_norm) {
            const auto options = torch::nn::LayerNormOptions({layer.out.channels}).eps(kLayerNormEpsilon);
            parameters = owner.register_module(layer.name, torch::nn::LayerNorm(options));
        }
        items_.push_back({layer, std::move(parameters)});
        features_ = layer.out.count();
    }
}

torch::Tensor LayerStack::operator()(torch::Tensor x, const Watch& watch,
                                     const std::optional<at::Generator>& noise) const {
    torch::Tensor kept;
    bool behind_product = false;
    for (const auto& [layer, parameters] : items_) {
        switch (layer.kind) {
            case Kind::conv: {
                const auto& conv = *std::get<Conv>(parameters);
                x = layer.rows ? conv.forward_rows(x) : conv.forward(x);
                break;
            }
            case Kind::max_pool:
                x = max_pool_same(x, layer.kernel, layer.stride);
                break;
            case Kind::relu:
                // Nothing else needs the result of a convolution or of a dense layer.
                x = behind_product ? x.relu_() : x.relu();
                break;
            case Kind::tanh:
                x = x.tanh();
                break;
            case Kind::keep:
                kept = x;
                break;
            case Kind::add_kept:
                x = std::exchange(kept, torch::Tensor()) + x;
                break;
            case Kind::flatten:
                x = x.flatten(1);
                break;
            case Kind::dense: {
                const bool noisy = noise && layer.noisy;
                const auto normal = [&](std::int64_t size) {
                    return noisy ? torch::randn({x.size(0), size}, *noise).to(x.device()) : torch::Tensor();
                };
                const FactorisedNoise draw{normal(x.size(1)), normal(layer.outputs)};
                x = std::get<AnyDense>(parameters)(x, noisy ? &draw : nullptr);
                break;
            }
            case Kind::layer_norm:
                x = normalised(*std::get<torch::nn::LayerNorm>(parameters), x);
                break;
        }
        behind_product = layer.kind == Kind::conv || layer.kind == Kind::dense;
        if (watch && (layer.kind == Kind::relu || layer.kind == Kind::tanh)) watch(x);
    }
    return x;
}

torch::Tensor LayerStack::scaled(const torch::Tensor& observation, Precision precision) const {
    const bool matches =
        observation.dim() == std::ssize(input_) + 1 && observation.sizes().slice(1) == input_;
    if (!matches || observation.scalar_type() != torch::kUInt8) {
        throw std::invalid_argument("the encoder reads observations of shape [B, " +
                                    shape_text(input_).substr(1) + " and type uint8, not " +
                                    shape_text(observation.sizes()) + " " +
                                    std::string(observation.dtype().name()));
    }
    const auto own = weight_.defined() ? weight_.scalar_type() : at::kFloat;
    const auto type = precision == Precision::bf16 ? at::kBFloat16 : own;
    const bool convolves = !items_.empty() && items_.front().layer.kind == Kind::conv;
    return convolves ? scaled_pixels(observation, type) : observation.to(type).div_(255);
}

}  // namespace cale
