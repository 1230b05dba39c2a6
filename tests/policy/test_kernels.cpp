// Every instruction set that this machine has, held to plain loops.
#include "policy/kernels.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace cale::lite {
namespace {

std::vector<const Kernels*> kernels_here() {
    std::vector<const Kernels*> here{&kPortableKernels};
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) here.push_back(&kAvx2Kernels);
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl"))
        here.push_back(&kAvx512Kernels);
#endif
    return here;
}

std::vector<float> random_numbers(std::size_t count, std::uint32_t seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(-1, 1);
    std::vector<float> numbers(count);
    for (auto& number : numbers) number = uniform(random);
    return numbers;
}

TEST(Kernels, ConvolutionsOfEveryWidthAndStore) {
    constexpr std::size_t kIn = 3, kChannels = 32, kKernel = 3;
    for (const auto* kernels : kernels_here()) {
        for (const std::size_t stride : {1, 2}) {
            for (std::size_t columns = 1; columns <= 31; ++columns) {
                for (const auto store : {Store::plain, Store::relu, Store::add}) {
                    for (const std::size_t vectors : {1, 2}) {
                        Convolution shape;
                        shape.rows = 2;
                        shape.columns = columns;
                        shape.channels = kChannels;
                        shape.kernel_rows = kKernel;
                        shape.kernel_width = kKernel * kIn;
                        shape.input_row = ((columns - 1) * stride + kKernel) * kIn;
                        shape.row_stride = stride * shape.input_row;
                        shape.pixel_stride = stride * kIn;
                        shape.output_row = columns * kChannels;
                        shape.block = vectors * kernels->vector;
                        shape.store = store;
                        const auto input = random_numbers((stride + kKernel) * shape.input_row, 1);
                        const auto weights = random_numbers(kKernel * kKernel * kIn * kChannels, 2);
                        const auto bias = random_numbers(kChannels, 3);
                        const auto before = random_numbers(2 * shape.output_row, 4);
                        auto output = before;
                        kernels->convolve(shape, input.data(), weights.data(), bias.data(), output.data());
                        for (std::size_t row = 0; row < 2; ++row) {
                            for (std::size_t i = 0; i < columns * kChannels; ++i) {
                                const auto column = i / kChannels, channel = i % kChannels;
                                double sum = static_cast<double>(bias[channel]);
                                for (std::size_t y = 0; y < kKernel; ++y) {
                                    for (std::size_t k = 0; k < shape.kernel_width; ++k) {
                                        const auto block = channel / shape.block;
                                        const auto weight =
                                            ((block * kKernel + y) * shape.kernel_width + k) * shape.block +
                                            channel % shape.block;
                                        sum += static_cast<double>(weights[weight]) *
                                               static_cast<double>(
                                                   input[row * shape.row_stride + y * shape.input_row +
                                                         column * shape.pixel_stride + k]);
                                    }
                                }
                                const auto at = row * shape.output_row + i;
                                if (store == Store::relu) sum = std::max(sum, 0.0);
                                if (store == Store::add) sum += static_cast<double>(before[at]);
                                ASSERT_NEAR(output[at], sum, 1e-5)
                                    << kernels->name << ": " << columns << " columns, stride " << stride
                                    << ", store " << static_cast<int>(store) << ", " << vectors << " vectors";
                            }
                        }
                    }
                }
            }
        }
    }
}

TEST(Kernels, DenseLayersOfEverySize) {
    for (const auto* kernels : kernels_here()) {
        for (std::size_t inputs = 1; inputs < 70; ++inputs) {
            for (std::size_t outputs = 1; outputs < 10; ++outputs) {
                const auto input = random_numbers(inputs, 1), weights = random_numbers(inputs * outputs, 2);
                const auto bias = random_numbers(outputs, 3);
                std::vector<float> output(outputs);
                kernels->dense({.outputs = outputs, .inputs = inputs}, input.data(), weights.data(),
                               bias.data(), output.data());
                for (std::size_t row = 0; row < outputs; ++row) {
                    double sum = static_cast<double>(bias[row]);
                    for (std::size_t k = 0; k < inputs; ++k)
                        sum += static_cast<double>(weights[row * inputs + k]) * static_cast<double>(input[k]);
                    ASSERT_NEAR(output[row], sum, 1e-5) << kernels->name << " " << outputs << "x" << inputs;
                }
            }
        }
    }
}

TEST(Kernels, ADenseLayerTreatsEveryVectorAlike) {
    for (const auto* kernels : kernels_here()) {
        for (const std::size_t inputs : {1, 31, 64, 131}) {
            for (const std::size_t outputs : {1, 4, 6, 9}) {
                const auto weights = random_numbers(inputs * outputs, 2), bias = random_numbers(outputs, 3);
                constexpr std::size_t kVectors = 19, kNext = 150;  // more than one pass takes
                const auto input = random_numbers(kVectors * kNext, 1);
                std::vector<float> together(kVectors * kNext), alone(outputs);
                kernels->dense(
                    {.outputs = outputs, .inputs = inputs, .vectors = kVectors, .next_vector = kNext},
                    input.data(), weights.data(), bias.data(), together.data());
                for (std::size_t v = 0; v < kVectors; ++v) {
                    kernels->dense({.outputs = outputs, .inputs = inputs}, input.data() + v * kNext,
                                   weights.data(), bias.data(), alone.data());
                    EXPECT_TRUE(std::equal(alone.begin(), alone.end(), together.data() + v * kNext))
                        << kernels->name << " " << outputs << "x" << inputs << ", vector " << v;
                }
            }
        }
    }
}

}  // namespace
}  // namespace cale::lite
