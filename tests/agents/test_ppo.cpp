#include "agents/advantages.h"
#include "agents/ppo.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agent_worlds.h"
#include "agents/random.h"
#include "dopamine/rollout.h"
#include "expect_refused.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr auto kDouble = torch::kFloat64;

torch::Tensor column(const std::vector<double>& numbers) {
    return torch::tensor(numbers, kDouble).unsqueeze(1);
}

TEST(PpoNetwork, ParameterCountOfTheReference) {
    const PpoNetwork network(PpoNetworkConfig{}, 0, make_generator(1));
    EXPECT_EQ(count_parameters(*network), 5'689'331);
}

// Advantages --------------------------------------------------------------------------

TEST(GeneralizedAdvantages, AreDiscountedSumsOfTheErrors) {
    // delta = 1 + 2/2 - 4, 2 + 6/2 - 2, 4 + 8/2 - 6 = -2, 3, 2; each passes on a quarter.
    const auto estimate = generalized_advantages(column({1, 2, 4}), column({0, 0, 0}), column({4, 2, 6}),
                                                 torch::tensor({8.0}, kDouble), 0.5, 0.5);
    EXPECT_TRUE(torch::equal(estimate.advantage, column({-2 + 3.5 / 4, 3.5, 2})));
    EXPECT_TRUE(torch::equal(estimate.returns, column({4 - 2 + 3.5 / 4, 5.5, 8})));
}

TEST(GeneralizedAdvantages, NothingPassesATerminal) {
    // delta = 1 + 2/2 - 4, 2 - 2, 4 + 8/2 - 6 = -2, 0, 2; the second step ended an episode.
    const auto estimate = generalized_advantages(column({1, 2, 4}), column({0, 1, 0}), column({4, 2, 6}),
                                                 torch::tensor({8.0}, kDouble), 0.5, 0.5);
    EXPECT_TRUE(torch::equal(estimate.advantage, column({-2, 0, 2})));
    const auto at_the_end = generalized_advantages(column({1, 2, 4}), column({0, 0, 1}), column({4, 2, 6}),
                                                   torch::tensor({8.0}, kDouble), 0.5, 0.5);
    EXPECT_TRUE(torch::equal(at_the_end.advantage[2], torch::tensor({4.0 - 6}, kDouble)));
}

TEST(GeneralizedAdvantages, EnvironmentsDoNotMix) {
    const auto both = [](const torch::Tensor& first, const torch::Tensor& second) {
        return torch::cat({first, second}, 1);
    };
    const auto estimate = generalized_advantages(
        both(column({1, 2, 4}), column({0, 0, 1})), both(column({0, 1, 0}), column({0, 0, 0})),
        both(column({4, 2, 6}), column({0, 0, 0})), torch::tensor({8.0, 2.0}, kDouble), 0.5, 0.5);
    EXPECT_TRUE(torch::equal(estimate.advantage, both(column({-2, 0, 2}), column({0.125, 0.5, 2}))));
    EXPECT_TRUE(torch::equal(estimate.returns, both(column({2, 2, 8}), column({0.125, 0.5, 2}))));
}

TEST(GeneralizedAdvantages, OtherShapesAreRefused) {
    const auto estimate = [](std::int64_t terminals, std::int64_t values, std::int64_t next_values) {
        generalized_advantages(torch::zeros({3, 2}), torch::zeros({terminals, 2}), torch::zeros({values, 2}),
                               torch::zeros({next_values}), 0.5, 0.5);
    };
    const auto names = [](const char* what, const char* expected, const char* given) {
        return ThrowsMessage<std::invalid_argument>(
            AllOf(HasSubstr(what), HasSubstr(expected), HasSubstr(given)));
    };
    EXPECT_NO_THROW(estimate(3, 3, 2));
    EXPECT_THAT([&] { estimate(1, 3, 2); }, names("terminal", "[3, 2]", "[1, 2]"));
    EXPECT_THAT([&] { estimate(3, 1, 2); }, names("value", "[3, 2]", "[1, 2]"));
    EXPECT_THAT([&] { estimate(3, 3, 1); }, names("next_value", "[2]", "[1]"));
}

// Losses ------------------------------------------------------------------------------

PpoNetwork make_network(std::int64_t num_actions, std::uint64_t seed = 1) {
    PpoNetwork made(PpoNetworkConfig{.encoder = small_encoder(), .hidden_units = 16}, num_actions,
                    make_generator(seed));
    made->to(kDouble);
    return made;
}

/// A policy that takes its four actions alike, a value of 1, and steps whose policy has changed by these
/// ratios.
struct Problem {
    PpoConfig config = small_ppo();
    PpoNetwork network = make_network(kNumActions);
    RolloutBatch minibatch;

