// A policy's network as a list of steps over one block of memory, with the weights in the kernels' order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include "policy/aligned.h"
#include "policy/kernels.h"
#include "policy/network_spec.h"
#include "policy/policy_file.h"

namespace cale::lite {

/// The location of an image or a vector in memory: row by row, the channels of a pixel side by side,
/// surrounded by zeros.
struct Place {
    std::size_t begin = 0;  // of its first pixel, behind the zeros
    std::size_t row = 0;    // floats from one row to the next
    ImageSize size{};
};

/// Steps that need no memory of their own work in place: `in` is `out`.
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
    /// Of a noisy dense layer with the draws p and q.
    struct Noise {
        std::size_t weight = 0, bias = 0;  // sigma, in InferencePlan::weights_
        Place input{};                     // f(p) x
        Place output{};                    // f(q)
        Place perturbed{};                 // sigma_W (f(p) x) + sigma_b
        bool draws_input = true;           // false: `input` is that of the layer before
    };
    std::optional<Noise> noise{};
    Convolution convolution{};
    // Of max_pool: its window, and how far that reaches beyond the image.
    std::int64_t kernel = 0, stride = 0, top = 0, left = 0;
};

/// A policy's network, ready to be computed.
struct InferencePlan {
    explicit InferencePlan(const PolicyFile& file);

    /// Computes in `memory`, which must have `memory_size` floats for each of the observations, one behind
    /// the other, and be all zero before its first use. The noise of noisy layers is drawn from `noise`;
    /// without it they are their means.
    void run(std::span<const std::uint8_t> observations, std::size_t count, std::span<float> memory,
             std::mt19937_64* noise = nullptr) const;
    /// The output for observation `i` of the last run() in this memory.
    std::span<const float> output(std::span<const float> memory, std::size_t i) const;

    PolicyInfo info;
    Head head;
    bool noisy = false;  // is_noisy()
    std::size_t memory_size = 0;

  private:
    class Builder;
    void read_pixels(std::span<const std::uint8_t> observation, float* memory) const;
    void run_step(const Step& step, float* memory) const;
    void run_dense(const Step& step, std::size_t count, float* memory) const;
    void add_noise(const Step& step, float* memory, std::mt19937_64& random) const;
    void finish(float* memory) const;

    Floats weights_;
    Place pixels_;
    std::vector<Step> steps_;
    Place outputs_, value_;  // outputs of the head's dense layers; value_: where dueling
    Place actions_;          // of a head of values: an output for each action; outputs_ without factors
    Place output_;
    std::size_t log_std_ = 0;       // of a gaussian head, in weights_
    std::vector<float> combine_{};  // factor_means(), of a head with factors
};

}  // namespace cale::lite

namespace cale {

/// Sets the golden pair of a policy: golden_observation() and the network's output for it.
void set_golden_pair(PolicyFile& policy);

}  // namespace cale
