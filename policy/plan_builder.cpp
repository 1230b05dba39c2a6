#include "policy/inference_plan.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "policy/factor_means.h"
#include "policy/network_parameters.h"

namespace cale::lite {
namespace {

std::size_t size(std::int64_t number) {
    return static_cast<std::size_t>(number);
}

/// Returns the number of floats, rounded up to whole cache lines.
std::size_t whole_lines(std::size_t floats) {
    constexpr std::size_t line = 16;
    return (floats + line - 1) / line * line;
}

}  // namespace

/// Walks through the layers and gives each its memory. What a convolution reads has zeros around it: they are
/// laid out with the image where the layer before knows of them, else with a copy of it.
class InferencePlan::Builder {
  public:
    Builder(InferencePlan& plan, const PolicyFile& file)
        : plan_(plan), file_(file), layers_(sized_layers(file.network)) {}

    void build() {
        now_ = new_value(layers_.front().in, zeros_for(0));
        plan_.pixels_ = now_.place;
        for (std::size_t i = 0; i < layers_.size();) i = add(i);
        const auto input = now_;
        const auto& spec = file_.network.head;
        for (const auto& layer : head_layers(spec, layers_.back().out.channels)) {
            const bool second = layer.name == "head.value";
            const auto shared = second ? plan_.steps_.back().noise : std::nullopt;
            now_ = input;
            add_dense(layer, shared);
            (second ? plan_.value_ : plan_.outputs_) = now_.place;
        }
        plan_.actions_ = plan_.outputs_;
        if (!spec.factors.empty()) {
            plan_.combine_ = factor_means(spec.factors);
            plan_.actions_ = new_value({spec.num_actions * spec.num_atoms}).place;
        }
        if (spec.kind == Head::Kind::gaussian) plan_.log_std_ = keep_weights("actor.log_std");
        plan_.output_ = new_value({output_size(spec)}).place;
    }

  private:
    using Kind = Layer::Kind;

    struct Zeros {
        std::int64_t top = 0, left = 0, bottom = 0, right = 0;
    };
    /// An image or a vector in memory, and the zeros around it.
    struct Value {
        Place place{};
        Zeros zeros{};
    };

    Value new_value(const ImageSize& image) { return new_value(image, Zeros()); }
    Value new_value(const ImageSize& image, const Zeros& zeros) {
        const auto row = size((image.columns + zeros.left + zeros.right) * image.channels);
        const auto begin = plan_.memory_size;
        plan_.memory_size += whole_lines(row * size(image.rows + zeros.top + zeros.bottom));
        return {{begin + size(zeros.top) * row + size(zeros.left * image.channels), row, image}, zeros};
    }

    bool is(std::size_t layer, Kind kind) const {
        return layer < layers_.size() && layers_[layer].kind == kind;
    }

    Zeros zeros_for(std::size_t layer) const {
        if (!is(layer, Kind::conv)) return {};
        const auto& conv = layers_[layer];
        return {conv.top, conv.left, conv.bottom, conv.right};
    }

    std::size_t next_convolution(std::size_t layer) const {
        while (layer < layers_.size() && !is(layer, Kind::conv)) ++layer;
        return layer;
    }

    /// Adds a step from what there is now to `result`, which is then what there is.
    void step(Step step, const Value& result) {
        step.in = now_.place;
        step.out = result.place;
        plan_.steps_.push_back(step);
        now_ = result;
    }

    bool is_kept() const { return kept_ && kept_->place.begin == now_.place.begin; }

    /// For a layer that can work in place, unless its input is needed again.
    Value in_place() { return is_kept() ? new_value(now_.place.size) : now_; }

    /// Adds this layer, and those behind it that are done with it in one step. Returns the next one.
    std::size_t add(std::size_t i) {
        const auto& layer = layers_[i];
        switch (layer.kind) {
            case Kind::conv:
                return add_convolution(i);
            case Kind::max_pool:
                // A residual block keeps its result and adds to it; the convolution behind the block reads
                // it.
                step({.kind = Step::Kind::max_pool,
                      .kernel = layer.kernel,
                      .stride = layer.stride,
                      .top = layer.top,
                      .left = layer.left},
                     new_value(layer.out, zeros_for(next_convolution(i))));
                break;
            case Kind::keep:
                kept_ = now_;
                break;
            case Kind::add_kept:
                step({.kind = Step::Kind::add}, *std::exchange(kept_, std::nullopt));
                break;
            case Kind::relu:
                // Where a convolution reads it, with the convolution's zeros.
                step({.kind = Step::Kind::relu},
                     is(i + 1, Kind::conv) ? new_value(layer.out, zeros_for(i + 1)) : in_place());
                break;
            case Kind::tanh:
                step({.kind = Step::Kind::tanh}, in_place());
                break;
            case Kind::flatten:
                add_flatten(i);
                break;
            case Kind::dense:
                add_dense(layer);
                break;
            case Kind::layer_norm:
                if (is_kept()) step({.kind = Step::Kind::copy}, new_value(layer.out));
                step({.kind = Step::Kind::layer_norm,
                      .weight = keep_weights(layer.name + ".weight"),
                      .bias = keep_weights(layer.name + ".bias")},
                     now_);
                break;
        }
        return i + 1;
    }