    Problem(const std::vector<double>& ratios, const std::vector<double>& advantages) {
        const auto parameters = parameters_of(*network);
        make_constant(parameters, "actor.out", {0, 0, 0, 0});
        make_constant(parameters, "critic.out", {1});
        const auto size = static_cast<std::int64_t>(ratios.size());
        minibatch = {.observation = noise_frames(size, 1),
                     .action = torch::arange(size) % kNumActions,
                     .old_log_prob = std::log(0.25) - torch::tensor(ratios, kDouble).log(),
                     .old_value = torch::ones({size}, kDouble),
                     .advantage = torch::tensor(advantages, kDouble),
                     .returns = torch::ones({size}, kDouble)};
    }

    PpoLosses losses() { return ppo_losses(network, normalized(minibatch), config); }
    double critic() { return losses().critic.item<double>(); }
    /// Whether the actor's loss moves the policy.
    bool trains_the_policy() {
        config.entropy_coefficient = 0;
        network->zero_grad();
        losses().combined.backward();
        return network->named_parameters()["actor.out.bias"].grad().abs().max().item<double>() > 1e-12;
    }
};

TEST(PpoLosses, RatiosCountUpToTheClip) {
    // min(rho A, clip(rho) A) with advantages of 1 and -1: 1.1, -1.5, 0.5 and -0.9.
    Problem p({1.5, 1.5, 0.5, 0.5}, {1, -1, 1, -1});
    const auto losses = p.losses();
    EXPECT_NEAR(losses.actor.item<double>(), -(1.1 - 1.5 + 0.5 - 0.9) / 4, 1e-6);
    EXPECT_NEAR(losses.clipped_fraction.item<double>(), 1, 1e-12);
    EXPECT_NEAR(losses.approximate_kl.item<double>(),
                ((0.5 - std::log(1.5)) * 2 + (-0.5 - std::log(0.5)) * 2) / 4, 1e-12);
    p.config.clip = 0.6;  // now none of them is clipped
    EXPECT_NEAR(p.losses().actor.item<double>(), -(1.5 - 1.5 + 0.5 - 0.5) / 4, 1e-6);
    EXPECT_EQ(p.losses().clipped_fraction.item<double>(), 0);
}

TEST(PpoLosses, AStepThatWasClippedTrainsThePolicyNoFurther) {
    EXPECT_FALSE(Problem({1.5, 0.5}, {1, -1}).trains_the_policy());
    EXPECT_TRUE(Problem({1.5, 0.5}, {-1, 1}).trains_the_policy());  // back it may
    EXPECT_TRUE(Problem({1.05, 0.95}, {1, -1}).trains_the_policy());
}

TEST(PpoLosses, AdvantagesAreNormalised) {
    Problem p({1.05, 1.02}, {3, 7}), shifted({1.05, 1.02}, {300, 700});
    EXPECT_NEAR(p.losses().actor.item<double>(), -(-1.05 + 1.02) / 2, 1e-6);
    EXPECT_NEAR(shifted.losses().actor.item<double>(), -(-1.05 + 1.02) / 2, 1e-6);
    Problem alike({1.05, 1.02}, {2, 2});  // no deviation to divide by
    EXPECT_EQ(alike.losses().actor.item<double>(), 0);
}

TEST(PpoLosses, ImportanceWeighsNormalisedAdvantages) {
    RolloutBatch batch;
    batch.advantage = torch::tensor({3.0, 7.0}, kDouble);
    batch.importance = torch::tensor({2.0, 0.5}, kDouble);
    EXPECT_TRUE(torch::allclose(normalized(batch).advantage, torch::tensor({-2.0, 0.5}, kDouble)));
}

TEST(PpoLosses, AValueCountsAsIfItHadMovedByTheClipAtMost) {
    Problem p({1, 1}, {1, -1});
    p.minibatch.old_value = torch::tensor({0.0, 1.05}, kDouble);
    p.minibatch.returns = torch::tensor({2.0, 0.0}, kDouble);
    // From 0 to 1 is too far: (0.1 - 2)^2 is larger than (1 - 2)^2. From 1.05 to 1 is not.
    EXPECT_NEAR(p.critic(), 0.5 * (1.9 * 1.9 + 1) / 2, 1e-12);
    p.minibatch.returns[0] = -2;  // (0.1 + 2)^2 is smaller than (1 + 2)^2, which counts
    EXPECT_NEAR(p.critic(), 0.5 * (9 + 1) / 2, 1e-12);
    p.minibatch.returns[0] = 2;
    p.config.clip_value_loss = false;
    EXPECT_NEAR(p.critic(), 0.5 * (1 + 1) / 2, 1e-12);
}

TEST(PpoLosses, AreCombinedByTheirCoefficients) {
    Problem p({1.5, 1.5, 0.5, 0.5}, {1, -1, 1, -1});
    p.minibatch.returns = torch::full({4}, 3.0, kDouble);
    p.config.value_coefficient = 0.25;
    p.config.entropy_coefficient = 0.5;
    const auto losses = p.losses();
    EXPECT_NEAR(losses.critic.item<double>(), 2, 1e-12);
    EXPECT_NEAR(losses.entropy.item<double>(), std::log(4), 1e-12);
    EXPECT_NEAR(losses.combined.item<double>(), 0.2 + 0.25 * 2 - 0.5 * std::log(4), 1e-6);
    EXPECT_TRUE(losses.combined.requires_grad());
    for (const auto& tensor :
         {losses.actor, losses.critic, losses.entropy, losses.approximate_kl, losses.clipped_fraction})
        EXPECT_FALSE(tensor.requires_grad());
}

