#include "policy/inference_plan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
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

void InferencePlan::run(std::span<const std::uint8_t> observations, std::size_t count,
                        std::span<float> memory, std::mt19937_64* noise) const {
    const auto each = [&](auto&& compute) {
        for (std::size_t i = 0; i < count; ++i) compute(i, memory.data() + i * memory_size);
    };
    const auto bytes = info.observation_size();
    each([&](std::size_t i, float* own) { read_pixels(observations.subspan(i * bytes, bytes), own); });
    for (auto step = steps_.begin(); step != steps_.end();) {
        if (step->kind == Step::Kind::dense) {
            run_dense(*step, count, memory.data());
            if (noise != nullptr && step->noise)
                each([&](std::size_t, float* own) { add_noise(*step, own, *noise); });
            ++step;
            continue;
        }
        // An image stays in the cache from layer to layer.
        const auto dense =
            std::find_if(step, steps_.end(), [](const Step& next) { return next.kind == Step::Kind::dense; });
        each([&](std::size_t, float* own) {
            std::for_each(step, dense, [&](const Step& next) { run_step(next, own); });
        });
        step = dense;
    }
    each([&](std::size_t, float* own) { finish(own); });
}

std::span<const float> InferencePlan::output(std::span<const float> memory, std::size_t i) const {
    return memory.subspan(i * memory_size + output_.begin, count(output_));
}

void InferencePlan::run_dense(const Step& step, std::size_t observations, float* memory) const {
    kernels().dense({.outputs = count(step.out),
                     .inputs = count(step.in),
                     .vectors = observations,
                     .next_vector = memory_size},
                    memory + step.in.begin, weights_.data() + step.weight, weights_.data() + step.bias,
                    memory + step.out.begin);
}

/// Adds f(q) (sigma_W (f(p) x) + sigma_b), f(x) = sign(x) sqrt|x| (Fortunato et al. 2018, equations 9 to 11).
void InferencePlan::add_noise(const Step& step, float* memory, std::mt19937_64& random) const {
    const auto& noise = *step.noise;
    std::normal_distribution<float> normal;
    const auto draw = [&](const Place& place) {
        std::generate_n(memory + place.begin, count(place), [&] {
            const float x = normal(random);
            return std::copysign(std::sqrt(std::abs(x)), x);
        });
    };
    const auto inputs = count(step.in), outputs = count(step.out);
    float* const input = memory + noise.input.begin;
    float* const result = memory + noise.perturbed.begin;
    if (noise.draws_input) {
        draw(noise.input);
        std::transform(input, input + inputs, memory + step.in.begin, input, std::multiplies());
    }
    draw(noise.output);
    kernels().dense({.outputs = outputs, .inputs = inputs}, input, weights_.data() + noise.weight,
                    weights_.data() + noise.bias, result);
    for (std::size_t i = 0; i < outputs; ++i)
        memory[step.out.begin + i] += memory[noise.output.begin + i] * result[i];
}