    std::size_t add_convolution(std::size_t i) {
        const auto& layer = layers_[i];
        const auto needed = zeros_for(i);
        const bool has_zeros = now_.zeros.top >= needed.top && now_.zeros.left >= needed.left &&
                               now_.zeros.bottom >= needed.bottom && now_.zeros.right >= needed.right;
        if (!has_zeros) step({.kind = Step::Kind::copy}, new_value(layer.in, needed));
        // It may not add to the image that it reads.
        const bool adds = is(i + 1, Kind::add_kept) && !is_kept();
        const bool has_relu = is(i + 1, Kind::relu);
        const auto next = i + (adds || has_relu ? 2 : 1);
        const auto out = adds ? *std::exchange(kept_, std::nullopt) : new_value(layer.out, zeros_for(next));
        const auto vector = kernels().vector;
        const auto channels = size(layer.out.channels);
        const Convolution convolution{.kernel_rows = size(layer.kernel_rows),
                                      .kernel_width = size(layer.kernel_columns * layer.in.channels),
                                      .input_row = now_.place.row,
                                      .row_stride = size(layer.stride_rows) * now_.place.row,
                                      .pixel_stride = size(layer.stride_columns * layer.in.channels),
                                      .rows = size(layer.out.rows),
                                      .columns = size(layer.out.columns),
                                      .channels = channels,
                                      .output_row = out.place.row,
                                      .block = channels % (2 * vector) == 0 ? 2 * vector
                                               : channels % vector == 0     ? vector
                                                                            : 1,
                                      .store = adds       ? Store::add
                                               : has_relu ? Store::relu
                                                          : Store::plain};
        // A kernel reads from the first zero before its first pixel.
        now_.place.begin -= size(layer.top) * now_.place.row + size(layer.left * layer.in.channels);
        step({.kind = Step::Kind::convolve,
              .weight = keep_kernel(layer, convolution.block),
              .bias = keep_weights(layer.name + ".bias"),
              .convolution = convolution},
             out);
        return next;
    }

    /// A dense layer reads an image as it lies in memory, if without zeros; any other layer wants a vector.
    void add_flatten(std::size_t i) {
        const auto& [top, left, bottom, right] = now_.zeros;
        if (is(i + 1, Kind::dense) || i + 1 == layers_.size()) {
            if (top + left + bottom + right > 0) step({.kind = Step::Kind::copy}, new_value(now_.place.size));
        } else {
            step({.kind = Step::Kind::flatten}, new_value(layers_[i].out));
        }
    }

    /// `shared`: the noise of a layer with the same input, whose draw for the input is used again.
    void add_dense(const SizedLayer& layer, const std::optional<Step::Noise>& shared = std::nullopt) {
        const auto image = now_.place.size;
        const auto keep_matrix = [&](const std::string& name) {
            return image.rows * image.columns > 1 ? keep_transposed(name, layer, image) : keep_weights(name);
        };
        Step dense{.kind = Step::Kind::dense,
                   .weight = keep_matrix(layer.name + ".weight"),
                   .bias = keep_weights(layer.name + ".bias")};
        if (layer.noisy) {
            dense.noise = {.weight = keep_matrix(layer.name + ".weight_sigma"),
                           .bias = keep_weights(layer.name + ".bias_sigma"),
                           .input = shared ? shared->input : new_value({image.count()}).place,
                           .output = new_value(layer.out).place,
                           .perturbed = new_value(layer.out).place,
                           .draws_input = !shared};
        }
        step(dense, new_value(layer.out));
    }

    std::size_t reserve(std::size_t floats) {
        const auto begin = plan_.weights_.size();
        plan_.weights_.resize(begin + whole_lines(floats));
        return begin;
    }

    std::size_t keep_weights(const std::string& name) {
        const auto& weights = file_.weights.at(name);
        const auto begin = reserve(weights.size());
        std::copy(weights.begin(), weights.end(),
                  plan_.weights_.begin() + static_cast<std::ptrdiff_t>(begin));
        return begin;
    }

    /// [out, in, rows, columns] as [out / block][rows][columns][in][block].
    std::size_t keep_kernel(const SizedLayer& layer, std::size_t block) {
        const auto& stored = file_.weights.at(layer.name + ".weight");
        const auto rows = size(layer.kernel_rows), columns = size(layer.kernel_columns);
        const auto in = size(layer.in.channels), out = size(layer.out.channels);
        const auto begin = reserve(stored.size());
        float* to = &plan_.weights_[begin];
        const auto tap = [&](std::size_t o, std::size_t i, std::size_t row, std::size_t column) {
            const auto kernel = (o * in + i) * columns * columns;  // stored square
            if (layer.kernel_slice >= 0) return stored[kernel + column * columns + size(layer.kernel_slice)];
            return stored[kernel + row * columns + column];
        };
        for (std::size_t first = 0; first < out; first += block)
            for (std::size_t row = 0; row < rows; ++row)
                for (std::size_t column = 0; column < columns; ++column)
                    for (std::size_t i = 0; i < in; ++i)
                        for (std::size_t o = first; o < first + block; ++o) *to++ = tap(o, i, row, column);
        return begin;
    }

    /// Of a dense layer behind an image: its inputs from the order (channel, row, column) to that in memory.
    std::size_t keep_transposed(const std::string& name, const SizedLayer& layer, const ImageSize& image) {
        const auto& stored = file_.weights.at(name);
        const auto channels = size(image.channels), pixels = size(image.rows * image.columns);
        const auto begin = reserve(stored.size());
        float* to = &plan_.weights_[begin];
        for (std::size_t row = 0; row < size(layer.out.channels); ++row) {
            const float* const from = &stored[row * channels * pixels];
            for (std::size_t pixel = 0; pixel < pixels; ++pixel)
                for (std::size_t channel = 0; channel < channels; ++channel)
                    *to++ = from[channel * pixels + pixel];
        }
        return begin;
    }

    InferencePlan& plan_;
    const PolicyFile& file_;
    std::vector<SizedLayer> layers_;
    Value now_{};
    std::optional<Value> kept_;
};

InferencePlan::InferencePlan(const PolicyFile& file)
    : info(file.info), head(file.network.head), noisy(is_noisy(file.network)) {
    Builder(*this, file).build();
}

}  // namespace cale::lite
