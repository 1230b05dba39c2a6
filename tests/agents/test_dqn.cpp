#include "agents/dqn.h"

#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include "agent_worlds.h"
#include "agents/random.h"
#include "expect_refused.h"

namespace cale {
namespace {

TEST(QNetwork, ParameterCountOfTheReferencesDqn) {
    const QNetwork network(EncoderConfig{.encoder = EncoderKind::phi_dqn}, QHeadConfig{.num_actions = 18},
                           make_generator(1));
    EXPECT_EQ(count_parameters(*network), 4'052'658);
}

// Losses ------------------------------------------------------------------------------

/// Networks whose values are the same everywhere: two transitions that can be worked out by hand.
struct Problem {
    DqnConfig config = small_dqn();
    QNetwork network = constant_network({1, 5, 2, 0}), target = constant_network({10, 3, -1, 0});
    Batch batch{.observation = noise_frames(2, 1),
                .action = torch::tensor({1, 0}, torch::kInt64),
                .n_step_return = torch::tensor({1.0f, -2.0f}),
                .discount = torch::tensor({0.5f, 0.0f}),
                .next_observation = noise_frames(2, 2),
                .index = {}};

    static QNetwork constant_network(const std::vector<double>& values) {
        QNetwork made(small_encoder(), QHeadConfig{.num_actions = kNumActions, .hidden_units = 16},
                      make_generator(1));
        made->to(torch::kFloat64);
        make_constant(parameters_of(*made), "head.out", values);
        return made;
    }