TEST(PpoLosses, ShapesThatWouldBroadcastAreRefused) {
    const ExpectRefused expect_refused{[] { return Problem({1, 1}, {1, -1}); }};
    expect_refused("old log-probability", "[2]", "[2, 1]",
                   [](Problem& p) { p.minibatch.old_log_prob = p.minibatch.old_log_prob.unsqueeze(1); });
    expect_refused("old value", "[2]", "[1]",
                   [](Problem& p) { p.minibatch.old_value = p.minibatch.old_value.slice(0, 0, 1); });
    expect_refused("advantage", "[2]", "[]",
                   [](Problem& p) { p.minibatch.advantage = torch::tensor(1.0, kDouble); });
    expect_refused("return", "[2]", "[2, 1]",
                   [](Problem& p) { p.minibatch.returns = p.minibatch.returns.unsqueeze(1); });
    expect_refused("action", "[2]", "[1]",
                   [](Problem& p) { p.minibatch.action = p.minibatch.action.slice(0, 0, 1); });
    expect_refused("action", "[2, 3]", "[1, 3]", [](Problem& p) {
        p.network = make_network(0);
        p.minibatch.action = torch::full({1, 3}, 0.5, kDouble);
    });
}

// Updates -----------------------------------------------------------------------------

TEST(PpoUpdate, TheLearningRateFallsLinearlyToZeroAndStaysThere) {
    Problem p({1, 1}, {1, -1});
    p.config.learning_rate = 0.5;
    OnPolicyState learner(p.network, 4, p.config);
    for (const double part : {1.0, 0.75, 0.5, 0.25, 0.0, 0.0}) {
        const auto before = copy_of(parameters_of(*p.network));
        ppo_update(learner, p.minibatch, p.config);
        EXPECT_DOUBLE_EQ(learner.adam.learning_rate(), 0.5 * part);
        EXPECT_EQ(torch::equal(parameters_of(*p.network).at("actor.out.bias"), before.at("actor.out.bias")),
                  part == 0);
    }
    EXPECT_EQ(learner.gradient_steps, 6);
    OnPolicyState constant(p.network, 0, p.config);
    for (int step = 0; step < 3; ++step) ppo_update(constant, p.minibatch, p.config);
    EXPECT_DOUBLE_EQ(constant.adam.learning_rate(), 0.5);
}

TEST(PpoUpdate, GradientsAreScaledDownToTheLargestNorm) {
    Problem p({1, 1}, {1, -1});
    p.minibatch.returns = torch::full({2}, 100.0, kDouble);
    OnPolicyState learner(p.network, 0, p.config);
    const auto losses = ppo_update(learner, p.minibatch, p.config);
    EXPECT_FALSE(losses.combined.requires_grad());
    double squares = 0;
    for (const auto& parameter : learner.parameters)
        squares += parameter.grad().square().sum().item<double>();
    EXPECT_NEAR(std::sqrt(squares), p.config.max_gradient_norm, 1e-9);
}

// Acting ------------------------------------------------------------------------------

TEST(Ppo, SamplesItsPolicyInTrainingAndInEvaluation) {
    const auto agent = make_ppo(small_ppo(), discrete_world(8));
    auto state = agent->state();
    make_constant(state, "network/actor.out", {std::log(0.1), std::log(0.2), std::log(0.6), std::log(0.1)});
    agent->load_state(state);
    const std::vector<double> expected{0.1, 0.2, 0.6, 0.1};
    const auto expect_frequencies = [&](const torch::Tensor& actions) {
        const auto parts = frequencies(actions);
        for (std::size_t a = 0; a < expected.size(); ++a)
            EXPECT_NEAR(parts[a], expected[a], 0.05) << "action " << a;
    };
    expect_frequencies(agent->act(same_frame(2000), ActMode::evaluate));
    std::vector<torch::Tensor> actions;
    for (int call = 0; call < 250; ++call) actions.push_back(agent->act(same_frame(8), ActMode::train));
    expect_frequencies(torch::cat(actions));
    EXPECT_FALSE(agent->metrics().contains("charts/epsilon"));
}

TEST(Ppo, SamplesTheJoystickAboutItsMean) {
    auto config = small_ppo();
    config.log_std = LogStd::direct;
    const auto agent = make_ppo(config, joystick_world());
    auto state = agent->state();
    make_constant(state, "network/actor.mean", {0, 0.5, -1});
    state.at("network/actor.log_std").fill_(-2);
    agent->load_state(state);
    const auto box = joystick_box();
    const auto u = ((agent->act(same_frame(2000), ActMode::evaluate) - box.centre) / box.half_width).atanh();
    EXPECT_TRUE(torch::allclose(u.mean(0), torch::tensor({0.0f, 0.5f, -1.0f}), 0, 0.02));
    EXPECT_TRUE(torch::allclose(u.std(0), torch::full({3}, std::exp(-2.0f)), 0.1));
}

