// The loops themselves, for vectors of any length. Each kernels_*.cpp compiles them with the instructions
// that its vectors need; in an unnamed namespace, so that no other file can link to them. For the same reason
// the standard library is not used here.
#pragma once

#include <cstddef>

#include "policy/kernels.h"

namespace cale::lite {
namespace {

/// `kLanes` floats in a vector; `kMostPixels` pixels of two vectors each fit into the registers.
template <std::size_t kLanes, std::size_t kMostPixels>
struct Loops {
    // GCC 12 forgets the attributes of a `using` that depends on kLanes.
    typedef float Register __attribute__((vector_size(kLanes * sizeof(float))));
    typedef float Unaligned
        __attribute__((vector_size(kLanes * sizeof(float)), aligned(alignof(float)), may_alias));

    static Register load(const float* from) { return *reinterpret_cast<const Unaligned*>(from); }
    static void save(float* to, Register value) { *reinterpret_cast<Unaligned*>(to) = value; }

    /// kPixels neighbouring pixels of one row, kVectors vectors of channels.
    template <std::size_t kVectors, std::size_t kPixels>
    static void block(const Convolution& shape, const float* input, const float* weights, const float* bias,
                      float* output) {
        Register sums[kPixels][kVectors];
#pragma GCC unroll 32
        for (std::size_t p = 0; p < kPixels; ++p)
#pragma GCC unroll 2
            for (std::size_t v = 0; v < kVectors; ++v) sums[p][v] = load(bias + v * kLanes);
        const std::size_t stride = shape.pixel_stride;
        for (std::size_t row = 0; row < shape.kernel_rows; ++row) {
            const float* pixel = input + row * shape.input_row;
            for (std::size_t k = 0; k < shape.kernel_width; ++k) {
                Register weight[kVectors];
#pragma GCC unroll 2
                for (std::size_t v = 0; v < kVectors; ++v) weight[v] = load(weights + v * kLanes);
#pragma GCC unroll 32
                for (std::size_t p = 0; p < kPixels; ++p) {
                    const float value = pixel[p * stride];
#pragma GCC unroll 2
                    for (std::size_t v = 0; v < kVectors; ++v) sums[p][v] += weight[v] * value;
                }
                weights += kVectors * kLanes;
                ++pixel;
            }
        }
#pragma GCC unroll 32
        for (std::size_t p = 0; p < kPixels; ++p)
#pragma GCC unroll 2
            for (std::size_t v = 0; v < kVectors; ++v) {
                float* const to = output + p * shape.channels + v * kLanes;
                Register sum = sums[p][v];
                // Keeps NaN, for require_finite() to find.
                if (shape.store == Store::relu) sum = sum < 0 ? Register{} : sum;
                if (shape.store == Store::add) sum += load(to);
                save(to, sum);
            }
    }

    using Block = void (*)(const Convolution&, const float*, const float*, const float*, float*);

    /// The block of `pixels` pixels.
    template <std::size_t kVectors, std::size_t kPixels>
    static Block block_of(std::size_t pixels) {
        if constexpr (kPixels == 1) {
            return block<kVectors, 1>;
        } else {
            return pixels == kPixels ? block<kVectors, kPixels> : block_of<kVectors, kPixels - 1>(pixels);
        }
    }

    static void convolve(const Convolution& shape, const float* input, const float* weights,
                         const float* bias, float* output) {
        // As few blocks as a row needs, all of one width; the last may repeat what the one before it did.
        const std::size_t blocks = (shape.columns + kMostPixels - 1) / kMostPixels;
        const std::size_t pixels =
            shape.store == Store::add ? divisor(shape.columns) : (shape.columns + blocks - 1) / blocks;
        const Block run =
            shape.block == kLanes ? block_of<1, kMostPixels>(pixels) : block_of<2, kMostPixels>(pixels);
        const std::size_t block_weights = shape.kernel_rows * shape.kernel_width * shape.block;
        for (std::size_t row = 0; row < shape.rows; ++row) {
            for (std::size_t channel = 0; channel < shape.channels; channel += shape.block) {
                for (std::size_t column = 0; column < shape.columns; column += pixels) {
                    const std::size_t first =
                        column + pixels <= shape.columns ? column : shape.columns - pixels;
                    run(shape, input + row * shape.row_stride + first * shape.pixel_stride,
                        weights + channel / shape.block * block_weights, bias + channel,
                        output + row * shape.output_row + first * shape.channels + channel);
                }
            }
        }
    }

