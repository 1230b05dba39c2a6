#include "networks/q_network.h"

#include <set>
#include <string>

#include <ATen/CPUGeneratorImpl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "networks/policy_weights.h"

namespace cale {
namespace {

at::Generator generator(std::uint64_t seed = 1) {
    return at::detail::createCPUGenerator(seed);
}

torch::Tensor features(std::int64_t batch = 7) {
    return torch::randn({batch, 5}, generator(9));
}

std::set<std::string> layers(const torch::nn::Module& module) {
    std::set<std::string> all;
    for (const auto& child : module.named_children()) all.insert(child.key());
    return all;
}

TEST(QHead, ShapesOfEveryKind) {
    for (const bool dueling : {false, true}) {
        for (const bool noisy : {false, true}) {
            for (const std::int64_t atoms : {1, 3}) {
                QHead head(5,
                           QHeadConfig{.num_actions = 4,
                                       .hidden_units = 6,
                                       .num_atoms = atoms,
                                       .dueling = dueling,
                                       .noisy = noisy},
                           generator());
                const auto noise = head->draw_noise(generator(2));
                EXPECT_EQ(head(features(), &noise).sizes(), (std::vector<std::int64_t>{7, 4, atoms}));
                EXPECT_EQ(head(features()).sizes(), (std::vector<std::int64_t>{7, 4, atoms}));
                EXPECT_EQ(layers(*head), dueling ? (std::set<std::string>{"fc1", "adv", "value"})
                                                 : (std::set<std::string>{"fc1", "out"}));
                EXPECT_EQ(head->named_parameters().contains("fc1.weight_sigma"), noisy);
            }
        }
    }
}

TEST(QHead, IsTwoLayersWithARectifierBetween) {
    const torch::NoGradGuard no_grad;
    QHead head(5, QHeadConfig{.num_actions = 2, .hidden_units = 6, .num_atoms = 3}, generator());
    auto parameters = head->named_parameters();
    parameters["fc1.bias"].uniform_(-1, 1, generator(2));
    parameters["out.bias"].uniform_(-1, 1, generator(3));
    const auto x = features();
    const auto hidden = (x.mm(parameters["fc1.weight"].t()) + parameters["fc1.bias"]).clamp_min(0);
    const auto out = hidden.mm(parameters["out.weight"].t()) + parameters["out.bias"];
    // Action-major: the atoms of an action lie together.
    for (std::int64_t action = 0; action < 2; ++action)
        EXPECT_TRUE(
            torch::allclose(head(x).select(1, action), out.slice(1, 3 * action, 3 * action + 3), 1e-5, 1e-6));
}

TEST(QHead, DuelingAddsAdvantagesWithoutTheirMean) {
    const torch::NoGradGuard no_grad;
    QHead head(5, QHeadConfig{.num_actions = 3, .hidden_units = 6, .num_atoms = 2, .dueling = true},
               generator());
    auto parameters = head->named_parameters();
    for (auto& parameter : parameters) parameter.value().zero_();
    parameters["adv.bias"].copy_(torch::tensor({1.0f, 10.0f, 2.0f, 20.0f, 6.0f, 60.0f}));
    parameters["value.bias"].copy_(torch::tensor({100.0f, 1000.0f}));
    // Means over the actions: 3 and 30.
    const auto expected = torch::tensor({{98.0f, 980.0f}, {99.0f, 990.0f}, {103.0f, 1030.0f}});
    EXPECT_TRUE(torch::allclose(head(features(1))[0], expected));
    // What all advantages have in common cannot be told from the value: it does not count.
    parameters["adv.bias"].add_(7);
    EXPECT_TRUE(torch::allclose(head(features(1))[0], expected));
}

TEST(QHead, NoiseChangesNoisyLayersOnly) {
    for (const bool noisy : {false, true}) {
        const torch::NoGradGuard no_grad;
        QHead head(
            5,
            QHeadConfig{
                .num_actions = 4, .hidden_units = 6, .dueling = true, .noisy = noisy, .initial_sigma = 1},
            generator());
        const auto first = head->draw_noise(generator(2)), second = head->draw_noise(generator(3));
        EXPECT_EQ(first.hidden.input.defined(), noisy);
        EXPECT_TRUE(torch::equal(head(features(), &first), head(features(), &first)));
        EXPECT_EQ(torch::allclose(head(features(), &first), head(features(), &second)), !noisy);
        EXPECT_EQ(torch::allclose(head(features(), &first), head(features())), !noisy);
    }
}

TEST(QHead, EveryLayerHasItsOwnNoiseButForTheInputBehindTheHiddenOne) {
    QHead head(
        5, QHeadConfig{.num_actions = 4, .hidden_units = 6, .num_atoms = 3, .dueling = true, .noisy = true},
        generator());
    const auto noise = head->draw_noise(generator(2));
    EXPECT_EQ(noise.hidden.input.sizes(), (std::vector<std::int64_t>{5}));
    EXPECT_EQ(noise.hidden.output.sizes(), (std::vector<std::int64_t>{6}));
    EXPECT_EQ(noise.out.output.sizes(), (std::vector<std::int64_t>{12}));
    EXPECT_EQ(noise.value.output.sizes(), (std::vector<std::int64_t>{3}));
    EXPECT_TRUE(torch::equal(noise.out.input, noise.value.input));
    EXPECT_EQ(noise.out.input.sizes(), (std::vector<std::int64_t>{6}));
    EXPECT_FALSE(torch::equal(noise.out.input, noise.hidden.output));
    // Each of them counts.
    const torch::NoGradGuard no_grad;
    const auto output = head(features(), &noise);
    for (const auto part : {&QNoise::hidden, &QNoise::out, &QNoise::value}) {
        for (const auto side : {&FactorisedNoise::input, &FactorisedNoise::output}) {
            auto other = noise;
            other.*part.*side = -(noise.*part.*side);
            EXPECT_FALSE(torch::allclose(head(features(), &other), output));
        }
    }
}

TEST(QHead, NoisePerRowIsADrawForEachRow) {
    QHead head(5,
               QHeadConfig{.num_actions = 4,
                           .hidden_units = 6,
                           .num_atoms = 3,
                           .dueling = true,
                           .noisy = true,
                           .initial_sigma = 1},
               generator());
    const torch::NoGradGuard no_grad;
    const auto noise = head->draw_noise(generator(2), 7);
    const auto output = head(features(7), &noise);
    for (std::int64_t row = 0; row < 7; ++row) {
        const auto own = [row](const FactorisedNoise& layer) -> FactorisedNoise {
            return {layer.input[row], layer.output[row]};
        };
        const QNoise of_row{own(noise.hidden), own(noise.out), own(noise.value)};
        EXPECT_TRUE(
            torch::allclose(output[row], head(features(7).slice(0, row, row + 1), &of_row)[0], 1e-5, 1e-6));
        if (row > 0) {
            EXPECT_FALSE(torch::equal(noise.hidden.input[row], noise.hidden.input[0]));
        }
    }
}

TEST(QHead, NoiseMovesToAnotherTypeAsAWhole) {
    QHead head(5, QHeadConfig{.num_actions = 4, .hidden_units = 6, .dueling = true, .noisy = true},
               generator());
    const auto noise = head->draw_noise(generator(2)), moved = to(noise, torch::kFloat64);
    for (const auto part : {&QNoise::hidden, &QNoise::out, &QNoise::value}) {
        for (const auto side : {&FactorisedNoise::input, &FactorisedNoise::output}) {
            EXPECT_EQ((moved.*part.*side).scalar_type(), torch::kFloat64);
            EXPECT_EQ((noise.*part.*side).scalar_type(), torch::kFloat32);
            EXPECT_TRUE(torch::equal((moved.*part.*side).to(torch::kFloat32), noise.*part.*side));
        }
    }
    EXPECT_FALSE(to(QNoise{}, torch::kFloat64).hidden.input.defined());
}

TEST(QHead, NeedsAnActionAUnitAndAnAtom) {
    using testing::HasSubstr;
    EXPECT_THAT([] { QHead(5, QHeadConfig{.num_actions = 0, .num_atoms = 51}, generator()); },
                testing::ThrowsMessage<std::invalid_argument>(HasSubstr("not 0, 512 and 51")));
    EXPECT_THROW(QHead(5, QHeadConfig{.num_actions = 1, .hidden_units = 0}, generator()),
                 std::invalid_argument);
    EXPECT_THROW(QHead(5, QHeadConfig{.num_actions = 1, .num_atoms = 0}, generator()), std::invalid_argument);
}

// Seyde et al. 2023, equation 2.
TEST(QHead, FactoredActionsAreMeansOfTheirChoices) {
    const torch::NoGradGuard no_grad;
    QHead head(5, QHeadConfig{.num_actions = 6, .hidden_units = 4, .num_atoms = 2, .factors = {2, 3}},
               generator());
    auto parameters = head->named_parameters();
    EXPECT_EQ(parameters["out.weight"].sizes(), (std::vector<std::int64_t>{(2 + 3) * 2, 4}));
    for (auto& parameter : parameters) parameter.value().zero_();
    // The outputs of the five choices, two atoms each.
    parameters["out.bias"].copy_(
        torch::tensor({1.0F, -1.0F, 2.0F, -2.0F, 10.0F, 0.0F, 20.0F, 0.0F, 30.0F, 0.0F}));
    // The last choice varies fastest.
    const auto expected = torch::tensor(
        {{5.5F, -0.5F}, {10.5F, -0.5F}, {15.5F, -0.5F}, {6.0F, -1.0F}, {11.0F, -1.0F}, {16.0F, -1.0F}});
    EXPECT_TRUE(torch::allclose(head(features(1))[0], expected));
}

TEST(QHead, FactoredDuelingAddsTheSetsToTheValue) {
    const torch::NoGradGuard no_grad;
    QHead head(5, QHeadConfig{.num_actions = 18, .hidden_units = 4, .dueling = true, .factors = {3, 3, 2}},
               generator());
    auto parameters = head->named_parameters();
    for (auto& parameter : parameters) parameter.value().zero_();
    parameters["value.bias"].fill_(7);
    EXPECT_TRUE(torch::allclose(head(features(1)), torch::full({1, 18, 1}, 7.0F)));
    parameters["adv.bias"].copy_(torch::tensor({3.0F, 0.0F, -3.0F, 0.0F, 0.0F, 0.0F, 6.0F, -6.0F}));
    EXPECT_NEAR(head(features(1))[0][0].item<float>(), 7 + 1 + 2, 1e-5);
    EXPECT_NEAR(head(features(1))[0][17].item<float>(), 7 - 1 - 2, 1e-5);
}

TEST(QHead, LayerNormStandsBeforeTheRectifier) {
    const torch::NoGradGuard no_grad;
    QHead head(5, QHeadConfig{.num_actions = 2, .hidden_units = 6, .layer_norm = true}, generator());
    auto parameters = head->named_parameters();
    const auto x = features();
    const auto hidden = torch::layer_norm(x.mm(parameters["fc1.weight"].t()), {6}, {}, {}, 1e-6).relu();
    EXPECT_TRUE(torch::allclose(head(x).squeeze(2), hidden.mm(parameters["out.weight"].t()), 1e-4, 1e-5));
}

TEST(QNetwork, IsAnEncoderAndAHead) {
    const torch::NoGradGuard no_grad;
    QNetwork network(EncoderConfig{.encoder = EncoderKind::phi_dqn, .observation = {2, 12, 12}},
                     QHeadConfig{.num_actions = 4, .hidden_units = 6, .num_atoms = 3, .noisy = true},
                     generator());
    const auto observation = torch::randint(0, 256, {5, 2, 12, 12}, generator(2), torch::kUInt8);
    const auto noise = network->head->draw_noise(generator(3));
    const auto output = network(observation, &noise);
    EXPECT_EQ(output.sizes(), (std::vector<std::int64_t>{5, 4, 3}));
    EXPECT_TRUE(torch::equal(output, network->head(network->encoder(observation), &noise)));
    EXPECT_FALSE(torch::allclose(output, network(observation)));
    EXPECT_EQ(layers(*network), (std::set<std::string>{"encoder", "head"}));
}

}  // namespace
}  // namespace cale
