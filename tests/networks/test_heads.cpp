#include "networks/discrete_actions.h"
#include "networks/heads.h"
#include "networks/ppo_network.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/autograd.h>
#include <torch/types.h>
#include <torch/utils.h>

namespace cale {
namespace {

at::Generator generator(std::uint64_t seed = 1) {
    return at::detail::createCPUGenerator(seed);
}

constexpr auto kDouble = torch::kFloat64;

ActionBox double_box() {
    const auto box = joystick_box();
    return {box.centre.to(kDouble), box.half_width.to(kDouble), box.log_half_widths};
}

TEST(Mlp, LayersUnitsAndInitialValues) {
    Mlp one(50, 6, HeadConfig{}, generator());
    EXPECT_EQ(one->named_parameters()["fc1.weight"].sizes(), (std::vector<std::int64_t>{512, 50}));
    EXPECT_EQ(one->named_parameters()["out.weight"].sizes(), (std::vector<std::int64_t>{6, 512}));
    const double bound = std::sqrt(6.0 / 562);
    EXPECT_NEAR(one->named_parameters()["fc1.weight"].abs().max().item<double>(), bound, 0.001);
    Mlp two(50, 1, HeadConfig{.hidden_layers = 2, .hidden_units = 256}, generator());
    EXPECT_EQ(two->named_parameters()["fc2.weight"].sizes(), (std::vector<std::int64_t>{256, 256}));
    EXPECT_EQ(two->parameters().size(), 6u);
    EXPECT_THROW(Mlp(50, 1, HeadConfig{.hidden_units = 0}, generator()), std::invalid_argument);
}

TEST(Mlp, HiddenLayersAreRectified) {
    const torch::NoGradGuard no_grad;
    Mlp mlp(1, 1, HeadConfig{.hidden_layers = 2, .hidden_units = 1}, generator());
    for (auto& parameter : mlp->named_parameters()) {
        if (parameter.key().ends_with("weight")) parameter.value().fill_(1);
    }
    EXPECT_FLOAT_EQ(mlp(torch::tensor({{3.0f}})).item<float>(), 3);
    EXPECT_FLOAT_EQ(mlp(torch::tensor({{-3.0f}})).item<float>(), 0);
    mlp->named_parameters()["out.weight"].fill_(-1);
    EXPECT_FLOAT_EQ(mlp(torch::tensor({{3.0f}})).item<float>(), -3);
}

TEST(TwinCritic, TwoIndependentValues) {
    const torch::NoGradGuard no_grad;
    TwinCritic critic(5, 3, HeadConfig{}, generator());
    const auto x = torch::rand({4, 5}, generator(2));
    const auto values = critic(x);
    EXPECT_EQ(values.q1.sizes(), (std::vector<std::int64_t>{4, 3}));
    EXPECT_FALSE(torch::allclose(values.q1, values.q2));
    EXPECT_FALSE(torch::allclose(values.q1, critic(x + 1).q1));
    EXPECT_TRUE(
        torch::equal(values.estimate(cale::TwinEstimate::minimum), torch::minimum(values.q1, values.q2)));
}

TEST(SquashedGaussian, AnchorsOfTheReference) {
    const auto box = double_box();
    const auto mean = torch::zeros({1, 3}, kDouble), log_std = torch::zeros({1, 3}, kDouble);
    const auto noise = torch::tensor({{-0.7110143, -2.0333822, 0.26954097}}, kDouble);
    const auto drawn = sample({mean, log_std}, noise, box);
    const auto expected = torch::tensor({{0.1943438, -3.0357575, 0.6315988}}, kDouble);
    EXPECT_TRUE(torch::allclose(drawn.action, expected, 1e-6, 1e-6));
    EXPECT_NEAR(drawn.log_prob.item<double>(), -1.617504, 1e-5);
    EXPECT_NEAR(box.log_half_widths, -0.241564, 1e-6);
}

TEST(SquashedGaussian, DensityAndItsGradientStayFiniteWhereTanhSaturates) {
    for (const auto type : {torch::kFloat32, torch::kFloat64}) {
        const auto box = joystick_box();
        const auto mean = torch::tensor({{12.0, -12.0, 3.0}}, type).requires_grad_();
        const auto u = torch::tensor({{11.288986, -14.033382, 3.269541}}, type);
        const auto drawn = sample({mean, torch::zeros({1, 3}, type)}, u - mean.detach(),
                                  {box.centre.to(type), box.half_width.to(type), box.log_half_widths});
        EXPECT_NEAR(drawn.log_prob.item<double>(), 48.15616, 1e-3);
        drawn.log_prob.sum().backward();
        EXPECT_TRUE(torch::allclose(mean.grad(), torch::tensor({{2.0, -2.0, 1.9942}}, type), 1e-3, 1e-3));
    }
}

// log pi(a) = log N(u) - log |da/du|, with the Jacobian from automatic differentiation.
TEST(SquashedGaussian, DensityIsThatOfTheChangedVariable) {
    const auto box = double_box();
    const auto mean = torch::randn({16, 3}, generator(1), kDouble);
    const auto log_std = 0.5 * torch::randn({16, 3}, generator(2), kDouble);
    const auto noise = torch::randn({16, 3}, generator(3), kDouble);
    const auto drawn = sample({mean, log_std}, noise, box);
    const auto u = (mean + log_std.exp() * noise).requires_grad_();
    const auto action = box.centre + box.half_width * u.tanh();
    const auto jacobian = torch::autograd::grad({action.sum()}, {u})[0];
    const auto normal = -0.5 * noise.square() - log_std - 0.5 * std::log(2 * std::numbers::pi);
    EXPECT_TRUE(torch::allclose(drawn.log_prob, (normal - jacobian.log()).sum(1), 1e-6, 1e-6));
    EXPECT_TRUE(torch::allclose(drawn.action, action.detach()));
}

TEST(SquashedGaussian, ActionsStayInTheBoxAndTheMeanActionIsItsOwn) {
    const auto box = joystick_box();
    const auto policy = squashed_gaussian(torch::tensor({{0.0f, 0.5f, -100.0f, 3.0f, 3.0f, 3.0f}}));
    EXPECT_TRUE(torch::equal(policy.log_std, torch::full({1, 3}, 3.0f)));
    const auto mean = mean_action(policy, box)[0];
    EXPECT_FLOAT_EQ(mean[0].item<float>(), 0.5f);
    EXPECT_FLOAT_EQ(mean[1].item<float>(), static_cast<float>(std::numbers::pi * std::tanh(0.5)));
    EXPECT_FLOAT_EQ(mean[2].item<float>(), 0.0f);
    const auto noise = torch::randn({5000, 3}, generator());
    const auto actions = sample(policy, noise, box).action;
    const auto low = torch::tensor({0.0f, -static_cast<float>(std::numbers::pi), 0.0f});
    const auto high = torch::tensor({1.0f, static_cast<float>(std::numbers::pi), 1.0f});
    EXPECT_TRUE((actions >= low).all().item<bool>());
    EXPECT_TRUE((actions <= high).all().item<bool>());
}

TEST(ActionBox, KnowsItsUnits) {
    const auto cartesian = action_box(Box{.low = {-1, -1, 0}, .high = {1, 1, 1}});  // (x, y, fire)
    EXPECT_TRUE(torch::equal(cartesian.centre, torch::tensor({0.0f, 0.0f, 0.5f})));
    EXPECT_TRUE(torch::equal(cartesian.half_width, torch::tensor({1.0f, 1.0f, 0.5f})));
    EXPECT_DOUBLE_EQ(cartesian.log_half_widths, std::log(0.5));
    const auto other = action_box(Box{.low = {-1, 2}, .high = {3, 2.5}});
    EXPECT_TRUE(torch::equal(other.centre, torch::tensor({1.0f, 2.25f})));
    EXPECT_TRUE(torch::equal(other.half_width, torch::tensor({2.0f, 0.25f})));
    EXPECT_DOUBLE_EQ(other.log_half_widths, std::log(2) + std::log(0.25));
}

TEST(ActionBox, NoActionLeavesLimitsWhoseMiddleIsRounded) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> number(-1, 1);
    for (int i = 0; i < 2000; ++i) {
        const float a = number(random), b = a + (i % 2 == 0 ? 1.0f : 1e-3f) * number(random);
        const Box limits{.low = {std::min(a, b)}, .high = {std::max(a, b)}};
        if (limits.low == limits.high) continue;
        const auto box = action_box(limits);
        for (const float mean : {-100.0f, 100.0f}) {
            const float action = mean_action({torch::tensor({{mean}}), {}}, box).item<float>();
            EXPECT_GE(action, limits.low[0]);
            EXPECT_LE(action, limits.high[0]);
            EXPECT_NEAR(action, mean < 0 ? limits.low[0] : limits.high[0], 1e-6);
        }
    }
    const auto widest = action_box(Box{.low = {-3e38f}, .high = {3e38f}});
    EXPECT_EQ(widest.half_width.item<float>(), 3e38f);
}

TEST(ActionBox, RefusesLimitsThatHaveNoMiddleOrNoWidth) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    for (const auto& limits :
         {Box{.low = {0}, .high = {0}}, Box{.low = {1}, .high = {-1}}, Box{.low = {0}, .high = {kInfinity}},
          Box{.low = {-kInfinity}, .high = {0}}, Box{.low = {0, 0}, .high = {1}}})
        EXPECT_THROW(action_box(limits), std::invalid_argument);
}

