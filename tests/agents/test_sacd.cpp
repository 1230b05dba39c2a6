#include "agents/sacd.h"

#include <array>
#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/autograd.h>
#include <torch/types.h>

#include "agent_worlds.h"
#include "agents/random.h"
#include "expect_refused.h"

namespace cale {
namespace {

constexpr auto kDouble = torch::kFloat64;

// Networks ----------------------------------------------------------------------------

SacdNetwork make_network(std::uint64_t seed) {
    SacdNetwork made(small_encoder(), HeadConfig{1, 16}, kNumActions, make_generator(seed));
    made->to(kDouble);
    return made;
}

TEST(SacdNetwork, ActorsAndCriticsParametersMakeUpTheWhole) {
    const auto network = make_network(1);
    const auto actor = actor_parameters(*network), critic = critic_parameters(*network);
    EXPECT_EQ(actor.size() + critic.size(), network->parameters().size());
    EXPECT_EQ(actor.size(), 6u);  // actor_fc, fc1, out: weight and bias each
}

// Losses ------------------------------------------------------------------------------

using Numbers = std::array<double, kNumActions>;

/// Networks whose policies and values are the same everywhere.
struct Problem {
    Numbers pi{0.1, 0.2, 0.3, 0.4}, target_pi{0.7, 0.1, 0.1, 0.1};
    Numbers q1{1, 2, 3, 4}, q2{4, 3, 2, 1}, target_q1{5, 0, 1, 2}, target_q2{4, 9, 3, -2};
    SacdConfig config = small_sacd();
    SacdNetwork network = constant_network(pi, q1, q2),
                target = constant_network(target_pi, target_q1, target_q2);
    torch::Tensor log_alpha = torch::full({1}, 0.3, kDouble).requires_grad_();
    double alpha = std::exp(0.3);
    double target_entropy = 0.9;
    Batch batch{.observation = noise_frames(2, 1),
                .action = torch::tensor({1, 3}, torch::kInt64),
                .n_step_return = torch::tensor({1.0f, -2.0f}),
                .discount = torch::tensor({0.5f, 0.0f}),
                .next_observation = noise_frames(2, 2),
                .index = {}};

    static SacdNetwork constant_network(const Numbers& pi, const Numbers& q1, const Numbers& q2) {
        auto made = make_network(1);
        const auto parameters = parameters_of(*made);
        std::vector<double> logits;
        for (const double probability : pi) logits.push_back(7 + std::log(probability));
        make_constant(parameters, "actor.out", logits);
        make_constant(parameters, "critic.q1.out", {q1.begin(), q1.end()});
        make_constant(parameters, "critic.q2.out", {q2.begin(), q2.end()});
        return made;
    }

