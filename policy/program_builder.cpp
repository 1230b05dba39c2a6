#include "policy/program.h"

#include <algorithm>
#include <utility>

namespace cale::lite {
namespace {

std::size_t size(std::int64_t number) {
    return static_cast<std::size_t>(number);
}

/// Floats of so many that begin with a cache line of their own each.
std::size_t whole_lines(std::size_t floats) {
    constexpr std::size_t line = 16;
    return (floats + line - 1) / line * line;
}

}  // namespace

/// Walks through the layers and gives each its memory. What a convolution reads is laid out with its zeros
/// around it.
class Program::Builder {
  public:
    Builder(Program& program, const PolicyFile& file)
        : program_(program), file_(file), layers_(layers_of(file.network)) {}

    void build() {
        const auto& acting = file_.network;
        const ImageSize frame{acting.stack, acting.frame_height, acting.frame_width};
        now_ = program_.pixels_ = place(frame, zeros_for(0));
        for (std::size_t i = 0; i < layers_.size();) i = add(i);
        const auto input = now_;
        for (const auto& layer : head_layers_of(acting, layers_.back().out.channels)) {
            now_ = input;
            add_dense(layer);
            (layer.name == "head.value" ? program_.value_ : program_.head_) = now_;
        }
        if (acting.head == PolicyNetwork::Head::gaussian) program_.log_std_ = keep_weights("actor.log_std");
        program_.output_ = place({output_size(acting), 1, 1}, {});
    }

  private:
    struct Zeros {
        std::int64_t top = 0, left = 0, bottom = 0, right = 0;
    };

    Place place(const ImageSize& image, const Zeros& zeros) {
        const auto row = size((image.columns + zeros.left + zeros.right) * image.channels);
        const auto begin = program_.memory_size;
        program_.memory_size += whole_lines(row * size(image.rows + zeros.top + zeros.bottom));
        return {begin + size(zeros.top) * row + size(zeros.left * image.channels), row, image};
    }

    Zeros zeros_for(std::size_t layer) const {
        if (layer >= layers_.size() || layers_[layer].kind != Layer::Kind::conv) return {};
        const auto& conv = layers_[layer];
        return {conv.top, conv.left, conv.bottom, conv.right};
    }

    std::size_t next_convolution(std::size_t layer) const {
        while (layer < layers_.size() && layers_[layer].kind != Layer::Kind::conv) ++layer;
        return layer;
    }

    bool is(std::size_t layer, Layer::Kind kind) const {
        return layer < layers_.size() && layers_[layer].kind == kind;
    }

    /// Adds this layer, and those behind it that are done with it in one step. Returns the next one.
    std::size_t add(std::size_t i) {
        const auto& layer = layers_[i];
        switch (layer.kind) {
            case Layer::Kind::conv:
                return add_convolution(i);
            case Layer::Kind::max_pool:
                // Residual blocks keep its result, add to it, and the next stage's convolution reads it.
                step({.kind = Step::Kind::max_pool,
                      .out = place(layer.out, zeros_for(next_convolution(i))),
                      .top = layer.top,
                      .left = layer.left});
                break;
            case Layer::Kind::keep:
                kept_ = now_;
                break;
            case Layer::Kind::relu:
                // Of an image that is needed as it is: the convolution's input is a copy.
                step({.kind = Step::Kind::relu, .out = image_ ? place(layer.out, zeros_for(i + 1)) : now_});
                break;
            case Layer::Kind::tanh:
                step({.kind = Step::Kind::tanh, .out = now_});
                break;
            case Layer::Kind::flatten:
                image_ = false;
                break;
            case Layer::Kind::dense:
                add_dense(layer);
                break;
            case Layer::Kind::layer_norm:
                step({.kind = Step::Kind::layer_norm,
                      .out = now_,
                      .weight = keep_weights(layer.name + ".weight"),
                      .bias = keep_weights(layer.name + ".bias")});
                break;
            case Layer::Kind::add_kept:
                break;  // done by the convolution before it
        }
        return i + 1;
    }