TEST(SquashedGaussian, GradientsReachMeanAndDeviationThroughTheSample) {
    const auto output = torch::zeros({2, 6}, torch::requires_grad());
    sample(squashed_gaussian(output), torch::ones({2, 3}), joystick_box()).action.sum().backward();
    EXPECT_TRUE((output.grad() > 0).all().item<bool>());
}

TEST(SquashedGaussian, DensityOfAGivenActionIsThatOfItsOwnSample) {
    const auto box = double_box();
    const SquashedGaussian policy{torch::randn({64, 3}, generator(1), kDouble),
                                  0.5 * torch::randn({64, 3}, generator(2), kDouble)};
    const auto drawn = sample(policy, torch::randn({64, 3}, generator(3), kDouble), box);
    EXPECT_TRUE(torch::allclose(log_prob(policy, drawn.action, box), drawn.log_prob, 1e-6, 1e-6));
}

TEST(SquashedGaussian, DensityOnTheBoxsBorderIsFinite) {
    const auto box = joystick_box();
    const auto mean = torch::zeros({2, 3}, torch::requires_grad());
    const auto corners = torch::stack({box.centre - box.half_width, box.centre + box.half_width});
    const auto density = log_prob({mean, torch::zeros({2, 3})}, corners, box);
    EXPECT_TRUE(density.isfinite().all().item<bool>());
    density.sum().backward();
    EXPECT_TRUE(mean.grad().isfinite().all().item<bool>());
}

