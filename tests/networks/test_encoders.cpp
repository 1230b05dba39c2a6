#include "cale/fields.h"
#include "networks/encoders.h"
#include "networks/ppo_network.h"
#include "networks/q_network.h"

#include <cmath>
#include <set>
#include <string>

#include <ATen/CPUGeneratorImpl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/nn/init.h>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <torch/utils.h>

namespace cale {
namespace {

at::Generator generator(std::uint64_t seed = 1) {
    return at::detail::createCPUGenerator(seed);
}

TwoBranchEncoder make(EncoderConfig config) {
    return TwoBranchEncoder(config, generator());
}

torch::Tensor frames(std::int64_t batch, std::int64_t stack = 4, std::int64_t height = 84,
                     std::int64_t width = 84) {
    return torch::randint(0, 256, {batch, stack, height, width}, generator(5), torch::kUInt8);
}

double deviation(TwoBranchEncoder& encoder, const std::string& name) {
    return encoder->named_parameters()[name].std().item<double>();
}

std::set<std::string> names(const torch::nn::Module& module) {
    std::set<std::string> all;
    for (const auto& parameter : module.named_parameters()) all.insert(parameter.key());
    return all;
}

struct Shape {
    EncoderConfig config;
    std::int64_t features, size;
};

TEST(Encoder, FeaturesAndBranchesHaveTheSizesOfTheReference) {
    const Shape shapes[] = {
        {{.encoder = EncoderKind::phi_sac}, 42 * 42 * 32, 50},
        {{.encoder = EncoderKind::phi_dqn}, 11 * 11 * 64, 512},
        {{.encoder = EncoderKind::phi_dqn, .phi_dqn = PhiDqn::row1d}, 84 * 11 * 64, 512},
        {{.encoder = EncoderKind::impala}, 11 * 11 * 32, 512},
        {{.encoder = EncoderKind::compact}, 1568, 50},
        {{.encoder = EncoderKind::data_efficient}, 576, 50},
        {{.encoder = EncoderKind::phi_dqn_2013}, 9 * 9 * 32, 50},
        {{.encoder = EncoderKind::mlp}, 256, 50},
        {{.encoder = EncoderKind::flat}, 4 * 84 * 84, 4 * 84 * 84},
        {{.encoder = EncoderKind::phi_sac, .observation = {2, 12, 9}}, 6 * 5 * 32, 50},
        {{.encoder = EncoderKind::impala, .observation = {1, 12, 9}}, 2 * 2 * 32, 512},
    };
    for (const auto& [config, features, size] : shapes) {
        auto encoder = make(config);
        const auto x =
            encoder->trunk(frames(2, config.observation[0], config.observation[1], config.observation[2]));
        EXPECT_EQ(x.sizes(), (std::vector<std::int64_t>{2, features}));
        EXPECT_EQ(encoder->critic_branch(x).sizes(), (std::vector<std::int64_t>{2, size}));
        EXPECT_EQ(encoder->actor_branch(x).sizes(), (std::vector<std::int64_t>{2, size}));
        EXPECT_EQ(encoder->size(), size);
    }
}

TEST(Encoder, TheActorsBranchIsNormalisedWhereItIsNarrowOrWhereItIsAskedFor) {
    for (const auto kind : {EncoderKind::phi_sac, EncoderKind::mlp, EncoderKind::compact,
                            EncoderKind::data_efficient, EncoderKind::phi_dqn_2013})
        EXPECT_TRUE(names(*make({.encoder = kind})).contains("actor_ln.weight"));
    EXPECT_FALSE(names(*make({.encoder = EncoderKind::phi_dqn})).contains("actor_ln.weight"));
    EXPECT_TRUE(
        names(*make({.encoder = EncoderKind::phi_dqn, .layer_norm = true})).contains("actor_ln.weight"));
    EXPECT_TRUE(names(*make({.encoder = EncoderKind::phi_dqn})).contains("critic_ln.weight"));
}

TEST(Encoder, StartsWithTheStatisticsOfTheReference) {
    auto phi_sac = make({.encoder = EncoderKind::phi_sac});
    EXPECT_NEAR(deviation(phi_sac, "conv1.weight"), 0.1666, 0.0005);
    for (const auto* conv : {"conv2.weight", "conv3.weight", "conv4.weight"})
        EXPECT_NEAR(deviation(phi_sac, conv), 0.0589, 0.0005);
    EXPECT_NEAR(deviation(phi_sac, "critic_fc.weight"), 0.00421, 0.00002);
    EXPECT_NEAR(deviation(phi_sac, "actor_fc.weight"), 0.00421, 0.00002);

    auto phi_dqn = make({.encoder = EncoderKind::phi_dqn});
    const auto glorot = [](double fans) { return std::sqrt(2 / fans); };
    EXPECT_NEAR(deviation(phi_dqn, "conv1.weight"), glorot((4 + 32) * 64), 0.0006);
    EXPECT_NEAR(deviation(phi_dqn, "critic_fc.weight"), glorot(7744 + 512), 0.0001);
    for (const auto& parameter : phi_dqn->named_parameters()) {
        if (!parameter.key().ends_with("bias")) continue;
        EXPECT_EQ(parameter.value().abs().max().item<double>(), 0) << parameter.key();
    }
    EXPECT_TRUE(phi_dqn->named_parameters()["critic_ln.weight"].eq(1).all().item<bool>());
}

TEST(Encoder, LayersOfOneNetworkStartDifferently) {
    auto encoder = make({.encoder = EncoderKind::phi_sac});
    const auto parameters = encoder->named_parameters();
    EXPECT_FALSE(torch::equal(parameters["conv2.weight"], parameters["conv3.weight"]));
    EXPECT_FALSE(torch::equal(parameters["critic_fc.weight"], parameters["actor_fc.weight"]));
}

// A trunk whose kernels pass their centre pixel of channel 0 on shows the pixel's scale.
TEST(Encoder, PixelsAreDividedBy255) {
    const torch::NoGradGuard no_grad;
    auto encoder = make({.encoder = EncoderKind::phi_sac});
    for (auto& parameter : encoder->named_parameters()) {
        if (!parameter.key().starts_with("conv") || !parameter.key().ends_with("weight")) continue;
        auto weight = parameter.value();
        weight.zero_();
        weight[0][0][1][1] = 1;
    }
    const auto x = encoder->trunk(torch::full({1, 4, 84, 84}, 51, torch::kUInt8));
    EXPECT_FLOAT_EQ(x.max().item<float>(), 0.2f);
}

TEST(Encoder, FeaturesAreFlattenedChannelFirst) {
    const torch::NoGradGuard no_grad;
    auto encoder = make({.encoder = EncoderKind::phi_dqn});
    for (auto& parameter : encoder->named_parameters()) parameter.value().zero_();
    encoder->named_parameters()["conv3.bias"][1] = 1;
    const auto x = encoder->trunk(frames(1))[0];
    EXPECT_EQ(x.sum().item<float>(), 121);
    EXPECT_EQ(x.slice(0, 121, 242).sum().item<float>(), 121);
}

TEST(Encoder, RowsOfRow1dDoNotMix) {
    const torch::NoGradGuard no_grad;
    auto encoder = make({.encoder = EncoderKind::phi_dqn, .phi_dqn = PhiDqn::row1d});
    const auto before = frames(1);
    auto after = before.clone();
    after.select(2, 40).zero_();
    const auto difference =
        (encoder->trunk(before) - encoder->trunk(after)).abs().reshape({64, 84, 11}).amax({0, 2});
    for (std::int64_t row = 0; row < 84; ++row)
        EXPECT_EQ(difference[row].item<float>() > 0, row == 40) << row;
}

TEST(Encoder, TheActorsBranchDoesNotTrainTheTrunk) {
    for (const auto kind :
         {EncoderKind::phi_sac, EncoderKind::phi_dqn, EncoderKind::impala, EncoderKind::mlp}) {
        auto encoder = make({.encoder = kind, .observation = {4, 12, 12}});
        const auto x = encoder->trunk(frames(2, 4, 12, 12));
        encoder->actor_branch(x).sum().backward();
        for (const auto& parameter : encoder->named_parameters()) {
            EXPECT_EQ(parameter.value().grad().defined(), parameter.key().starts_with("actor_"))
                << parameter.key();
        }
        encoder->critic_branch(x).square().sum().backward();
        for (const auto& parameter : encoder->named_parameters()) {
            EXPECT_TRUE(parameter.value().grad().defined()) << parameter.key();
        }
    }
}

TEST(Encoder, LayerNormHasTheReferencesEpsilon) {
    const torch::NoGradGuard no_grad;
    auto encoder = make({.encoder = EncoderKind::phi_sac, .observation = {4, 12, 12}});
    encoder->to(torch::kFloat64);
    auto x = torch::zeros({1, 6 * 6 * 32}, torch::kFloat64);
    auto weight = encoder->named_parameters()["critic_fc.weight"];
    weight.zero_();
    weight[0][0] = 1;
    x[0][0] = 0.01;  // one unit of 50 is 0.01: the variance is 1.96e-6, close to epsilon
    const double mean = 0.01 / 50, variance = 0.01 * 0.01 / 50 - mean * mean;
    EXPECT_NEAR(encoder->critic_branch(x)[0][0].item<double>(),
                std::tanh((0.01 - mean) / std::sqrt(variance + 1e-6)), 1e-9);
}

TEST(Encoder, RefusesOtherShapesAndTypesNamingBoth) {
    auto encoder = make({.encoder = EncoderKind::phi_sac});
    const auto message = [&](const torch::Tensor& observation) -> std::string {
        try {
            encoder->trunk(observation);
        } catch (const std::invalid_argument& error) {
            return error.what();
        }
        return "accepted";
    };
    EXPECT_THAT(message(frames(1, 3)),
                testing::AllOf(testing::HasSubstr("[B, 4, 84, 84]"), testing::HasSubstr("[1, 3, 84, 84]")));
    EXPECT_THAT(message(torch::rand({1, 4, 84, 84})), testing::HasSubstr("float"));
    EXPECT_THROW(make({.observation = {0, 84, 84}}), std::invalid_argument);
}

TEST(Encoder, MlpReadsBytesAsWellAsFrames) {
    auto of_bytes = make({.encoder = EncoderKind::mlp, .observation = {4, 128}});
    const auto bytes = torch::randint(0, 256, {3, 4, 128}, generator(5), torch::kUInt8);
    const auto x = of_bytes->trunk(bytes);
    EXPECT_EQ(x.sizes(), (std::vector<std::int64_t>{3, 256}));
    EXPECT_EQ(of_bytes->actor_branch(x).sizes(), (std::vector<std::int64_t>{3, 50}));
    EXPECT_EQ(of_bytes->named_parameters()["fc1.weight"].sizes(), (std::vector<std::int64_t>{256, 512}));
    // The same numbers as one image, whose rows are the bytes: flattened in the same order.
    auto of_frames = make({.encoder = EncoderKind::mlp, .observation = {4, 8, 16}});
    EXPECT_TRUE(torch::equal(of_frames->trunk(bytes.view({3, 4, 8, 16})), x));
    const torch::NoGradGuard no_grad;
    for (auto& parameter : of_bytes->named_parameters()) parameter.value().fill_(1.0 / 256);
    // Bytes are divided by 255: 512 ones, each by 1 / 256, and a bias.
    const auto ones = of_bytes->trunk(torch::full({1, 4, 128}, 255, torch::kUInt8));
    EXPECT_FLOAT_EQ(ones[0][0].item<float>(), 2 + 1.0f / 256 + 1.0f / 256);
}

TEST(Encoder, ConvolutionsOfBytesAreRefusedWithTheWayOut) {
    for (const auto kind : {EncoderKind::phi_sac, EncoderKind::phi_dqn, EncoderKind::impala}) {
        try {
            make({.encoder = kind, .observation = {4, 128}});
            ADD_FAILURE() << "accepted";
        } catch (const std::invalid_argument& error) {
            EXPECT_EQ(error.what(), "agent.encoder " + std::string(name_of(kind)) +
                                        " convolves frames, and an observation is [4, 128] bytes: set "
                                        "agent.encoder to mlp or flat, or env.obs to pixels");
        }
    }
}

TEST(Encoder, DoublePrecisionAgreesWithSingle) {
    const torch::NoGradGuard no_grad;
    for (const auto kind :
         {EncoderKind::phi_sac, EncoderKind::phi_dqn, EncoderKind::impala, EncoderKind::mlp}) {
        auto encoder = make({.encoder = kind, .observation = {4, 20, 20}});
        const auto x = frames(2, 4, 20, 20);
        const auto single = encoder->critic_branch(encoder->trunk(x));
        encoder->to(torch::kFloat64);
        EXPECT_TRUE(torch::allclose(encoder->critic_branch(encoder->trunk(x)).to(torch::kFloat32), single,
                                    1e-3, 1e-4));
    }
}

TEST(Encoder, UnpaddedItHasTheShapesOfMnihEtAl) {
    // 84 -> 20 -> 9 -> 7
    const auto features = [](EncoderKind kind, std::int64_t side) {
        const EncoderConfig config{
            .encoder = kind, .observation = {4, side, side}, .padding = Padding::valid};
        return TrunkEncoder(config, generator())->size();
    };
    EXPECT_EQ(features(EncoderKind::phi_dqn, 84), 7 * 7 * 64);
    EXPECT_EQ(features(EncoderKind::phi_dqn, 36), 1 * 1 * 64);
    EXPECT_EQ(features(EncoderKind::phi_sac, 84), 35 * 35 * 32);
}

TEST(TrunkEncoder, IsATrunkAndNothingElse) {
    const torch::NoGradGuard no_grad;
    const EncoderConfig config{.encoder = EncoderKind::phi_dqn, .observation = {4, 20, 20}};
    TrunkEncoder alone(config, generator());
    auto branched = make(config);
    EXPECT_EQ(names(*alone), (std::set<std::string>{"conv1.weight", "conv1.bias", "conv2.weight",
                                                    "conv2.bias", "conv3.weight", "conv3.bias"}));
    const auto x = frames(2, 4, 20, 20);
    EXPECT_EQ(alone(x).sizes(), (std::vector<std::int64_t>{2, alone->size()}));
    EXPECT_TRUE(torch::equal(alone(x), branched->trunk(x)));
}

TEST(SharedEncoder, IsATrunkAndADenseLayerThatAreTrainedTogether) {
    SharedEncoder encoder(EncoderConfig{.encoder = EncoderKind::phi_dqn, .padding = Padding::valid}, 512,
                          orthogonal(), generator());
    EXPECT_EQ(encoder->named_parameters()["fc.weight"].sizes(), (std::vector<std::int64_t>{512, 3136}));
    const auto z = encoder(frames(2));
    EXPECT_EQ(z.sizes(), (std::vector<std::int64_t>{2, 512}));
    EXPECT_EQ(z.min().item<float>(), 0);  // rectified
    EXPECT_GT(z.max().item<float>(), 0);
    z.sum().backward();
    for (const auto& parameter : encoder->named_parameters())
        EXPECT_GT(parameter.value().grad().abs().max().item<float>(), 0) << parameter.key();
}

TEST(SharedEncoder, AnInitialiserOfTheCallersServesItsConvolutionsToo) {
    const auto twos = [](torch::Tensor& weight, const at::Generator&) {
        torch::nn::init::constant_(weight, 2);
    };
    SharedEncoder encoder(
        EncoderConfig{.encoder = EncoderKind::phi_dqn, .padding = Padding::valid, .initialise = twos}, 16,
        orthogonal(), generator());
    for (const auto* name : {"conv1.weight", "conv2.weight", "conv3.weight"})
        EXPECT_TRUE((encoder->named_parameters()[name] == 2).all().item<bool>()) << name;
    EXPECT_FALSE((encoder->named_parameters()["fc.weight"] == 2).any().item<bool>());
}

TEST(Encoder, AllButPhiSacStartGlorot) {
    for (const auto kind : {EncoderKind::impala, EncoderKind::mlp, EncoderKind::compact,
                            EncoderKind::data_efficient, EncoderKind::phi_dqn_2013}) {
        auto encoder = make({.encoder = kind});
        for (const auto& parameter : encoder->named_parameters()) {
            const auto& weight = parameter.value();
            if (weight.dim() < 2) continue;
            const auto fans = (weight.size(0) + weight.size(1)) * weight[0][0].numel();
            EXPECT_NEAR(weight.std().item<double>() / std::sqrt(2.0 / static_cast<double>(fans)), 1, 0.1)
                << name_of(kind) << ' ' << parameter.key();
        }
    }
}

}  // namespace
}  // namespace cale