void InferencePlan::read_pixels(std::span<const std::uint8_t> observation, float* memory) const {
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

/// For numbers of channels that are no multiple of a vector: kernels() cannot store those.
void convolve_channel_by_channel(const Convolution& shape, const float* input, const float* weights,
                                 const float* bias, float* output) {
    for (std::size_t row = 0; row < shape.rows; ++row) {
        for (std::size_t column = 0; column < shape.columns; ++column) {
            const float* const window = input + row * shape.row_stride + column * shape.pixel_stride;
            float* const to = output + row * shape.output_row + column * shape.channels;
            const float* weight = weights;
            for (std::size_t channel = 0; channel < shape.channels; ++channel) {
                float sum = bias[channel];
                for (std::size_t y = 0; y < shape.kernel_rows; ++y)
                    for (std::size_t k = 0; k < shape.kernel_width; ++k)
                        sum += *weight++ * window[y * shape.input_row + k];
                if (shape.store == Store::relu) sum = std::max(sum, 0.0f);
                to[channel] = shape.store == Store::add ? to[channel] + sum : sum;
            }
        }
    }
}

void max_pool(const Step& step, const float* in, float* out) {
    const auto& [channels, rows, columns] = step.in.size;
    const auto& result = step.out.size;
    for (std::int64_t row = 0; row < result.rows; ++row) {
        for (std::int64_t column = 0; column < result.columns; ++column) {
            float* const to = out + size(row) * step.out.row + size(column * channels);
            std::fill_n(to, channels, -std::numeric_limits<float>::infinity());
            const auto top = step.stride * row - step.top, left = step.stride * column - step.left;
            for (auto y = std::max<std::int64_t>(top, 0); y < std::min(top + step.kernel, rows); ++y) {
                for (auto x = std::max<std::int64_t>(left, 0); x < std::min(left + step.kernel, columns);
                     ++x) {
                    const float* const from = in + size(y) * step.in.row + size(x * channels);
                    for (std::int64_t c = 0; c < channels; ++c)
                        if (from[c] > to[c] || std::isnan(from[c])) to[c] = from[c];
                }
            }
        }
    }
}

/// Calls change(from, to) with every number of the image and its place in the result.
template <class Change>
void each_number(const Step& step, const float* in, float* out, Change&& change) {
    const auto width = size(step.in.size.columns * step.in.size.channels);
    for (std::size_t row = 0; row < size(step.in.size.rows); ++row) {
        const float* const from = in + row * step.in.row;
        float* const to = out + row * step.out.row;
        for (std::size_t i = 0; i < width; ++i) change(from[i], to[i]);
    }
}

void flatten(const Step& step, const float* in, float* out) {
    const auto& [channels, rows, columns] = step.in.size;
    for (std::int64_t channel = 0; channel < channels; ++channel)
        for (std::int64_t row = 0; row < rows; ++row)
            for (std::int64_t column = 0; column < columns; ++column)
                *out++ = in[size(row) * step.in.row + size(column * channels + channel)];
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

void InferencePlan::run_step(const Step& step, float* memory) const {
    const float* const in = memory + step.in.begin;
    float* const out = memory + step.out.begin;
    const float* const weight = weights_.data() + step.weight;
    const float* const bias = weights_.data() + step.bias;
    switch (step.kind) {
        case Step::Kind::convolve:
            if (step.convolution.block == 1) {
                convolve_channel_by_channel(step.convolution, in, weight, bias, out);
            } else {
                kernels().convolve(step.convolution, in, weight, bias, out);
            }
            break;
        case Step::Kind::max_pool:
            max_pool(step, in, out);
            break;
        case Step::Kind::copy:
            each_number(step, in, out, [](float from, float& to) { to = from; });
            break;
        case Step::Kind::relu:
            each_number(step, in, out, [](float from, float& to) { to = from < 0 ? 0 : from; });
            break;
        case Step::Kind::tanh:
            each_number(step, in, out, [](float from, float& to) { to = std::tanh(from); });
            break;
        case Step::Kind::add:
            each_number(step, in, out, [](float from, float& to) { to += from; });
            break;
        case Step::Kind::flatten:
            flatten(step, in, out);
            break;
        case Step::Kind::dense:  // run_dense(), for all observations together
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

/// The outputs of actions from those of their choices, by factor_means().
void combine_choices(const std::vector<float>& means, std::size_t actions, std::size_t atoms,
                     const float* choices, float* values) {
    std::fill_n(values, actions * atoms, 0.0f);
    const auto count = means.size() / actions;
    for (std::size_t a = 0; a < actions; ++a)
        for (std::size_t choice = 0; choice < count; ++choice)
            for (std::size_t atom = 0; atom < atoms; ++atom)
                values[a * atoms + atom] += means[a * count + choice] * choices[choice * atoms + atom];
}

/// Wang et al. 2016, equation 9: V + A - mean over the actions of A, for each atom.
void add_state_values(const float* values, std::size_t actions, std::size_t atoms, float* advantages) {
    for (std::size_t atom = 0; atom < atoms; ++atom) {
        float mean = 0;
        for (std::size_t a = 0; a < actions; ++a) mean += advantages[a * atoms + atom];
        mean /= static_cast<float>(actions);
        for (std::size_t a = 0; a < actions; ++a) advantages[a * atoms + atom] += values[atom] - mean;
    }
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
void InferencePlan::finish(float* memory) const {
    float* const numbers = memory + outputs_.begin;
    float* const values = memory + actions_.begin;
    float* const output = memory + output_.begin;
    const auto actions = size(head.num_actions), atoms = size(head.num_atoms);
    switch (head.kind) {
        case Head::Kind::squashed_gaussian:
            std::copy_n(numbers, count(output_), output);
            break;
        case Head::Kind::gaussian:
            std::copy_n(numbers, head.axes, output);
            std::copy_n(weights_.data() + log_std_, head.axes, output + head.axes);
            break;
        case Head::Kind::categorical:
            std::copy_n(numbers, actions, output);
            log_softmax({output, actions});
            break;
        case Head::Kind::values:
            if (!combine_.empty()) combine_choices(combine_, actions, atoms, numbers, values);
            if (head.dueling) add_state_values(memory + value_.begin, actions, atoms, values);
            for (std::size_t a = 0; a < actions; ++a) {
                output[a] =
                    atoms == 1 ? values[a] : expected_return({values + a * atoms, atoms}, head.value_limit);
            }
            break;
    }
}

}  // namespace cale::lite

namespace cale {

void set_golden_pair(PolicyFile& policy) {
    policy.golden.observation = golden_observation(policy.info);
    const lite::InferencePlan plan(policy);
    lite::Floats memory(plan.memory_size);
    plan.run(policy.golden.observation, 1, memory);
    const auto output = plan.output(memory, 0);
    policy.golden.output.assign(output.begin(), output.end());
}

}  // namespace cale