TEST(Ppo, EpsilonGreedyIsUniformOverTheWholeBox) {
    auto config = small_ppo();
    config.exploration = Exploration::epsilon_greedy;
    config.epsilon = {.epsilon_train = 0, .epsilon_eval = 1, .epsilon_decay_period = 1};
    config.rollout_steps = config.minibatch_size = 1000;
    const auto spec = joystick_world(1000);
    const auto agent = make_ppo(config, spec);
    expect_uniform_over_the_box(agent->act(noise_frames(1000, 1), ActMode::evaluate));
    EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 1);
    expect_uniform_over_the_box(agent->act(noise_frames(1000, 1), ActMode::train));
}

TEST(Ppo, EpsilonFallsFromTheFirstDecisionOn) {
    for (const auto& spec : {joystick_world(2), discrete_world(2)}) {
        auto config = small_ppo();
        config.exploration = Exploration::epsilon_greedy;
        config.epsilon = {.epsilon_train = 0, .epsilon_eval = 0.5, .epsilon_decay_period = 20};
        const auto agent = make_ppo(config, spec);
        EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 1);
        drive(*agent, spec, 0, 5);
        EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 0.5);
        drive(*agent, spec, 5, 6);
        EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 0);
        if (num_actions(spec.action_space) == 0) continue;
        auto state = agent->state();
        make_constant(state, "network/actor.out", {0, 0, 50, 0});
        agent->load_state(state);
        EXPECT_NEAR(frequencies(agent->act(same_frame(2000), ActMode::evaluate))[2], 0.5 + 0.5 / 4, 0.04);
    }
}

// Rhythm ------------------------------------------------------------------------------

TEST(Ppo, UpdatesExactlyWhenTheRolloutIsFull) {
    for (const std::int64_t num_envs : {1, 2, 8}) {
        const auto spec = joystick_world(num_envs);
        const auto agent = make_ppo(small_ppo(), spec);  // 8 agent steps in 2 minibatches, twice
        for (std::int64_t step = 0; step < 20; ++step) {
            const bool full = step > 0 && step * num_envs % 8 == 0;
            EXPECT_EQ(agent->update(NoiseStep(spec, step).observations), full) << step;
            EXPECT_EQ(gradient_steps_of(*agent), step * num_envs / 8 * 4);
            act_and_observe(*agent, spec, step);
        }
    }
}

TEST(Ppo, AFullRolloutMustBeLearnedFromBeforeTheNextDecision) {
    const auto spec = joystick_world(8);
    const auto agent = make_ppo(small_ppo(), spec);
    act_and_observe(*agent, spec, 0);
    EXPECT_THROW(agent->act(NoiseStep(spec, 1).observations, ActMode::train), std::logic_error);
}

TEST(Ppo, TheLearningRateReachesZeroAtTheEndOfTheRun) {
    for (const std::int64_t num_envs : {1, 4}) {
        auto spec = joystick_world(num_envs);
        spec.total_steps = 24;  // three rollouts of four gradient steps
        const auto agent = make_ppo(small_ppo(), spec);
        const auto initial = agent->state();
        drive(*agent, spec, 0, 24 / num_envs);
        agent->update(NoiseStep(spec, 24).observations);
        EXPECT_EQ(gradient_steps_of(*agent), 12);
        EXPECT_NEAR(agent->metrics().at("charts/learning_rate"), 2.5e-4 / 12, 1e-9);
        const auto before = agent->state();
        for (std::int64_t step = 24; step < 24 + 8 / num_envs; ++step) act_and_observe(*agent, spec, step);
        agent->update(NoiseStep(spec, 40).observations);
        EXPECT_EQ(agent->metrics().at("charts/learning_rate"), 0);
        const auto after = agent->state();
        for (const auto& [name, tensor] : before) {
            if (!name.starts_with("network/")) continue;
            EXPECT_TRUE(torch::equal(tensor, after.at(name))) << name;
        }
        agent->load_state(initial);
        EXPECT_DOUBLE_EQ(agent->metrics().at("charts/learning_rate"), 2.5e-4) << "the start's again";
    }
}

TEST(Ppo, TheLearningRateMayFallInAnotherTimeOrNotAtAll) {
    const auto spec = joystick_world();
    const auto rate_after_two_rollouts = [&](const PpoConfig& config) {
        const auto agent = make_ppo(config, spec);
        drive(*agent, spec, 0, 17);
        return agent->metrics().at("charts/learning_rate");
    };
    auto config = small_ppo();
    config.anneal_steps = 10;  // seven gradient steps before the eighth
    EXPECT_NEAR(rate_after_two_rollouts(config), 2.5e-4 * 0.3, 1e-9);
    config.anneal_learning_rate = false;
    EXPECT_DOUBLE_EQ(rate_after_two_rollouts(config), 2.5e-4);
}

// What a rollout teaches --------------------------------------------------------------

