// A policy's network as a list of steps over one block of memory, with the weights in the order that the
// kernels read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "policy/aligned.h"
#include "policy/kernels.h"
#include "policy/network_spec.h"
#include "policy/policy_file.h"

namespace cale::lite {

/// Where an image or a vector lies in the memory: row by row, the channels of a pixel side by side, zeros
/// around it.
struct Place {
    std::size_t begin = 0;  // of its first pixel, behind the zeros
    std::size_t row = 0;    // floats from one row to the next
    ImageSize size{};
};

/// What needs no memory of its own works in place, where `in` is `out`.
struct Step {
    enum class Kind {
        convolve,
        max_pool,
        copy,
        relu,
        tanh,
        add,      // to what is in `out`
        flatten,  // to the order channel, row, column
        dense,
        layer_norm
    };
    Kind kind = Kind::relu;
    Place in{}, out{};
    std::size_t weight = 0, bias = 0;  // in InferencePlan::weights_
    Convolution convolution{};
    // Of max_pool: its window, and how far that reaches beyond the image.
    std::int64_t kernel = 0, stride = 0, top = 0, left = 0;
};

/// A policy's network, ready to be computed.
struct InferencePlan {
    explicit InferencePlan(const PolicyFile& file);

    /// Computes into `memory`, which has `memory_size` floats and was all zero before its first use.
    /// Returns the output in it.
    std::span<const float> run(std::span<const std::uint8_t> observation, std::span<float> memory) const;

    PolicyInfo info;
    Head head;
    std::size_t memory_size = 0;

  private:
    class Builder;
    void read_pixels(std::span<const std::uint8_t> observation, float* memory) const;
    void run_step(const Step& step, float* memory) const;
    void finish(float* memory) const;

    Floats weights_;
    Place pixels_;
    std::vector<Step> steps_;
    Place outputs_, value_;  // what the head's dense layers gave; value_: of dueling ones
    Place output_;
    std::size_t log_std_ = 0;  // of a gaussian head, in weights_
};

}  // namespace cale::lite

namespace cale {

/// Sets the golden pair of a policy: golden_observation() and what its network gives for it.
void set_golden_pair(PolicyFile& policy);

}  // namespace cale