    SacdLosses losses() { return sacd_losses(network, target, log_alpha, batch, target_entropy, config); }
};

double entropy_of(const Numbers& pi) {
    double sum = 0;
    for (const double probability : pi) sum -= probability * std::log(probability);
    return sum;
}

/// sum_a pi(a) (min(q1, q2)(a) - alpha log pi(a))
double soft_value(const Numbers& pi, const Numbers& q1, const Numbers& q2, double alpha) {
    double sum = alpha * entropy_of(pi);
    for (std::size_t a = 0; a < pi.size(); ++a) sum += pi[a] * std::min(q1[a], q2[a]);
    return sum;
}

TEST(SacdLosses, TheTargetIsAnExpectationOverTheActions) {
    Problem p;
    const auto expect_following = [&](const Numbers& pi) {
        const double follows = soft_value(pi, p.target_q1, p.target_q2, p.alpha);
        EXPECT_NEAR(p.losses().target_values[0].item<double>(), 0.1 * 1 + 0.5 * follows, 1e-12);
        // Nothing follows where the discount is 0.
        EXPECT_NEAR(p.losses().target_values[1].item<double>(), 0.1 * -2, 1e-12);
    };
    expect_following(p.pi);
    p.config.next_policy = NextPolicy::target;
    expect_following(p.target_pi);
}

TEST(SacdLosses, EveryTermByHand) {
    Problem p;
    const auto losses = p.losses();
    const double y = losses.target_values[0].item<double>();
    EXPECT_NEAR(losses.critic.item<double>(),
                (std::pow(2 - y, 2) + std::pow(3 - y, 2) + std::pow(4 + 0.2, 2) + std::pow(1 + 0.2, 2)) / 2,
                1e-9);
    // A sum over the actions: their mean would be a quarter of it.
    EXPECT_NEAR(losses.actor.item<double>(), -soft_value(p.pi, p.q1, p.q2, p.alpha), 1e-12);
    EXPECT_NEAR(losses.alpha.item<double>(), 0.3 * (entropy_of(p.pi) - 0.9), 1e-12);
    EXPECT_TRUE(torch::allclose(losses.entropy, torch::full({2}, entropy_of(p.pi), kDouble)));
    EXPECT_TRUE(torch::allclose(losses.q1, torch::tensor({2.0, 4.0}, kDouble)));
    EXPECT_TRUE(torch::allclose(losses.q2, torch::tensor({3.0, 1.0}, kDouble)));
}

TEST(SacdLosses, TheTwinsMayBeAveragedAndTheTargetMayLackTheEntropy) {
    Problem p;
    p.config.twin_estimate = TwinEstimate::mean;
    // The network's twins have a mean of 2.5 for every action, the target's 4.5, 4.5, 2 and 0.
    EXPECT_NEAR(p.losses().actor.item<double>(), -(2.5 + p.alpha * entropy_of(p.pi)), 1e-12);
    const double follows = 0.1 * 4.5 + 0.2 * 4.5 + 0.3 * 2;
    EXPECT_NEAR(p.losses().target_values[0].item<double>(),
                0.1 + 0.5 * (follows + p.alpha * entropy_of(p.pi)), 1e-12);
    p.config.entropy_in_target = false;
    EXPECT_NEAR(p.losses().target_values[0].item<double>(), 0.1 + 0.5 * follows, 1e-12);
    EXPECT_NEAR(p.losses().actor.item<double>(), -(2.5 + p.alpha * entropy_of(p.pi)), 1e-12);
}

TEST(SacdLosses, AlphaFallsWhereTheEntropyIsLargerThanItsTarget) {
    for (const double target_entropy : {0.9, 1.3}) {  // of the policy: 1.28
        Problem p;
        p.target_entropy = target_entropy;
        p.losses().alpha.backward();
        EXPECT_NEAR(p.log_alpha.grad().item<double>(), entropy_of(p.pi) - target_entropy, 1e-12);
    }
}

TEST(SacdUpdate, EachLossTrainsItsOwnParameters) {
    Problem p;
    ActorCriticState<SacdNetwork> learner(make_network(1), make_network(2), p.log_alpha, {});
    const auto losses =
        sacd_losses(learner.network, learner.target, p.log_alpha, p.batch, p.target_entropy, p.config);
    const auto critic =
        torch::autograd::grad({0.5 * losses.critic}, learner.critic, {}, /*retain_graph=*/true);
    const auto actor = torch::autograd::grad({losses.actor}, learner.actor, {}, true);
    const auto updated = sacd_update(learner, p.batch, p.target_entropy, p.config);
    for (std::size_t i = 0; i < critic.size(); ++i)
        EXPECT_TRUE(torch::allclose(learner.critic[i].grad(), critic[i]));
    for (std::size_t i = 0; i < actor.size(); ++i)
        EXPECT_TRUE(torch::allclose(learner.actor[i].grad(), actor[i]));
    for (const auto& parameter : learner.target_parameters) EXPECT_FALSE(parameter.grad().defined());
    EXPECT_NE(learner.log_alpha.item<double>(), 0.3);
    for (const auto& tensor : {updated.critic, updated.actor, updated.alpha, updated.q1, updated.q2,
                               updated.target_values, updated.entropy})
        EXPECT_FALSE(tensor.requires_grad());
}

TEST(SacdLosses, ShapesThatWouldBroadcastAreRefused) {
    const ExpectRefused expect_refused{[] { return Problem(); }};
    expect_refused("the action", "[2]", "[1]",
                   [](Problem& p) { p.batch.action = p.batch.action.slice(0, 0, 1); });
    expect_refused("n-step return", "[2]", "[2, 1]",
                   [](Problem& p) { p.batch.n_step_return = p.batch.n_step_return.unsqueeze(1); });
    expect_refused("discount", "[2]", "[]", [](Problem& p) { p.batch.discount = torch::tensor(0.5f); });
    expect_refused("next observation", "[2, 2, 12, 12]", "[1, 2, 12, 12]",
                   [](Problem& p) { p.batch.next_observation = noise_frames(1, 2); });
    expect_refused("log_alpha", "[1]", "[2]",
                   [](Problem& p) { p.log_alpha = torch::zeros({2}, torch::requires_grad()); });
}

// Acting ------------------------------------------------------------------------------

TEST(Sacd, ActsUniformlyUntilItsFirstUpdateThenSamplesAndIsGreedyInEvaluation) {
    auto config = small_sacd();
    config.exploration = Exploration::standard;
    const auto spec = discrete_world();
    const auto agent = make_sacd(config, spec);
    EXPECT_FALSE(agent->metrics().contains("charts/epsilon"));
    const auto with_policy = [&] {
        auto state = agent->state();
        make_constant(state, "network/actor.out",
                      {std::log(0.1), std::log(0.2), std::log(0.6), std::log(0.1)});
        agent->load_state(state);
    };
    const auto expect_frequencies = [&](const Numbers& expected, ActMode mode) {
        const auto parts = frequencies(agent->act(same_frame(2000), mode));
        for (std::size_t a = 0; a < expected.size(); ++a)
            EXPECT_NEAR(parts[a], expected[a], 0.05) << "action " << a;
    };
    with_policy();
    expect_frequencies({0.25, 0.25, 0.25, 0.25}, ActMode::train);
    expect_frequencies({0, 0, 1, 0}, ActMode::evaluate);
    drive(*agent, spec, 0, 22);
    with_policy();  // 22 transitions are stored: it is warm
    expect_frequencies({0.1, 0.2, 0.6, 0.1}, ActMode::train);
    expect_frequencies({0, 0, 1, 0}, ActMode::evaluate);
}

TEST(Sacd, ActsWithItsTargetWhereItIsTold) {
    for (const bool with_target : {false, true}) {
        auto config = small_sacd();
        config.act_with_target = with_target;
        const auto agent = make_sacd(config, discrete_world());
        auto state = agent->state();
        make_constant(state, "network/actor.out", {0, 9, 0, 0});
        make_constant(state, "target/actor.out", {0, 0, 9, 0});
        agent->load_state(state);
        const auto best = with_target ? 2 : 1;
        EXPECT_EQ(agent->act(same_frame(1), ActMode::evaluate)[0].item<std::int64_t>(), best);
        EXPECT_EQ(agent->policy()->weights.at("actor.out.bias").argmax().item<std::int64_t>(), best);
    }
}

// The first step of Adam leaves a tenth of the gradient in its moment.
TEST(Sacd, AimsForAPartOfTheUniformPolicysEntropy) {
    for (const double scale : {0.98, 0.5}) {
        auto config = small_sacd();
        config.target_entropy_scale = scale;
        const auto spec = discrete_world();
        const auto agent = make_sacd(config, spec);
        auto state = agent->state();
        make_constant(state, "network/actor.out", {0, 0, 0, 0});
        agent->load_state(state);
        for (std::int64_t step = 0; gradient_steps_of(*agent) == 0; ++step) drive(*agent, spec, step, 1);
        EXPECT_NEAR(agent->state().at("alpha_adam/first_moment.0").item<double>(),
                    0.1 * (1 - scale) * std::log(4), 1e-6);
    }
}

// Learning ----------------------------------------------------------------------------

TEST(Sacd, LearnsWhichActionTheFrameAsksFor) {
    auto config = small_sacd();
    config.network.hidden_units = 64;
    config.replay = {.min_replay = 200, .update_period = 8, .replay_capacity = 20'000, .batch_size = 32};
    config.replay.reward_scale = 10;  // so that the reward outweighs the entropy from the start
    config.exploration = Exploration::standard;
    config.learning_rate = 1e-3;
    const auto spec = discrete_world(8);
    EXPECT_GT(learned_after(*make_sacd(config, spec), spec, 300), 0.9);
}

}  // namespace
}  // namespace cale