/// Settings under which an update is one step along the gradient, so that what it has learned shows.
PpoConfig transparent() {
    auto config = small_ppo();
    config.rollout_steps = config.minibatch_size = 4;
    config.epochs = 1;
    config.adam_epsilon = 1;
    config.learning_rate = 0.5;
    config.anneal_learning_rate = false;
    config.gamma = 0.5;
    config.gae_lambda = 0.5;
    return config;
}

/// An agent and its first rollout, to be compared with what the definitions make of the same steps.
struct Witness {
    PpoConfig config;
    AgentSpec spec;
    std::unique_ptr<Agent> agent;
    PpoNetwork network;            // the agent's, before it has learned anything
    std::vector<NoiseStep> steps;  // and the one that follows them
    std::vector<torch::Tensor> actions;

    Witness(const PpoConfig& config_, const AgentSpec& spec_)
        : config(config_), spec(spec_), agent(make_ppo(config, spec)), network(with(agents_parameters())) {
        for (std::int64_t step = 0; step <= config.rollout_steps / spec.num_envs; ++step)
            steps.emplace_back(spec, step);
    }

    TensorMap agents_parameters() const {
        const std::string prefix = "network/";
        TensorMap parameters;
        for (const auto& [name, tensor] : agent->state())
            if (name.starts_with(prefix)) parameters[name.substr(prefix.size())] = tensor;
        return parameters;
    }

    PpoNetwork with(const TensorMap& parameters) const {
        PpoNetwork made(PpoNetworkConfig{.encoder = small_encoder(), .hidden_units = 16},
                        num_actions(spec.action_space), make_generator(1));
        for (const auto& [name, tensor] : parameters_of(*made)) tensor.copy_(parameters.at(name));
        return made;
    }

    torch::Tensor values(const torch::Tensor& observations) {
        const torch::NoGradGuard no_grad;
        return network(observations).value;
    }

    torch::Tensor rewards(std::size_t step) const {
        std::vector<float> numbers;
        const auto limit = static_cast<float>(config.reward_clip.value_or(INFINITY));
        const auto scale = static_cast<float>(config.reward_scale);
        for (const auto& result : steps[step].results)
            numbers.push_back(scale * std::clamp(result.reward, -limit, limit));
        return torch::tensor(numbers);
    }

    /// Plays the steps and lets the agent learn from them. Returns its parameters.
    TensorMap learned() {
        for (std::size_t step = 0; step + 1 < steps.size(); ++step) {
            EXPECT_FALSE(agent->update(steps[step].observations));
            actions.push_back(agent->act(steps[step].observations, ActMode::train));
            agent->observe(steps[step].experiences(actions.back()));
        }
        EXPECT_TRUE(agent->update(steps.back().observations));
        return agents_parameters();
    }

    /// Rows of the rollout, in the order of time.
    using Rows = std::vector<std::int64_t>;

    /// The network's parameters after one gradient step on each of these minibatches, given the rollout's
    /// advantages [T, N].
    TensorMap taught(const torch::Tensor& advantage, const std::vector<Rows>& minibatches) {
        std::vector<torch::Tensor> observations;
        for (std::size_t step = 0; step + 1 < steps.size(); ++step)
            observations.push_back(steps[step].observations);
        return taught(torch::cat(observations), torch::cat(actions), advantage, minibatches);
    }
    /// The same for a rollout of these observations [T N, stack, ...] and actions.
    TensorMap taught(const torch::Tensor& observation, const torch::Tensor& action,
                     const torch::Tensor& advantage, const std::vector<Rows>& minibatches) {
        const auto old = [&] {
            const torch::NoGradGuard no_grad;
            return network(observation);
        }();
        const auto old_log_prob = log_prob(old.policy, action, network->box).detach();
        OnPolicyState learner(with(parameters_of(*network)), 0, config);
        losses.clear();
        for (const auto& rows : minibatches) {
            const auto part = [&](const torch::Tensor& x) { return x.index_select(0, torch::tensor(rows)); };
            losses.push_back(ppo_update(learner,
                                        {.observation = part(observation),
                                         .action = part(action),
                                         .old_log_prob = part(old_log_prob),
                                         .old_value = part(old.value),
                                         .advantage = part(advantage.flatten()),
                                         .returns = part(advantage.flatten() + old.value)},
                                        config));
        }
        return parameters_of(*learner.network);
    }
    std::vector<PpoLosses> losses;  // of the newest taught()

    /// r + gamma V(next) - V of every step, [T, N], where no episode ends.
    torch::Tensor errors() {
        std::vector<torch::Tensor> found;
        for (std::size_t t = 0; t + 1 < steps.size(); ++t)
            found.push_back(rewards(t) + config.gamma * values(steps[t + 1].observations) -
                            values(steps[t].observations));
        return torch::stack(found);
    }
};

/// The largest difference between two networks.
double distance(const TensorMap& first, const TensorMap& second) {
    double largest = 0;
    for (const auto& [name, tensor] : first)
        largest = std::max(largest, (tensor - second.at(name)).abs().max().item<double>());
    return largest;
}

constexpr double kRounding = 2e-5;

