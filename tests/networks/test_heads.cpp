#include "networks/heads.h"

#include <cmath>
#include <numbers>

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

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
    EXPECT_TRUE(torch::equal(values.minimum(), torch::minimum(values.q1, values.q2)));
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

TEST(SquashedGaussian, GradientsReachMeanAndDeviationThroughTheSample) {
    const auto output = torch::zeros({2, 6}, torch::requires_grad());
    sample(squashed_gaussian(output), torch::ones({2, 3}), joystick_box()).action.sum().backward();
    EXPECT_TRUE((output.grad() > 0).all().item<bool>());
}

}  // namespace
}  // namespace cale