    /// The widest block that goes into a row without a rest: adding must not be repeated.
    static std::size_t divisor(std::size_t columns) {
        std::size_t width = columns < kMostPixels ? columns : kMostPixels;
        while (columns % width != 0) --width;
        return width;
    }

    static constexpr std::size_t kMostVectors = 8;
    /// Vectors that meet four rows of the weights in the registers.
    static constexpr std::size_t kTogether = kMostPixels > 8 ? 4 : 2;
    /// Numbers of a row of the weights that are used for all vectors before the next ones: four rows of them
    /// stay in the first cache.
    static constexpr std::size_t kTile = 1024;

    /// Four rows of the weights at a time: as many streams from memory.
    static void dense(const DenseShape& shape, const float* input, const float* weights, const float* bias,
                      float* output) {
        for (std::size_t first = 0; first < shape.vectors; first += kMostVectors) {
            const std::size_t left = shape.vectors - first;
            const std::size_t vectors = left < kMostVectors ? left : kMostVectors;
            const float* const from = input + first * shape.next_vector;
            float* const to = output + first * shape.next_vector;
            std::size_t row = 0;
            for (; row + 4 <= shape.outputs; row += 4)
                rows<4>(shape, vectors, from, weights + row * shape.inputs, bias + row, to + row);
            for (; row < shape.outputs; ++row)
                rows<1>(shape, vectors, from, weights + row * shape.inputs, bias + row, to + row);
        }
    }

    template <std::size_t kRows>
    static void rows(const DenseShape& shape, std::size_t vectors, const float* input, const float* weights,
                     const float* bias, float* output) {
        Register sums[kMostVectors][kRows] = {};
        const std::size_t whole = shape.inputs / kLanes * kLanes;
        for (std::size_t begin = 0; begin < whole; begin += kTile) {
            const std::size_t end = begin + kTile < whole ? begin + kTile : whole;
            std::size_t v = 0;
            for (; v + kTogether <= vectors; v += kTogether)
                add_products<kRows, kTogether>(shape, begin, end, input + v * shape.next_vector, weights,
                                               sums + v);
            for (; v < vectors; ++v)
                add_products<kRows, 1>(shape, begin, end, input + v * shape.next_vector, weights, sums + v);
        }
        for (std::size_t v = 0; v < vectors; ++v) {
            const float* const numbers = input + v * shape.next_vector;
            for (std::size_t r = 0; r < kRows; ++r) {
                float lanes[kLanes];
                save(lanes, sums[v][r]);
                float sum = bias[r];
                for (const float lane : lanes) sum += lane;
                for (std::size_t rest = whole; rest < shape.inputs; ++rest)
                    sum += weights[r * shape.inputs + rest] * numbers[rest];
                output[v * shape.next_vector + r] = sum;
            }
        }
    }

    /// Adds the products of the numbers from `begin` to `end` to sums[vector][row].
    template <std::size_t kRows, std::size_t kVectors>
    static void add_products(const DenseShape& shape, std::size_t begin, std::size_t end, const float* input,
                             const float* weights, Register (*total)[kRows]) {
        Register sums[kVectors][kRows];
        for (std::size_t v = 0; v < kVectors; ++v)
            for (std::size_t r = 0; r < kRows; ++r) sums[v][r] = total[v][r];
        for (std::size_t k = begin; k < end; k += kLanes) {
            Register numbers[kVectors];
#pragma GCC unroll 4
            for (std::size_t v = 0; v < kVectors; ++v) numbers[v] = load(input + v * shape.next_vector + k);
#pragma GCC unroll 4
            for (std::size_t r = 0; r < kRows; ++r) {
                const Register weight = load(weights + r * shape.inputs + k);
#pragma GCC unroll 4
                for (std::size_t v = 0; v < kVectors; ++v) sums[v][r] += weight * numbers[v];
            }
        }
        for (std::size_t v = 0; v < kVectors; ++v)
            for (std::size_t r = 0; r < kRows; ++r) total[v][r] = sums[v][r];
    }
};

}  // namespace
}  // namespace cale::lite
