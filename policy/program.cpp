#include "policy/program.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace cale::lite {
namespace {

std::size_t size(std::int64_t number) {
    return static_cast<std::size_t>(number);
}

std::size_t count(const Place& place) {
    return size(place.size.count());
}

}  // namespace

std::span<const float> Program::run(std::span<const std::uint8_t> observation,
                                    std::span<float> memory) const {
    read_pixels(observation, memory.data());
    for (const auto& step : steps_) run_step(step, memory.data());
    finish(memory.data());
    return memory.subspan(output_.begin, count(output_));
}

void Program::read_pixels(std::span<const std::uint8_t> observation, float* memory) const {
    static constexpr auto scaled = [] {
        std::array<float, 256> values{};
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i) / 255;
        return values;
    }();
    const auto channels = size(pixels_.size.channels);
    const auto rows = size(pixels_.size.rows), columns = size(pixels_.size.columns);
    for (std::size_t channel = 0; channel < channels; ++channel) {
        for (std::size_t row = 0; row < rows; ++row) {
            const std::uint8_t* const from = &observation[(channel * rows + row) * columns];
            float* const to = memory + pixels_.begin + row * pixels_.row + channel;
            for (std::size_t column = 0; column < columns; ++column)
                to[column * channels] = scaled[from[column]];
        }
    }
}

namespace {

void max_pool(const Step& step, const float* in, float* out) {
    const auto& [channels, rows, columns] = step.in.size;
    const auto& result = step.out.size;
    for (std::int64_t row = 0; row < result.rows; ++row) {
        for (std::int64_t column = 0; column < result.columns; ++column) {
            float* const to = out + size(row) * step.out.row + size(column * channels);
            std::fill_n(to, channels, -std::numeric_limits<float>::infinity());
            const auto top = 2 * row - step.top, left = 2 * column - step.left;
            for (auto y = std::max<std::int64_t>(top, 0); y < std::min(top + 3, rows); ++y) {
                for (auto x = std::max<std::int64_t>(left, 0); x < std::min(left + 3, columns); ++x) {
                    const float* const from = in + size(y) * step.in.row + size(x * channels);
                    for (std::int64_t c = 0; c < channels; ++c) to[c] = std::max(to[c], from[c]);
                }
            }
        }
    }
}

void relu(const Step& step, const float* in, float* out) {
    const auto width = size(step.in.size.columns * step.in.size.channels);
    for (std::size_t row = 0; row < size(step.in.size.rows); ++row) {
        const float* const from = in + row * step.in.row;
        float* const to = out + row * step.out.row;
        for (std::size_t i = 0; i < width; ++i) to[i] = from[i] > 0 ? from[i] : 0;
    }
}

void layer_norm(std::size_t count, const float* weight, const float* bias, float* values) {
    const auto n = static_cast<double>(count);
    const double mean = std::accumulate(values, values + count, 0.0) / n;
    double variance = 0;
    for (std::size_t i = 0; i < count; ++i) variance += (values[i] - mean) * (values[i] - mean) / n;
    const double scale = 1 / std::sqrt(variance + kLayerNormEpsilon);
    for (std::size_t i = 0; i < count; ++i)
        values[i] = static_cast<float>((values[i] - mean) * scale) * weight[i] + bias[i];
}

}  // namespace

void Program::run_step(const Step& step, float* memory) const {
    const float* const in = memory + step.in.begin;
    float* const out = memory + step.out.begin;
    const float* const weight = weights_.data() + step.weight;
    const float* const bias = weights_.data() + step.bias;
    switch (step.kind) {
        case Step::Kind::convolve:
            kernels().convolve(step.convolution, in, weight, bias, out);
            break;
        case Step::Kind::max_pool:
            max_pool(step, in, out);
            break;
        case Step::Kind::relu:
            relu(step, in, out);
            break;
        case Step::Kind::tanh:
            std::transform(in, in + count(step.in), out, [](float x) { return std::tanh(x); });
            break;
        case Step::Kind::dense:
            kernels().dense(count(step.out), count(step.in), in, weight, bias, out);
            break;
        case Step::Kind::layer_norm:
            layer_norm(count(step.out), weight, bias, out);
            break;
    }
}

namespace {

/// Makes logarithms of probabilities of them.
void log_softmax(std::span<float> values) {
    const float largest = *std::max_element(values.begin(), values.end());
    double sum = 0;
    for (const float value : values) sum += std::exp(static_cast<double>(value - largest));
    for (float& value : values) value -= largest + static_cast<float>(std::log(sum));
}

/// The mean of a distribution over evenly spaced returns from -limit to limit.
float expected_return(std::span<const float> logits, double limit) {
    const float largest = *std::max_element(logits.begin(), logits.end());
    const double spacing = 2 * limit / static_cast<double>(logits.size() - 1);
    double sum = 0, weighted = 0;
    for (std::size_t atom = 0; atom < logits.size(); ++atom) {
        const double weight = std::exp(static_cast<double>(logits[atom] - largest));
        sum += weight;
        weighted += weight * (static_cast<double>(atom) * spacing - limit);
    }
    return static_cast<float>(weighted / sum);
}

}  // namespace

/// From the head's dense layers to the output.
void Program::finish(float* memory) const {
    float* const head = memory + head_.begin;
    float* const output = memory + output_.begin;
    const auto actions = size(network.num_actions), atoms = size(network.num_atoms);
    switch (network.head) {
        case PolicyNetwork::Head::squashed_gaussian:
            std::copy_n(head, count(output_), output);
            break;
        case PolicyNetwork::Head::gaussian:
            std::copy_n(head, kStickSize, output);
            std::copy_n(weights_.data() + log_std_, kStickSize, output + kStickSize);
            break;
        case PolicyNetwork::Head::categorical:
            std::copy_n(head, actions, output);
            log_softmax({output, actions});
            break;
        case PolicyNetwork::Head::values:
            if (network.dueling) {
                const float* const value = memory + value_.begin;
                for (std::size_t atom = 0; atom < atoms; ++atom) {
                    float mean = 0;
                    for (std::size_t a = 0; a < actions; ++a) mean += head[a * atoms + atom];
                    mean /= static_cast<float>(actions);
                    for (std::size_t a = 0; a < actions; ++a) head[a * atoms + atom] += value[atom] - mean;
                }
            }
            for (std::size_t a = 0; a < actions; ++a)
                output[a] =
                    atoms == 1 ? head[a] : expected_return({head + a * atoms, atoms}, network.value_limit);
            break;
    }
}

}  // namespace cale::lite
