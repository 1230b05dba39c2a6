#include "agents/der.h"

#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agent_worlds.h"
#include "agents/critic.h"
#include "agents/random.h"
#include "expect_refused.h"

namespace cale {
namespace {

constexpr auto kDouble = torch::kFloat64;

TEST(QNetwork, ParameterCountOfTheReferencesDer) {
    const QNetwork network(EncoderConfig{.encoder = EncoderKind::phi_dqn},
                           QHeadConfig{.num_actions = 18, .num_atoms = 51, .dueling = true, .noisy = true},
                           make_generator(1));
    EXPECT_EQ(count_parameters(*network), 9'003'058);
}

// Pieces ------------------------------------------------------------------------------

TEST(ImportanceWeights, ArePowersOfTheProbabilityOverTheirLargest) {
    const auto probability = torch::tensor({0.4, 0.1, 0.025}, kDouble);
    EXPECT_TRUE(torch::allclose(importance_weights(probability, 0.5),
                                torch::tensor({0.25, 0.5, 1.0}, kDouble), 1e-6));
    EXPECT_TRUE(torch::allclose(importance_weights(probability, 1),
                                torch::tensor({0.0625, 0.25, 1.0}, kDouble), 1e-6));
    EXPECT_TRUE(torch::equal(importance_weights(probability, 0), torch::ones({3}, kDouble)));
    const auto extreme = importance_weights(torch::tensor({0.0f, 1.0f}), 3);  // the largest exponent
    EXPECT_EQ(extreme[0].item<float>(), 1);
    EXPECT_TRUE(extreme.isfinite().all().item<bool>());
}

// Losses ------------------------------------------------------------------------------

QNetwork make_network(const QHeadConfig& head, std::uint64_t seed) {
    QNetwork made(small_encoder(), head, make_generator(seed));
    made->to(kDouble);
    return made;
}

/// Two actions whose returns are distributed over -1, 0 and 1, alike everywhere.
struct Problem {
    DerConfig config = [] {
        auto settings = small_der();
        settings.num_atoms = 3;
        settings.value_limit = 1;
        settings.noisy = settings.dueling = false;
        return settings;
    }();
    // Their means are -0.3 and 0.25 of the network, 0.7 and -0.4 of the target.
    QNetwork network = constant_network({0.5, 0.3, 0.2, 0.25, 0.25, 0.5});
    QNetwork target = constant_network({0.1, 0.1, 0.8, 0.6, 0.2, 0.2});
    Batch batch{.observation = noise_frames(2, 1),
                .action = torch::tensor({0, 1}, torch::kInt64),
                .n_step_return = torch::tensor({0.5f, 0.25f}),
                .discount = torch::tensor({0.5f, 0.0f}),
                .next_observation = noise_frames(2, 2),
                .index = {}};
    torch::Tensor loss_weights = torch::ones({2}, kDouble);

    static QNetwork constant_network(const std::vector<double>& probabilities) {
        auto made = make_network({.num_actions = 2, .hidden_units = 16, .num_atoms = 3}, 1);
        std::vector<double> logits;
        for (const double probability : probabilities) logits.push_back(std::log(probability));
        make_constant(parameters_of(*made), "head.out", logits);
        return made;
    }

