#include "networks/adam.h"

#include <cmath>

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

namespace cale {
namespace {

void set_gradient(torch::Tensor& parameter, const torch::Tensor& gradient) {
    parameter.mutable_grad() = gradient;
}

TEST(Adam, StepsAsWrittenInThePaper) {
    const AdamConfig config{.learning_rate = 0.1, .epsilon = 0.01};
    for (const auto type : {torch::kFloat32, torch::kFloat64}) {
        auto parameter = torch::tensor({1.0, -2.0}, type).requires_grad_();
        Adam adam({parameter}, config);
        double expected[] = {1.0, -2.0}, m[] = {0, 0}, v[] = {0, 0};
        for (int step = 1; step <= 5; ++step) {
            const double gradient[] = {0.3 * step, -0.02};
            set_gradient(parameter, torch::tensor({gradient[0], gradient[1]}, type));
            adam.step();
            for (int i = 0; i < 2; ++i) {
                m[i] = 0.9 * m[i] + 0.1 * gradient[i];
                v[i] = 0.999 * v[i] + 0.001 * gradient[i] * gradient[i];
                const double m_hat = m[i] / (1 - std::pow(0.9, step)),
                             v_hat = v[i] / (1 - std::pow(0.999, step));
                expected[i] -= 0.1 * m_hat / (std::sqrt(v_hat) + 0.01);
                EXPECT_NEAR(parameter[i].item<double>(), expected[i], type == torch::kFloat64 ? 1e-12 : 1e-5);
            }
        }
    }
}

// AdamW: the decay is not part of the gradient, so the moments do not see it.
TEST(Adam, WeightDecayShrinksParametersBesideTheStep) {
    const auto start = torch::tensor({1.0, -2.0}, torch::kFloat64);
    auto plain = start.clone().requires_grad_(), decayed = start.clone().requires_grad_();
    Adam without({plain}, {.learning_rate = 0.1}),
        with({decayed}, {.learning_rate = 0.1, .weight_decay = 0.5});
    for (auto* parameter : {&plain, &decayed})
        set_gradient(*parameter, torch::tensor({0.3, -0.02}, torch::kFloat64));
    without.step();
    with.step();
    EXPECT_TRUE(torch::allclose(decayed.detach(), plain.detach() - 0.1 * 0.5 * start, 0, 1e-12));
    for (const auto& [name, moment] : without.state())
        EXPECT_TRUE(torch::equal(moment, with.state().at(name)));
}

// The fused kernel reads raw memory: a transposed gradient must not be taken as it lies there.
TEST(Adam, GradientsMayBeLaidOutInAnotherOrder) {
    auto parameter = torch::zeros({2, 3}, torch::kFloat64).requires_grad_();
    const auto gradient = torch::tensor({{1.0, -1.0, 1.0}, {-1.0, -1.0, 1.0}}, torch::kFloat64);
    set_gradient(parameter, gradient.t().contiguous().t());
    Adam adam({parameter}, {.learning_rate = 0.5, .epsilon = 1e-12});
    adam.step();
    EXPECT_TRUE(torch::allclose(parameter.detach(), -0.5 * gradient));
}

TEST(Adam, EveryParameterNeedsAGradient) {
    auto parameter = torch::zeros({2}).requires_grad_();
    Adam adam({parameter}, {});
    EXPECT_THROW(adam.step(), std::logic_error);
    set_gradient(parameter, torch::ones({2}));
    adam.zero_grad();
    EXPECT_FALSE(parameter.grad().defined());
    EXPECT_THROW(Adam({}, {}), std::invalid_argument);
}

TEST(Adam, AStoredStateContinuesTheSameWay) {
    auto first = torch::zeros({3}).requires_grad_(), second = torch::zeros({3}).requires_grad_();
    Adam original({first}, {.learning_rate = 0.1}), restored({second}, {.learning_rate = 0.1});
    const auto gradient = torch::tensor({1.0f, -0.5f, 0.001f});
    set_gradient(first, gradient);
    original.step();
    {
        const torch::NoGradGuard no_grad;
        second.copy_(first);
        const auto from = original.state();
        for (auto& [name, tensor] : restored.state()) tensor.copy_(from.at(name));
    }
    set_gradient(first, -gradient);
    set_gradient(second, -gradient);
    original.step();
    restored.step();
    EXPECT_TRUE(torch::equal(first.detach(), second.detach()));
}

TEST(Adam, DelayedParametersStepAsIfAlone) {
    const auto zeros = [] { return torch::zeros({2}).requires_grad_(); };
    auto every = zeros(), every_expected = zeros(), second = zeros(), second_expected = zeros();
    Adam adam({every, second}, {.learning_rate = 0.1}), of_every({every_expected}, {.learning_rate = 0.1}),
        of_second({second_expected}, {.learning_rate = 0.1});
    EXPECT_FALSE(adam.state().contains("delayed_steps"));
    adam.delay({second});
    for (int step = 1; step <= 6; ++step) {
        const auto gradient = torch::tensor({0.3f * static_cast<float>(step), -0.02f});
        adam.zero_grad();
        set_gradient(every, gradient);
        set_gradient(every_expected, gradient);
        of_every.step();
        const bool with_delayed = step % 2 == 0;
        if (with_delayed) {
            set_gradient(second, gradient);
            set_gradient(second_expected, gradient);
            of_second.step();
        }
        adam.step(with_delayed);
        EXPECT_TRUE(torch::equal(every.detach(), every_expected.detach())) << step;
        EXPECT_TRUE(torch::equal(second.detach(), second_expected.detach())) << step;
    }
    EXPECT_EQ(adam.state().at("steps").item<float>(), 6);
    EXPECT_EQ(adam.state().at("delayed_steps").item<float>(), 3);
    EXPECT_THROW(adam.delay({every}), std::logic_error);
}

TEST(Targets, SoftUpdateMovesByTau) {
    const std::vector<torch::Tensor> target{torch::zeros({2}), torch::full({1}, 10.0f)};
    const std::vector<torch::Tensor> online{torch::ones({2}), torch::full({1}, 20.0f)};
    soft_update(target, online, 0.1);
    EXPECT_TRUE(torch::allclose(target[0], torch::full({2}, 0.1f)));
    EXPECT_TRUE(torch::allclose(target[1], torch::full({1}, 11.0f)));
    EXPECT_TRUE(torch::equal(online[0], torch::ones({2})));
    hard_update(target, online);
    EXPECT_TRUE(torch::equal(target[1], online[1]));
    EXPECT_THROW(soft_update(target, {online[0]}, 0.1), std::invalid_argument);
}

/// Two parameters whose gradients have a norm of 3 together.
std::vector<torch::Tensor> parameters_with_gradients() {
    std::vector<torch::Tensor> parameters{torch::zeros({2}).requires_grad_(),
                                          torch::zeros({1}).requires_grad_()};
    set_gradient(parameters[0], torch::tensor({2.0f, -2.0f}));
    set_gradient(parameters[1], torch::tensor({1.0f}));
    return parameters;
}

TEST(ClipGradientNorm, ScalesAllGradientsDownToTheLargestNorm) {
    const auto parameters = parameters_with_gradients();
    EXPECT_FLOAT_EQ(clip_gradient_norm(parameters, 1.5).item<float>(), 3);
    EXPECT_TRUE(torch::allclose(parameters[0].grad(), torch::tensor({1.0f, -1.0f})));
    EXPECT_TRUE(torch::allclose(parameters[1].grad(), torch::tensor({0.5f})));
}

TEST(ClipGradientNorm, OfMillionsOfGradientsIsExact) {
    // The dense layer of phi_dqn: summed in float32 the norm is too small by a thousandth.
    std::vector<torch::Tensor> parameters{torch::zeros({512, 7744}).requires_grad_()};
    const auto gradient =
        torch::randn({512, 7744}, at::make_generator<at::CPUGeneratorImpl>(1), torch::kFloat32).div_(100);
    set_gradient(parameters[0], gradient);
    const double norm = gradient.to(torch::kFloat64).square().sum().sqrt().item<double>();
    EXPECT_NEAR(clip_gradient_norm(parameters, 1).item<double>() / norm, 1, 1e-9);
    EXPECT_NEAR(parameters[0].grad().to(torch::kFloat64).square().sum().sqrt().item<double>(), 1, 1e-6);
}

TEST(GradientNorm, IsThatOfAllGradientsTogether) {
    auto parameters = parameters_with_gradients();
    EXPECT_FLOAT_EQ(static_cast<float>(gradient_norm(parameters).value()), 3);
    parameters.push_back(torch::zeros({1}).requires_grad_());
    EXPECT_FALSE(gradient_norm(parameters).has_value());
}

TEST(ClipGradientNorm, LeavesShorterGradientsAlone) {
    const auto parameters = parameters_with_gradients();
    EXPECT_FLOAT_EQ(clip_gradient_norm(parameters, 3.5).item<float>(), 3);
    EXPECT_TRUE(torch::equal(parameters[0].grad(), torch::tensor({2.0f, -2.0f})));
    EXPECT_TRUE(torch::equal(parameters[1].grad(), torch::tensor({1.0f})));
}

TEST(ClipGradientNorm, LeavesZerosZero) {
    auto parameter = torch::zeros({2}).requires_grad_();
    set_gradient(parameter, torch::zeros({2}));
    EXPECT_EQ(clip_gradient_norm({parameter}, 0.5).item<float>(), 0);
    EXPECT_TRUE(torch::equal(parameter.grad(), torch::zeros({2})));
}

TEST(Adam, TheLearningRateMayChangeUnderWay) {
    auto parameter = torch::zeros({1}, torch::kFloat64).requires_grad_();
    Adam adam({parameter}, {.learning_rate = 0.5, .epsilon = 1e-12});
    set_gradient(parameter, torch::ones({1}, torch::kFloat64));
    adam.step();  // along a constant gradient each step is one learning rate long
    EXPECT_NEAR(parameter.item<double>(), -0.5, 1e-9);
    adam.set_learning_rate(0.25);
    EXPECT_EQ(adam.learning_rate(), 0.25);
    adam.step();
    EXPECT_NEAR(parameter.item<double>(), -0.75, 1e-9);
}

}  // namespace
}  // namespace cale