    DqnLosses losses() { return dqn_losses(network, target, batch, config); }
    double loss() { return losses().loss.item<double>(); }
    double target_value(std::int64_t row) { return losses().target_values[row].item<double>(); }
};

TEST(DqnLosses, TheTargetIsTheRewardAndTheLargestOfTheTargetsValues) {
    Problem p;
    EXPECT_DOUBLE_EQ(p.target_value(0), 1 + 0.5 * 10);
    EXPECT_DOUBLE_EQ(p.target_value(1), -2);  // nothing follows where the discount is 0
    EXPECT_DOUBLE_EQ(p.losses().q[0].item<double>(), 5);
    EXPECT_DOUBLE_EQ(p.losses().q[1].item<double>(), 1);
    p.config.replay.reward_scale = 3;
    EXPECT_DOUBLE_EQ(p.target_value(0), 3 + 0.5 * 10);
    EXPECT_DOUBLE_EQ(p.target_value(1), -6);
}

TEST(DqnLosses, DoubleChoosesWithOneNetworkAndValuesWithTheOther) {
    Problem p;
    p.config.double_dqn = true;
    EXPECT_DOUBLE_EQ(p.target_value(0), 1 + 0.5 * 3);  // the network's best action is 1
    EXPECT_DOUBLE_EQ(p.target_value(1), -2);
}

TEST(DqnLosses, HuberIsLinearBeyondAnErrorOfOneAndHalfTheSquareWithin) {
    Problem p;
    p.batch.n_step_return = torch::tensor({0.25f, -2.0f});  // errors of -0.25 and 3
    EXPECT_DOUBLE_EQ(p.loss(), (0.25 * 0.25 + 9) / 2);
    p.config.loss = ValueLoss::huber;
    EXPECT_DOUBLE_EQ(p.loss(), (0.25 * 0.25 / 2 + 3 - 0.5) / 2);
}

TEST(DqnLosses, TrainTheValuesOfTheStoredActionsAndNothingElse) {
    for (const bool double_dqn : {false, true}) {
        Problem p;
        p.config.double_dqn = double_dqn;
        p.losses().loss.backward();
        // The mean of (q - y)^2 over two: 5 - 6 or 5 - 2.5, and 1 + 2.
        EXPECT_TRUE(
            torch::allclose(p.network->named_parameters()["head.out.bias"].grad(),
                            torch::tensor({3.0, double_dqn ? 2.5 : -1.0, 0.0, 0.0}, torch::kFloat64)));
        for (const auto& parameter : p.target->parameters()) EXPECT_FALSE(parameter.grad().defined());
        EXPECT_FALSE(p.losses().q.requires_grad());
        EXPECT_FALSE(p.losses().target_values.requires_grad());
    }
}

TEST(DqnLosses, ShapesThatWouldBroadcastAreRefused) {
    const ExpectRefused expect_refused{[] { return Problem(); }};
    expect_refused("the action", "[2]", "[1]",
                   [](Problem& p) { p.batch.action = p.batch.action.slice(0, 0, 1); });
    expect_refused("n-step return", "[2]", "[2, 1]",
                   [](Problem& p) { p.batch.n_step_return = p.batch.n_step_return.unsqueeze(1); });
    expect_refused("discount", "[2]", "[]", [](Problem& p) { p.batch.discount = torch::tensor(0.5f); });
    expect_refused("next observation", "[2, 2, 12, 12]", "[1, 2, 12, 12]",
                   [](Problem& p) { p.batch.next_observation = noise_frames(1, 2); });
}

TEST(DqnUpdate, MovesTheNetworkTowardsTheTargetValuesAndLeavesTheTargetAlone) {
    Problem p;
    p.config.learning_rate = 0.1;
    QState learner(p.network, p.target, {.learning_rate = 0.1, .epsilon = p.config.adam_epsilon});
    const auto before = copy_of(parameters_of(*p.target));
    const auto first = dqn_update(learner, p.batch, p.config);
    EXPECT_DOUBLE_EQ(first.loss.item<double>(), (1.0 + 9) / 2);  // from before the step
    EXPECT_FALSE(first.loss.requires_grad());
    for (int step = 0; step < 50; ++step) dqn_update(learner, p.batch, p.config);
    EXPECT_LT(p.loss(), 0.1);
    expect_equal(parameters_of(*p.target), before);
}

// Acting ------------------------------------------------------------------------------

TEST(Dqn, TakesTheMostValuableActionWhereItDoesNotExplore) {
    auto config = small_dqn();
    config.epsilon = {.epsilon_train = 0, .epsilon_eval = 0, .epsilon_decay_period = 1};
    const auto spec = discrete_world();
    const auto agent = make_dqn(config, spec);
    drive(*agent, spec, 0, 22);
    const auto state = agent->state();
    for (std::int64_t best = 0; best < kNumActions; ++best) {
        std::vector<double> values(kNumActions, -3.0);
        values[static_cast<std::size_t>(best)] = -2;
        make_constant(state, "network/head.out", values);
        agent->load_state(state);
        for (const auto mode : {ActMode::train, ActMode::evaluate})
            EXPECT_TRUE((agent->act(noise_frames(100, 1), mode) == best).all().item<bool>());
    }
}

TEST(Dqn, MakesSeveralGradientStepsPerUpdateWhereSet) {
    const auto spec = discrete_world();
    const auto steps_with = [&](std::int64_t gradient_steps) {
        auto config = small_dqn();
        config.replay.gradient_steps = gradient_steps;
        const auto agent = make_dqn(config, spec);
        drive(*agent, spec, 0, 30);
        return gradient_steps_of(*agent);
    };
    EXPECT_GT(steps_with(1), 0);
    EXPECT_EQ(steps_with(3), 3 * steps_with(1));
}

TEST(Dqn, DuelingIsAnOptionOfItsNetwork) {
    auto config = small_dqn();
    EXPECT_FALSE(make_dqn(config, discrete_world())->state().contains("network/head.value.weight"));
    config.dueling = true;
    const auto state = make_dqn(config, discrete_world())->state();
    EXPECT_TRUE(state.contains("network/head.value.weight"));
    EXPECT_TRUE(state.contains("target/head.value.weight"));
}

TEST(Dqn, WithoutPaddingItsNetworkIsThatOfMnihAndOthers) {
    AgentSpec spec;
    spec.action_space = Discrete{18};
    DqnConfig config;
    config.padding = Padding::valid;
    const auto state = make_dqn(config, spec)->state();
    for (const auto* weight : {"network/head.fc1.weight", "target/head.fc1.weight"})
        EXPECT_EQ(state.at(weight).sizes(), (std::vector<std::int64_t>{512, 64 * 7 * 7})) << weight;
}

// Learning ----------------------------------------------------------------------------

TEST(Dqn, LearnsWhichActionTheFrameAsksFor) {
    auto config = small_dqn();
    config.replay = {.min_replay = 200, .update_period = 8, .replay_capacity = 20'000, .batch_size = 32};
    config.epsilon = {.epsilon_train = 0.1, .epsilon_eval = 0, .epsilon_decay_period = 1'000};
    config.target_update_period = 200;
    config.learning_rate = 1e-3;
    const auto spec = discrete_world(8);
    EXPECT_GT(learned_after(*make_dqn(config, spec), spec, 300), 0.9);
}

}  // namespace
}  // namespace cale