TEST(Ppo, LearnsFromItsRolloutAsDefined) {
    for (const auto& spec : {joystick_world(1), joystick_world(2), discrete_world(2), discrete_world(4)}) {
        auto config = transparent();
        config.reward_clip = 1.5;
        config.reward_scale = 0.5;
        Witness w(config, spec);
        const auto length = 4 / spec.num_envs;
        if (length > 1)
            for (auto& result : w.steps[0].results) result.terminal = result.episode_over = true;
        const auto learned = w.learned();
        // The errors of the steps, last one first; the values of what follows come with the update.
        auto following = w.values(w.steps.back().observations);
        auto advantage = torch::zeros({length, spec.num_envs}), returns = advantage.clone();
        auto passed_on = torch::zeros({spec.num_envs});
        for (std::int64_t t = length - 1; t >= 0; --t) {
            const auto& step = w.steps[static_cast<std::size_t>(t)];
            const auto value = w.values(step.observations);
            const double goes_on = step.results[0].terminal ? 0 : 1;
            advantage[t] = w.rewards(static_cast<std::size_t>(t)) +
                           goes_on * (0.5 * following + 0.25 * passed_on) - value;
            following = value;
            passed_on = advantage[t];
            returns[t] = advantage[t] + value;
        }
        EXPECT_NEAR(w.agent->metrics().at("losses/explained_variance"),
                    1 - (advantage.var(false) / returns.var(false)).item<double>(), 1e-4);
        EXPECT_LT(distance(learned, w.taught(advantage, {{0, 1, 2, 3}})), kRounding) << spec.num_envs;
        EXPECT_GT(distance(learned, parameters_of(*w.network)), 1e-3);
    }
}

TEST(Ppo, AnEpisodeThatWasCutOffKeepsTheValueOfWhatWouldHaveFollowed) {
    for (const bool truncated : {true, false}) {
        Witness w(transparent(), joystick_world(2));
        auto& cut = w.steps[0].results[1];  // the second environment's first of two steps
        cut.episode_over = true;
        (truncated ? cut.truncated : cut.terminal) = true;
        const auto learned = w.learned();
        // It was left with the stack, moved on by the final frame.
        const auto& first = w.steps[0];
        const auto left_with = torch::stack({first.observations[1][1], first.final_frames[1]}).unsqueeze(0);
        const auto v0 = w.values(first.observations), v1 = w.values(w.steps[1].observations),
                   v2 = w.values(w.steps[2].observations);
        auto advantage = torch::empty({2, 2});
        advantage[1] = w.rewards(1) + 0.5 * v2 - v1;
        advantage[0][0] = w.rewards(0)[0] + 0.5 * v1[0] - v0[0] + 0.25 * advantage[1][0];
        const auto follows = 0.5 * w.values(left_with)[0];
        advantage[0][1] = w.rewards(0)[1] + (truncated ? 1 : 0) * follows - v0[1];
        EXPECT_LT(distance(learned, w.taught(advantage, {{0, 1, 2, 3}})), kRounding) << truncated;
        // A value too many or too few would show.
        advantage[0][1] += (truncated ? -1 : 1) * follows;
        EXPECT_GT(distance(learned, w.taught(advantage, {{0, 1, 2, 3}})), 5 * kRounding) << truncated;
    }
}

TEST(Ppo, ContiguousMinibatchesAreStretchesOfTimeAndShuffledOnesAreNot) {
    for (const auto minibatches : {Minibatches::contiguous, Minibatches::shuffled}) {
        auto config = transparent();
        config.minibatches = minibatches;
        config.rollout_steps = 8;
        config.gae_lambda = 0;  // the advantages are the errors themselves
        int early_first = 0, late_first = 0, neither = 0;
        for (std::uint64_t seed = 1; seed <= 10; ++seed) {
            Witness w(config, joystick_world(2, seed));
            const auto learned = w.learned();
            const Witness::Rows first{0, 1, 2, 3}, second{4, 5, 6, 7};
            const bool early = distance(learned, w.taught(w.errors(), {first, second})) < kRounding;
            const bool late = distance(learned, w.taught(w.errors(), {second, first})) < kRounding;
            early_first += early;
            late_first += late;
            neither += !early && !late;
        }
        EXPECT_EQ(early_first + late_first + neither, 10);  // their order matters
        if (minibatches == Minibatches::contiguous) {
            EXPECT_EQ(neither, 0);
            EXPECT_GT(early_first, 0);  // and is drawn
            EXPECT_GT(late_first, 0);
        } else {
            EXPECT_GE(neither, 8);  // two of seventy divisions of eight are stretches
        }
    }
}

/// Settings with two minibatches and two epochs.
PpoConfig two_epochs(Minibatches minibatches) {
    auto config = transparent();
    config.minibatches = minibatches;
    config.minibatch_size = 2;
    config.epochs = 2;
    config.gae_lambda = 0;
    return config;
}