    void step(Step step) {
        step.in = now_;
        now_ = step.out;
        program_.steps_.push_back(step);
    }

    std::size_t add_convolution(std::size_t i) {
        const auto& layer = layers_[i];
        const bool adds = is(i + 1, Layer::Kind::add_kept);
        const bool has_relu = is(i + 1, Layer::Kind::relu);
        const auto next = i + (adds || has_relu ? 2 : 1);
        const auto out = adds ? kept_ : place(layer.out, zeros_for(next));
        const auto vector = kernels().vector;
        const auto channels = size(layer.out.channels);
        const Convolution convolution{.kernel_rows = size(layer.kernel_rows),
                                      .kernel_width = size(layer.kernel_columns * layer.in.channels),
                                      .input_row = now_.row,
                                      .row_stride = size(layer.stride_rows) * now_.row,
                                      .pixel_stride = size(layer.stride_columns * layer.in.channels),
                                      .rows = size(layer.out.rows),
                                      .columns = size(layer.out.columns),
                                      .channels = channels,
                                      .output_row = out.row,
                                      .block = channels % (2 * vector) == 0 ? 2 * vector : vector,
                                      .store = adds       ? Store::add
                                               : has_relu ? Store::relu
                                                          : Store::plain};
        // A kernel reads from the first zero before its first pixel.
        now_.begin -= size(layer.top) * now_.row + size(layer.left * layer.in.channels);
        step({.kind = Step::Kind::convolve,
              .out = out,
              .weight = keep_kernel(layer, convolution.block),
              .bias = keep_weights(layer.name + ".bias"),
              .convolution = convolution});
        return next;
    }

    void add_dense(const Layer& layer) {
        const bool of_image = now_.size.rows * now_.size.columns > 1;
        step({.kind = Step::Kind::dense,
              .out = place({layer.out.channels, 1, 1}, {}),
              .weight = of_image ? keep_transposed(layer, now_.size) : keep_weights(layer.name + ".weight"),
              .bias = keep_weights(layer.name + ".bias")});
    }

    std::size_t reserve(std::size_t floats) {
        const auto begin = program_.weights_.size();
        program_.weights_.resize(begin + whole_lines(floats));
        return begin;
    }

    std::size_t keep_weights(const std::string& name) {
        const auto& weights = file_.weights.at(name);
        const auto begin = reserve(weights.size());
        std::copy(weights.begin(), weights.end(),
                  program_.weights_.begin() + static_cast<std::ptrdiff_t>(begin));
        return begin;
    }

    /// [out, in, rows, columns] as [out / block][rows][columns][in][block].
    std::size_t keep_kernel(const Layer& layer, std::size_t block) {
        const auto& stored = file_.weights.at(layer.name + ".weight");
        const auto rows = size(layer.kernel_rows), columns = size(layer.kernel_columns);
        const auto in = size(layer.in.channels), out = size(layer.out.channels);
        const auto begin = reserve(stored.size());
        float* to = &program_.weights_[begin];
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
    std::size_t keep_transposed(const Layer& layer, const ImageSize& image) {
        const auto& stored = file_.weights.at(layer.name + ".weight");
        const auto channels = size(image.channels), pixels = size(image.rows * image.columns);
        const auto begin = reserve(stored.size());
        float* to = &program_.weights_[begin];
        for (std::size_t row = 0; row < size(layer.out.channels); ++row) {
            const float* const from = &stored[row * channels * pixels];
            for (std::size_t pixel = 0; pixel < pixels; ++pixel)
                for (std::size_t channel = 0; channel < channels; ++channel)
                    *to++ = from[channel * pixels + pixel];
        }
        return begin;
    }

    Program& program_;
    const PolicyFile& file_;
    std::vector<Layer> layers_;
    Place now_{}, kept_{};
    bool image_ = true;  // what now_ holds: an image, or a vector
};

Program::Program(const PolicyFile& file) : info(file.info), network(file.network) {
    Builder(*this, file).build();
}

}  // namespace cale::lite
