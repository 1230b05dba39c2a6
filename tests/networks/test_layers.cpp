#include "networks/layers.h"

#include <cmath>

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

namespace cale {
namespace {

at::Generator generator(std::uint64_t seed = 1) {
    return at::detail::createCPUGenerator(seed);
}

double mean_square(const torch::Tensor& x) {
    return x.square().mean().item<double>();
}

TEST(Orthogonal, RowsOrColumnsAreOrthonormalTimesGain) {
    for (const auto& shape : {std::vector<std::int64_t>{20, 30}, {30, 20}, {32, 4, 3, 3}, {32, 32, 3, 3}}) {
        auto weight = torch::empty(shape);
        orthogonal(2)(weight, generator());
        const auto matrix = weight.flatten(1);
        const auto gram = matrix.size(0) <= matrix.size(1) ? matrix.mm(matrix.t()) : matrix.t().mm(matrix);
        EXPECT_TRUE(torch::allclose(gram, 4 * torch::eye(gram.size(0)), 1e-4, 1e-4));
    }
}

// Without the signs of R's diagonal the first column would be biased: always one sign.
TEST(Orthogonal, BothSignsAreAsLikely) {
    int positive = 0;
    for (std::uint64_t seed = 0; seed < 200; ++seed) {
        auto weight = torch::empty({3, 3});
        orthogonal()(weight, generator(seed));
        positive += weight[0][0].item<float>() > 0;
    }
    EXPECT_GT(positive, 60);
    EXPECT_LT(positive, 140);
}

TEST(GlorotUniform, FillsItsIntervalCountingTheReceptiveField) {
    auto weight = torch::empty({64, 32, 4, 4});
    glorot_uniform()(weight, generator());
    const double bound = std::sqrt(6.0 / ((64 + 32) * 16));
    EXPECT_LE(weight.max().item<double>(), bound);
    EXPECT_GE(weight.min().item<double>(), -bound);
    EXPECT_NEAR(mean_square(weight), bound * bound / 3, 0.02 * bound * bound);
}

TEST(Initialisers, DrawFromTheGivenGeneratorOnly) {
    torch::manual_seed(7);
    const auto before = at::detail::getDefaultCPUGenerator().get_state().clone();
    const Dense first(6, 5, glorot_uniform(), generator(3)), again(6, 5, glorot_uniform(), generator(3)),
        other(6, 5, glorot_uniform(), generator(4));
    EXPECT_TRUE(torch::equal(first->weight, again->weight));
    EXPECT_FALSE(torch::equal(first->weight, other->weight));
    EXPECT_TRUE(torch::equal(at::detail::getDefaultCPUGenerator().get_state(), before));
}

TEST(Dense, IsAffineWithABiasThatStartsAtZero) {
    Dense dense(3, 2, glorot_uniform(), generator());
    EXPECT_TRUE(torch::equal(dense->bias, torch::zeros({2})));
    const torch::NoGradGuard no_grad;
    dense->bias.copy_(torch::tensor({1.0f, -1.0f}));
    const auto x = torch::rand({4, 3}, generator());
    EXPECT_TRUE(torch::allclose(dense(x), x.mm(dense->weight.t()) + dense->bias));
}

// Noisy layers ------------------------------------------------------------------------

/// sign(x) sqrt|x|, number by number.
double squashed(const torch::Tensor& x, std::int64_t i) {
    const double number = x[i].item<double>();
    return std::copysign(std::sqrt(std::abs(number)), number);
}

TEST(NoisyDense, EqualsItsWeightsWrittenDown) {
    const torch::NoGradGuard no_grad;
    NoisyDense layer(5, 3, 0.5, generator());
    layer->to(torch::kFloat64);
    // Sigmas of their own: at first they are all alike.
    layer->weight_sigma.uniform_(-1, 1, generator(2));
    layer->bias_sigma.uniform_(-1, 1, generator(3));
    const FactorisedNoise noise{torch::randn({5}, generator(4), torch::kFloat64),
                                torch::randn({3}, generator(5), torch::kFloat64)};
    auto weight = layer->weight_mu.clone(), bias = layer->bias_mu.clone();
    for (std::int64_t out = 0; out < 3; ++out) {
        bias[out] += layer->bias_sigma[out] * squashed(noise.output, out);
        for (std::int64_t in = 0; in < 5; ++in)
            weight[out][in] +=
                layer->weight_sigma[out][in] * squashed(noise.output, out) * squashed(noise.input, in);
    }
    const auto x = torch::randn({7, 5}, generator(6), torch::kFloat64);
    EXPECT_TRUE(torch::allclose(layer(x, &noise), x.mm(weight.t()) + bias, 1e-12, 1e-12));
}

TEST(NoisyDense, IsItsMeanWithoutNoise) {
    const torch::NoGradGuard no_grad;
    NoisyDense layer(5, 3, 0.5, generator());
    const auto x = torch::randn({7, 5}, generator(2));
    const auto mean = x.mm(layer->weight_mu.t()) + layer->bias_mu;
    EXPECT_TRUE(torch::allclose(layer(x), mean, 1e-5, 1e-6));
    const FactorisedNoise none{torch::zeros({5}), torch::zeros({3})};
    EXPECT_TRUE(torch::allclose(layer(x, &none), mean, 1e-5, 1e-6));
}

TEST(NoisyDense, StartsWithTheValuesOfTheReference) {
    const NoisyDense layer(400, 100, 0.1, generator());
    const double bound = 1 / std::sqrt(400.0);
    for (const auto& mu : {layer->weight_mu, layer->bias_mu}) {
        EXPECT_LE(mu.abs().max().item<double>(), bound);
        EXPECT_GT(mu.abs().max().item<double>(), 0.9 * bound);
        EXPECT_NEAR(mu.mean().item<double>(), 0, 0.2 * bound);
    }
    EXPECT_NEAR(mean_square(layer->weight_mu), bound * bound / 3, 0.02 * bound * bound);
    EXPECT_TRUE(torch::equal(layer->weight_sigma, torch::full({100, 400}, 0.1 * bound)));
    EXPECT_TRUE(torch::equal(layer->bias_sigma, torch::full({100}, 0.1 * bound)));
}

TEST(NoisyDense, TrainsBothItsMeansAndItsNoise) {
    NoisyDense layer(5, 3, 0.5, generator());
    const FactorisedNoise noise{torch::ones({5}), torch::ones({3})};
    layer(torch::ones({2, 5}), &noise).sum().backward();
    for (const auto& parameter : layer->named_parameters())
        EXPECT_GT(parameter.value().grad().abs().min().item<float>(), 0) << parameter.key();
}

// Convolutions ------------------------------------------------------------------------

TEST(SamePadding, MatchesTheReference) {
    using Zeros = std::pair<std::int64_t, std::int64_t>;
    EXPECT_EQ(same_padding(84, 3, 2), Zeros(0, 1));
    EXPECT_EQ(same_padding(42, 3, 1), Zeros(1, 1));
    EXPECT_EQ(same_padding(84, 8, 4), Zeros(2, 2));
    EXPECT_EQ(same_padding(21, 4, 2), Zeros(1, 2));
    EXPECT_EQ(same_padding(11, 3, 1), Zeros(1, 1));
    EXPECT_EQ(same_padding(1, 8, 4), Zeros(3, 4));
    EXPECT_EQ(same_padding(9, 1, 2), Zeros(0, 0));
}

/// One output of a "SAME" convolution, written as the sum it is.
double by_hand(const torch::Tensor& x, const torch::Tensor& weight, std::int64_t stride, std::int64_t out,
               std::int64_t row, std::int64_t column) {
    const auto kernel = weight.size(2);
    const auto top = same_padding(x.size(2), kernel, stride).first;
    const auto left = same_padding(x.size(3), kernel, stride).first;
    double sum = 0;
    for (std::int64_t in = 0; in < x.size(1); ++in) {
        for (std::int64_t i = 0; i < kernel; ++i) {
            for (std::int64_t j = 0; j < kernel; ++j) {
                const auto y = row * stride + i - top, z = column * stride + j - left;
                if (y < 0 || z < 0 || y >= x.size(2) || z >= x.size(3)) continue;
                sum += x[0][in][y][z].item<double>() * weight[out][in][i][j].item<double>();
            }
        }
    }
    return sum;
}

TEST(Conv, IsTheSumItShouldBeAtEveryEdge) {
    const torch::NoGradGuard no_grad;
    for (const auto& [kernel, stride] : {std::pair{3, 1}, {3, 2}, {4, 2}, {8, 4}}) {
        Conv conv(2, 3, kernel, stride, glorot_uniform(), generator());
        const auto x = torch::rand({1, 2, 10, 13}, generator(2));
        const auto y = conv(x);
        const auto rows = (10 + stride - 1) / stride, columns = (13 + stride - 1) / stride;
        ASSERT_EQ(y.sizes(), (std::vector<std::int64_t>{1, 3, rows, columns}));
        for (const auto& [row, column] :
             {std::pair{0, 0}, {rows - 1, columns - 1}, {1, 1}, {0, columns - 1}}) {
            EXPECT_NEAR(y[0][2][row][column].item<double>(), by_hand(x, conv->weight, stride, 2, row, column),
                        1e-5)
                << kernel << "/" << stride << " at " << row << ", " << column;
        }
    }
}

// What the reference does: the rows of the image are the batch, its columns x 1 the image.
TEST(Conv, ByRowsEqualsATwoDimensionalConvolutionOverOneRowAtATime) {
    const torch::NoGradGuard no_grad;
    for (const auto& [kernel, stride] : {std::pair{8, 4}, {4, 2}, {3, 1}}) {
        Conv conv(3, 5, kernel, stride, glorot_uniform(), generator());
        const auto x = torch::rand({2, 3, 6, 21}, generator(2));
        const auto rows_as_batch = x.permute({0, 2, 1, 3}).reshape({12, 3, 21, 1});
        const auto expected = conv(rows_as_batch).reshape({2, 6, 5, -1}).permute({0, 2, 1, 3});
        EXPECT_TRUE(torch::allclose(conv->forward_rows(x), expected, 1e-5, 1e-6));
    }
}

TEST(Conv, WithoutPaddingItStaysWithinTheImage) {
    const torch::NoGradGuard no_grad;
    Conv conv(2, 3, 4, 2, glorot_uniform(), generator(), Padding::valid);
    const auto x = torch::rand({1, 2, 10, 13}, generator(2));
    const auto y = conv(x);
    ASSERT_EQ(y.sizes(), (std::vector<std::int64_t>{1, 3, 4, 5}));
    for (const auto& [row, column] : {std::pair{0, 0}, {3, 4}, {2, 1}}) {
        const auto seen = x[0].slice(1, 2 * row, 2 * row + 4).slice(2, 2 * column, 2 * column + 4);
        EXPECT_NEAR(y[0][1][row][column].item<double>(), (seen * conv->weight[1]).sum().item<double>(), 1e-5);
    }
}

}  // namespace
}  // namespace cale