TEST(Ppo, ContiguousMinibatchesKeepTheirOrderInAllEpochsAndTheirLossesAreAveraged) {
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
        Witness w(two_epochs(Minibatches::contiguous), joystick_world(1, seed));
        const auto learned = w.learned();
        const Witness::Rows first{0, 1}, second{2, 3};
        if (distance(learned, w.taught(w.errors(), {first, second, first, second})) > kRounding) {
            EXPECT_LT(distance(learned, w.taught(w.errors(), {second, first, second, first})), kRounding);
        }
        const auto expect_mean = [&](const char* name, torch::Tensor PpoLosses::*part) {
            double sum = 0;
            for (const auto& losses : w.losses) sum += (losses.*part).item<double>();
            EXPECT_NEAR(w.agent->metrics().at(name), sum / 4, 1e-4) << name;
        };
        expect_mean("losses/loss", &PpoLosses::combined);
        expect_mean("losses/policy_loss", &PpoLosses::actor);
        expect_mean("losses/value_loss", &PpoLosses::critic);
        expect_mean("losses/entropy", &PpoLosses::entropy);
    }
}

TEST(Ppo, LogsTheSpreadOfItsPolicyAfterTheUpdate) {
    Witness w(transparent(), joystick_world(1, 1));
    const auto learned = w.learned();
    const auto log_std = learned.at("actor.log_std.weight").sum(1) + learned.at("actor.log_std.bias");
    EXPECT_GT(log_std.abs().min().item<double>(), 1e-3) << "it begins at 0";
    EXPECT_NEAR(w.agent->metrics().at("charts/mean_log_std"), log_std.mean().item<double>(), 1e-5);
}

TEST(Ppo, ShuffledMinibatchesHaveAnotherOrderInEveryEpoch) {
    const std::vector<std::pair<Witness::Rows, Witness::Rows>> orders{{{0, 1}, {2, 3}}, {{0, 2}, {1, 3}},
                                                                      {{0, 3}, {1, 2}}, {{1, 2}, {0, 3}},
                                                                      {{1, 3}, {0, 2}}, {{2, 3}, {0, 1}}};
    int repeated = 0, reordered = 0;
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
        Witness w(two_epochs(Minibatches::shuffled), joystick_world(1, seed));
        const auto learned = w.learned();
        for (const auto& [a, b] : orders)
            for (const auto& [c, d] : orders)
                if (distance(learned, w.taught(w.errors(), {a, b, c, d})) < kRounding)
                    ++(a == c ? repeated : reordered);
    }
    EXPECT_EQ(repeated + reordered, 6);
    EXPECT_GT(reordered, 0);
}

// The reference's defects -------------------------------------------------------------

TEST(Ppo, LearnsFromTheReferencesRolloutWhereItIsTold) {
    auto config = transparent();
    config.replay_terminal = ReplayTerminal::dopamine;
    Witness w(config, joystick_world());
    DopamineRollout rollout({.length = config.rollout_steps,
                             .observation = w.spec.observation,
                             .reward_scale = config.reward_scale,
                             .reward_clip = config.reward_clip});
    for (std::int64_t number = 0;; ++number) {
        NoiseStep step(w.spec, number);
        step.results[0].terminal = step.results[0].episode_over = number == 1;
        ASSERT_EQ(w.agent->update(step.observations), rollout.full());
        if (rollout.full()) break;
        rollout.set_observations(step.observations);
        const auto seen = step.experiences(w.agent->act(step.observations, ActMode::train));
        w.agent->observe(seen);
        rollout.add(seen.actions, seen.results, seen.final_frames);
    }
    ASSERT_GT(rollout.terminal.sum().item<float>(), 0);
    const auto observation = rollout.observation.flatten(0, 1);
    const auto advantage = generalized_advantages(rollout.reward, rollout.terminal,
                                                  w.values(observation).view_as(rollout.reward),
                                                  w.values(rollout.next_observation), 0.5, 0.5)
                               .advantage;
    EXPECT_LT(distance(w.agents_parameters(),
                       w.taught(observation, rollout.action.flatten(0, 1), advantage, {{0, 1, 2, 3}})),
              kRounding);
}

TEST(Ppo, SeesTheFrameBeforeTheNewestOnceMoreBehindAnUpdateWhereItIsTold) {
    auto config = transparent();
    config.stack_after_update = StackAfterUpdate::repeated;
    Witness w(config, joystick_world());
    w.learned();
    const auto frame = [&](std::int64_t step) { return NoiseStep(w.spec, step).frames[0]; };
    const std::vector<std::pair<torch::Tensor, torch::Tensor>> expected{
        {frame(4), frame(3)}, {frame(3), frame(5)}, {NoiseStep(w.spec, 6).observations[0][0], frame(6)}};
    for (std::int64_t number = 4; number < 7; ++number) {
        const NoiseStep step(w.spec, number);
        w.agent->observe(step.experiences(w.agent->act(step.observations, ActMode::train)));
        const auto i = number - 4;
        const auto& [older, newer] = expected[static_cast<std::size_t>(i)];
        EXPECT_TRUE(
            torch::equal(w.agent->state().at("rollout/observation")[i][0], torch::stack({older, newer})))
            << number;
    }
}

// Beside the environments -------------------------------------------------------------

