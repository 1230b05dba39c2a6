// A policy's network as a list of steps over one block of memory, with the weights in the order that the
// kernels read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "policy/aligned.h"
#include "policy/kernels.h"
#include "policy/policy_file.h"

namespace cale::lite {

/// Where an image or a vector lies in the memory: row by row, the channels of a pixel side by side, zeros
/// around it.
struct Place {
    std::size_t begin = 0;  // of its first pixel, behind the zeros
    std::size_t row = 0;    // floats from one row to the next
    ImageSize size{};
};

/// Kinds that need no memory of their own work in place, where `in` is `out`.
struct Step {
    enum class Kind { convolve, max_pool, relu, tanh, dense, layer_norm };
    Kind kind = Kind::relu;
    Place in{}, out{};
    std::size_t weight = 0, bias = 0;  // in Program::weights
    Convolution convolution{};
    std::int64_t top = 0, left = 0;  // of max_pool: pixels of its window beyond the image
};

struct Program {
    explicit Program(const PolicyFile& file);

    /// Computes into `memory`, which has `memory_size` floats and was all zero before its first use.
    /// Returns the output in it.
    std::span<const float> run(std::span<const std::uint8_t> observation, std::span<float> memory) const;

    PolicyInfo info;
    PolicyNetwork network;
    std::size_t memory_size = 0;

  private:
    class Builder;
    void read_pixels(std::span<const std::uint8_t> observation, float* memory) const;
    void run_step(const Step& step, float* memory) const;
    void finish(float* memory) const;

    Floats weights_;
    Place pixels_;
    std::vector<Step> steps_;
    Place head_, value_;  // what the head's dense layers gave; value_: of dueling ones
    Place output_;
    std::size_t log_std_ = 0;  // of a gaussian head, in weights_
};

}  // namespace cale::lite