TEST(SquashedGaussian, DensityOnTheBoxsBorderIsThatOfTheNearestFloatInside) {
    const auto box = double_box();
    const SquashedGaussian policy{torch::zeros({2, 3}, kDouble), torch::zeros({2, 3}, kDouble)};
    const auto corners = torch::stack({box.centre - box.half_width, box.centre + box.half_width});
    const double u = std::atanh(0.99999994);  // which float32 has as the largest number below 1
    const double normal = -0.5 * u * u - 0.5 * std::log(2 * std::numbers::pi);
    const double slope = std::log(1 - std::pow(std::tanh(u), 2));
    const auto expected = torch::full({2}, 3 * (normal - slope) - box.log_half_widths, kDouble);
    EXPECT_TRUE(torch::allclose(log_prob(policy, corners, box), expected, 0, 1e-6));
}

TEST(SquashedGaussian, DensityOfAGivenActionTrainsMeanAndDeviation) {
    const auto box = double_box();
    const auto mean = torch::zeros({1, 3}, kDouble).requires_grad_();
    const auto log_std = torch::zeros({1, 3}, kDouble).requires_grad_();
    const auto u = torch::tensor({{0.5, -1.0, 2.0}}, kDouble);
    log_prob({mean, log_std}, box.centre + box.half_width * u.tanh(), box).sum().backward();
    // d/dm -(u - m)^2 / 2 and d/ds (-u^2 exp(-2 s) / 2 - s) where m = s = 0.
    EXPECT_TRUE(torch::allclose(mean.grad(), u, 1e-6));
    EXPECT_TRUE(torch::allclose(log_std.grad(), u.square() - 1, 1e-6));
}