TEST(Ppo, OverlapActsWithTheParametersFromBeforeTheUpdateThatIsUnderWay) {
    auto spec = joystick_world(2);
    spec.overlap = true;
    Witness w(transparent(), spec);
    const auto initial = copy_of(w.agents_parameters());
    const auto acting = [&] { return part_of(w.agent->state(), "acting/"); };
    expect_equal(acting(), initial);

    // The first rollout is that of the strict order, and teaches the same.
    const auto once = copy_of(w.learned());
    Witness strict(transparent(), joystick_world(2));
    expect_equal(once, strict.learned());
    expect_equal(acting(), initial);

    // The second one is played by the network that played the first.
    OnPolicyState learner(w.with(initial), 0, w.config);
    const auto learn = [&](std::size_t first) {
        const torch::Tensor observations =
            torch::cat({w.steps[first].observations, w.steps[first + 1].observations});
        const auto actions = torch::cat({w.actions[first], w.actions[first + 1]});
        const auto log_prob_of = [&](PpoNetwork& network) {
            return log_prob(network(observations).policy, actions, network->box).detach();
        };
        const auto old = log_prob_of(learner.network), value = learner.network(observations).value.detach();
        const auto next = learner.network(w.steps[first + 2].observations).value.detach();
        const auto estimate =
            generalized_advantages(torch::stack({w.rewards(first), w.rewards(first + 1)}),
                                   torch::zeros({2, 2}), value.view({2, 2}), next, 0.5, 0.5);
        ppo_update(learner,
                   {.observation = observations,
                    .action = actions,
                    .old_log_prob = old,
                    .old_value = value,
                    .advantage = estimate.advantage.flatten(),
                    .returns = estimate.returns.flatten(),
                    .importance = (old - log_prob_of(w.network)).exp()},
                   w.config);
    };
    learn(0);
    EXPECT_LT(distance(once, parameters_of(*learner.network)), kRounding);
    for (std::int64_t step = 3; step <= 4; ++step) w.steps.emplace_back(spec, step);
    for (std::size_t step = 2; step < 4; ++step) {
        w.actions.push_back(w.agent->act(w.steps[step].observations, ActMode::train));
        w.agent->observe(w.steps[step].experiences(w.actions.back()));
    }
    EXPECT_TRUE(w.agent->update(w.steps[4].observations));
    learn(2);
    EXPECT_LT(distance(w.agents_parameters(), parameters_of(*learner.network)), kRounding);
    expect_equal(acting(), once);
}

TEST(Ppo, OverlapGoesOnWhereItStopped) {
    auto spec = joystick_world(2);
    spec.overlap = true;
    const auto whole = make_ppo(small_ppo(), spec), first = make_ppo(small_ppo(), spec),
               rest = make_ppo(small_ppo(), spec);
    drive(*whole, spec, 0, 22);
    drive(*first, spec, 0, 9);  // an update is under way
    rest->load_state(copy_of(first->state()));
    drive(*rest, spec, 9, 13);
    expect_equal(rest->state(), whole->state());
    EXPECT_EQ(rest->metrics(), whole->metrics());
}

// Bad settings ------------------------------------------------------------------------

TEST(Ppo, ARolloutIsAMultipleOfTheEnvironmentsAndOfTheMinibatch) {
    auto config = small_ppo();
    const auto names = [](const char* first, const char* second) {
        return ThrowsMessage<std::invalid_argument>(
            AllOf(HasSubstr("agent.rollout_steps is 8"), HasSubstr(first), HasSubstr(second)));
    };
    EXPECT_THAT([&] { make_ppo(config, joystick_world(3)); }, names("env.num_envs", "3"));
    EXPECT_THAT([&] { make_ppo(config, joystick_world(16)); }, names("env.num_envs", "16"));
    config.minibatch_size = 5;
    EXPECT_THAT([&] { make_ppo(config, joystick_world()); }, names("agent.minibatch_size", "5"));
    config.minibatch_size = 0;
    EXPECT_THAT([&] { make_ppo(config, joystick_world()); }, names("agent.minibatch_size", "0"));
}

// Learning ----------------------------------------------------------------------------

PpoConfig quick_learner() {
    auto config = small_ppo();
    config.network.hidden_units = 32;
    config.rollout_steps = 256;
    config.minibatch_size = 64;
    config.epochs = 4;
    config.learning_rate = 1e-3;
    config.anneal_learning_rate = false;
    return config;
}

TEST(Ppo, LearnsWhichActionTheFrameAsksFor) {
    const auto spec = discrete_world(8);
    EXPECT_GT(learned_after(*make_ppo(quick_learner(), spec), spec, 640), 0.9);
}

TEST(Ppo, LearnsToPushTheJoystickWhereTheFrameSays) {
    for (const bool overlap : {false, true}) {
        auto spec = joystick_world(8);
        spec.overlap = overlap;
        EXPECT_GT(learned_after(*make_ppo(quick_learner(), spec), spec, 640), 0.8) << overlap;
    }
}

}  // namespace
}  // namespace cale