    DerLosses losses() { return der_losses(network, target, batch, loss_weights, {}, config); }
};

TEST(DerLosses, TheTargetIsTheProjectedDistributionOfTheActionThatTheNetworkChooses) {
    Problem p;
    // Returns 0.5 + 0.5 z = 0, 0.5 and 1 with the target's 0.6, 0.2 and 0.2 of action 1. Where the discount
    // is 0, what lies between two atoms is the reward alone.
    const auto expected = torch::tensor({{0.0, 0.7, 0.3}, {0.0, 0.75, 0.25}}, kDouble);
    EXPECT_TRUE(torch::allclose(p.losses().target, expected));
    p.config.double_dqn = false;  // now 0.1, 0.1 and 0.8 of action 0, which the target itself prefers
    EXPECT_TRUE(torch::allclose(p.losses().target[0], torch::tensor({0.0, 0.15, 0.85}, kDouble)));
    EXPECT_TRUE(torch::allclose(p.losses().target[1], expected[1]));
    p.config.replay.reward_scale = 2;
    EXPECT_TRUE(torch::allclose(p.losses().target[1], torch::tensor({0.0, 0.5, 0.5}, kDouble)));
}

TEST(DerLosses, CrossEntropyPrioritiesAndValuesByHand) {
    Problem p;
    const auto losses = p.losses();
    const double first = -(0.7 * std::log(0.3) + 0.3 * std::log(0.2));
    const double second = -(0.75 * std::log(0.25) + 0.25 * std::log(0.5));
    EXPECT_TRUE(torch::allclose(losses.per_transition, torch::tensor({first, second}, kDouble)));
    EXPECT_NEAR(losses.loss.item<double>(), (first + second) / 2, 1e-12);
    EXPECT_TRUE(torch::allclose(losses.q, torch::tensor({-0.3, 0.25}, kDouble)));
    EXPECT_TRUE(
        torch::allclose(losses.priorities, torch::tensor({std::sqrt(first), std::sqrt(second)}, kDouble)));
    p.config.priority_exponent = 1;
    EXPECT_TRUE(torch::allclose(p.losses().priorities, losses.per_transition));
    EXPECT_TRUE(losses.loss.requires_grad());
    for (const auto& tensor : {losses.per_transition, losses.priorities, losses.q, losses.target})
        EXPECT_FALSE(tensor.requires_grad());
}

TEST(DerLosses, ImportanceWeightsScaleLossesButNotPriorities) {
    Problem p;
    const auto unweighted = p.losses();
    p.loss_weights = torch::tensor({0.25, 0.0}, kDouble);
    const auto weighted = p.losses();
    EXPECT_NEAR(weighted.loss.item<double>(), 0.25 * unweighted.per_transition[0].item<double>() / 2, 1e-12);
    EXPECT_TRUE(torch::equal(weighted.priorities, unweighted.priorities));
    weighted.loss.backward();
    const auto gradient = p.network->named_parameters()["head.out.bias"].grad();
    EXPECT_GT(gradient.slice(0, 0, 3).abs().max().item<double>(), 0);
    EXPECT_EQ(gradient.slice(0, 3).abs().max().item<double>(), 0);  // the second transition's action
}

TEST(DerLosses, BothNetworksShareTheNoiseOfTheNextState) {
    const QHeadConfig head{
        .num_actions = 3, .hidden_units = 16, .num_atoms = 3, .noisy = true, .initial_sigma = 2};
    auto network = make_network(head, 1), target = make_network(head, 2);
    Problem p;
    p.config.noisy = true;
    const auto draw = [&](std::uint64_t seed) {
        return to(network->head->draw_noise(make_generator(seed)), kDouble);
    };
    const DerNoise noise{draw(3), draw(4)};
    const torch::NoGradGuard no_grad;
    const auto support = atom_support(3, 1, kDouble);
    const auto chosen =
        (network(p.batch.next_observation, &noise.target).softmax(2) * support).sum(2).argmax(1);
    const auto next = target(p.batch.next_observation, &noise.target).softmax(2);
    const auto losses = der_losses(network, target, p.batch, p.loss_weights, noise, p.config);
    const auto returns = 0.5 + 0.5 * support;
    const auto expected = project_distribution(returns.unsqueeze(0),
                                               next[0][chosen[0].item<std::int64_t>()].unsqueeze(0), support);
    EXPECT_TRUE(torch::allclose(losses.target[0], expected[0]));
    const auto of_first = network(p.batch.observation, &noise.online).log_softmax(2)[0][0];
    EXPECT_TRUE(torch::allclose(losses.per_transition[0], -(expected[0] * of_first).sum()));
}

TEST(DerLosses, WithoutADistributionTheyAreThoseOfDqn) {
    for (const bool double_dqn : {false, true}) {
        const QHeadConfig head{.num_actions = kNumActions, .hidden_units = 16};
        auto network = make_network(head, 1), target = make_network(head, 2);
        Batch batch{.observation = noise_frames(5, 1),
                    .action = torch::tensor({0, 3, 1, 1, 2}, torch::kInt64),
                    .n_step_return = torch::randn({5}, make_generator(3)),
                    .discount = torch::tensor({0.9f, 0.0f, 0.9f, 0.5f, 0.9f}),
                    .next_observation = noise_frames(5, 2),
                    .index = {}};
        DerConfig der;
        der.distributional = der.dueling = der.noisy = false;
        der.double_dqn = double_dqn;
        DqnConfig dqn;
        dqn.double_dqn = double_dqn;
        der.replay.reward_scale = dqn.replay.reward_scale = 0.7;
        const auto general = der_losses(network, target, batch, torch::ones({5}, kDouble), {}, der);
        const auto plain = dqn_losses(network, target, batch, dqn);
        EXPECT_TRUE(torch::allclose(general.loss, plain.loss));
        EXPECT_TRUE(torch::allclose(general.q, plain.q));
        EXPECT_TRUE(torch::allclose(general.target, plain.target_values));
        EXPECT_TRUE(torch::allclose(general.per_transition, (plain.q - plain.target_values).square()));
    }
}

TEST(DerLosses, ShapesThatWouldBroadcastAreRefused) {
    const ExpectRefused expect_refused{[] { return Problem(); }};
    expect_refused("the action", "[2]", "[1]",
                   [](Problem& p) { p.batch.action = p.batch.action.slice(0, 0, 1); });
    expect_refused("n-step return", "[2]", "[2, 1]",
                   [](Problem& p) { p.batch.n_step_return = p.batch.n_step_return.unsqueeze(1); });
    expect_refused("discount", "[2]", "[]", [](Problem& p) { p.batch.discount = torch::tensor(0.5f); });
    expect_refused("next observation", "[2, 2, 12, 12]", "[1, 2, 12, 12]",
                   [](Problem& p) { p.batch.next_observation = noise_frames(1, 2); });
    expect_refused("loss weights", "[2]", "[2, 1]",
                   [](Problem& p) { p.loss_weights = p.loss_weights.unsqueeze(1); });
    expect_refused("loss weights", "[2]", "none", [](Problem& p) { p.loss_weights = torch::Tensor(); });
}

TEST(DerUpdate, MovesTheNetworkTowardsTheTargetDistributionAndLeavesTheTargetAlone) {
    Problem p;
    p.config.learning_rate = 0.1;
    QState learner(p.network, p.target, {.learning_rate = 0.1, .epsilon = p.config.adam_epsilon});
    const auto before = copy_of(parameters_of(*p.target));
    const auto expected = p.losses();
    const auto first = der_update(learner, p.batch, p.loss_weights, {}, p.config);
    EXPECT_DOUBLE_EQ(first.loss.item<double>(), expected.loss.item<double>());  // from before the step
    EXPECT_FALSE(first.loss.requires_grad());
    for (int step = 0; step < 50; ++step) der_update(learner, p.batch, p.loss_weights, {}, p.config);
    const torch::NoGradGuard no_grad;
    const auto predicted = p.network(p.batch.observation)[1][1].softmax(0);
    EXPECT_TRUE(torch::allclose(predicted, expected.target[1], 0, 0.1));
    expect_equal(parameters_of(*p.target), before);
}

// Acting ------------------------------------------------------------------------------

TEST(Der, ExploresByTheNoiseInItsWeightsAloneFromTheFirstStepOn) {
    auto config = small_der();
    config.noisy_sigma = 5;
    config.epsilon = {.epsilon_train = 1, .epsilon_eval = 0};
    const auto agent = make_der(config, discrete_world());
    EXPECT_EQ(agent->metrics().at("charts/epsilon"), 0);
    std::vector<double> counts(kNumActions, 0);
    for (int call = 0; call < 200; ++call) {
        const auto actions = agent->act(same_frame(1), ActMode::train);
        ++counts[static_cast<std::size_t>(actions[0].item<std::int64_t>())];
    }
    for (const double count : counts) EXPECT_GT(count, 10);
    // Evaluation is free of it.
    const auto greedy = agent->act(same_frame(1), ActMode::evaluate);
    for (int call = 0; call < 20; ++call)
        EXPECT_TRUE(torch::equal(agent->act(same_frame(1), ActMode::evaluate), greedy));
}

TEST(Der, ARandomWarmupEndsWithTheFirstUpdates) {
    auto config = small_der();
    config.noisy_sigma = 0;  // so that nothing but the warm-up changes actions
    config.random_warmup = true;
    config.epsilon.epsilon_train = 1;  // of no use to noisy weights
    config.replay.min_replay = 200;
    const auto spec = discrete_world();
    const auto agent = make_der(config, spec);
    std::vector<double> counts(kNumActions, 0);
    for (int call = 0; call <= 200; ++call) {
        EXPECT_EQ(agent->metrics().at("charts/epsilon"), 1);
        const auto actions = agent->act(same_frame(1), ActMode::train);
        ++counts[static_cast<std::size_t>(actions[0].item<std::int64_t>())];
        drive(*agent, spec, call, 1);
    }
    EXPECT_EQ(agent->metrics().at("charts/epsilon"), 0);
    for (const double count : counts) EXPECT_GT(count, 200.0 / kNumActions / 2);
}

TEST(Der, EveryEnvironmentExploresWithANoiseOfItsOwn) {
    auto config = small_der();
    config.noisy_sigma = 5;
    const auto agent = make_der(config, discrete_world(3));
    // On one and the same frame all that differs is the noise: any two environments agree by chance alone.
    std::vector<int> agreements(3, 0);
    for (int call = 0; call < 200; ++call) {
        const auto actions = agent->act(same_frame(3), ActMode::train);
        for (const std::int64_t env : {0, 1, 2})
            agreements[static_cast<std::size_t>(env)] +=
                (actions[env] == actions[(env + 1) % 3]).item<bool>() ? 1 : 0;
    }
    for (const int agreed : agreements) EXPECT_LT(agreed, 150);
    const auto greedy = agent->act(same_frame(3), ActMode::evaluate);
    EXPECT_TRUE((greedy == greedy[0]).all().item<bool>());
}

TEST(Der, EvaluatesTheMeansOfItsDistributions) {
    auto config = small_der();
    config.num_atoms = 3;
    config.dueling = config.noisy = false;
    config.epsilon.epsilon_eval = 0;
    const auto agent = make_der(config, discrete_world());
    auto state = agent->state();
    // Action 2 has the largest mean; action 1 the likeliest best return, action 3 the largest numbers.
    make_constant(state, "network/head.out", {0, 0, 0, 2, 0, 2.5, -9, 5, 6, 20, 20, 20});
    agent->load_state(state);
    EXPECT_TRUE((agent->act(noise_frames(20, 1), ActMode::evaluate) == 2).all().item<bool>());
}

// Rhythm ------------------------------------------------------------------------------

TEST(Der, GivesItsMemoryThePrioritiesOfWhatItLearnedFrom) {
    for (const bool prioritised : {true, false}) {
        auto config = small_der();
        config.prioritised = prioritised;
        const auto spec = discrete_world();
        const auto agent = make_der(config, spec);
        drive(*agent, spec, 0, 21);
        const auto spread = [&] {
            const auto probability = memory_of(*agent).probability;
            return (probability.max() / probability.min()).item<float>();
        };
        EXPECT_FLOAT_EQ(spread(), 1);  // new ones are all alike
        drive(*agent, spec, 21, 10);
        if (prioritised)
            EXPECT_GT(spread(), 1.01f);
        else
            EXPECT_FLOAT_EQ(spread(), 1);
    }
}

TEST(Der, WithEveryComponentOffItIsDqn) {
    const auto spec = discrete_world();
    auto dqn = small_dqn();
    dqn.epsilon = {.epsilon_train = 0.1, .epsilon_decay_period = 10};
    DerConfig off = small_der();
    off.distributional = off.dueling = off.double_dqn = off.noisy = off.prioritised = false;
    off.learning_rate = dqn.learning_rate;
    off.epsilon = dqn.epsilon;
    const auto general = make_der(off, spec), plain = make_dqn(dqn, spec);
    drive(*general, spec, 0, 60);
    drive(*plain, spec, 0, 60);
    const auto state = general->state();
    for (const auto& [name, tensor] : plain->state()) {
        if (name == "random/evaluation") continue;
        EXPECT_TRUE(torch::allclose(state.at(name).to(kDouble), tensor.to(kDouble), 1e-4, 1e-6)) << name;
    }
    EXPECT_NEAR(general->metrics().at("losses/td_loss"), plain->metrics().at("losses/td_loss"), 1e-4);
}

// Learning ----------------------------------------------------------------------------

TEST(Der, LearnsWhichActionTheFrameAsksFor) {
    auto config = small_der();
    config.replay = {.min_replay = 200, .update_period = 8, .replay_capacity = 20'000, .batch_size = 32};
    config.epsilon.epsilon_eval = 0;
    config.value_limit = 2;
    config.target_update_period = 200;
    config.learning_rate = 1e-3;
    config.noisy_sigma = 0.5;  // sixteen units need more of it than 512 do to try every action
    auto spec = discrete_world(8);
    for (const auto precision : {Precision::float32, Precision::bf16}) {
        spec.precision = precision;
        EXPECT_GT(learned_after(*make_der(config, spec), spec, 300), 0.9);
    }
}

}  // namespace
}  // namespace cale