TEST(GaussianActor, StartsWithADeviationOfOneInEveryState) {
    for (const auto kind : {LogStd::summed, LogStd::direct}) {
        GaussianActor actor(5, 3, HeadConfig{.hidden_layers = 2, .hidden_units = 64}, kind, generator());
        const auto policy = actor(torch::randn({4, 5}, generator(2)));
        EXPECT_EQ(policy.mean.sizes(), (std::vector<std::int64_t>{4, 3}));
        EXPECT_FALSE(torch::allclose(policy.mean[0], policy.mean[1]));
        EXPECT_TRUE(torch::equal(policy.log_std, torch::zeros({4, 3})));
    }
}

TEST(GaussianActor, DeviationIsOneNumberPerCoordinateOrAnAddedUpRow) {
    const torch::NoGradGuard no_grad;
    const HeadConfig head{.hidden_layers = 2, .hidden_units = 64};
    GaussianActor direct(5, 3, head, LogStd::direct, generator());
    EXPECT_EQ(direct->named_parameters()["log_std"].sizes(), (std::vector<std::int64_t>{3}));
    direct->named_parameters()["log_std"].copy_(torch::tensor({-1.0f, 0.0f, 2.0f}));
    const auto x = torch::randn({4, 5}, generator(2));
    EXPECT_TRUE(torch::equal(direct(x).log_std, torch::tensor({-1.0f, 0.0f, 2.0f}).expand({4, 3})));

    GaussianActor summed(5, 3, head, LogStd::summed, generator());
    ASSERT_EQ(summed->named_parameters()["log_std.weight"].sizes(), (std::vector<std::int64_t>{3, 64}));
    summed->named_parameters()["log_std.weight"][1].fill_(0.25);
    summed->named_parameters()["log_std.bias"].copy_(torch::tensor({1.0f, 1.0f, 0.0f}));
    EXPECT_TRUE(torch::allclose(summed(x).log_std, torch::tensor({1.0f, 17.0f, 0.0f}).expand({4, 3})));
    // The same features, or none in between, lead to the same means.
    EXPECT_TRUE(torch::equal(direct(x).mean, summed(x).mean));
    GaussianActor flat(5, 3, HeadConfig{.hidden_layers = 0}, LogStd::summed, generator());
    EXPECT_EQ(flat->named_parameters()["log_std.weight"].sizes(), (std::vector<std::int64_t>{3, 5}));
}

// What makes Adam move a summed deviation 65 times as fast: each parameter has the sum's own gradient.
TEST(GaussianActor, EveryPartOfASummedDeviationIsTrainedAlike) {
    GaussianActor actor(5, 3, HeadConfig{.hidden_layers = 1, .hidden_units = 64}, LogStd::summed,
                        generator());
    actor(torch::randn({4, 5}, generator(2))).log_std.sum().backward();
    EXPECT_TRUE(torch::equal(actor->named_parameters()["log_std.weight"].grad(), torch::full({3, 64}, 4.0f)));
    EXPECT_TRUE(torch::equal(actor->named_parameters()["log_std.bias"].grad(), torch::full({3}, 4.0f)));
}

TEST(GatherActions, TakesOneValuePerRow) {
    const auto values = torch::tensor({{1.0f, 2.0f, 3.0f}, {4.0f, 5.0f, 6.0f}});
    EXPECT_TRUE(torch::equal(gather_actions(values, torch::tensor({2, 0}, torch::kInt64)),
                             torch::tensor({3.0f, 4.0f})));
}

}  // namespace
}  // namespace cale
