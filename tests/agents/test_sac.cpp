#include "agents/sac.h"

#include <cmath>
#include <limits>
#include <map>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/autograd.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agent_worlds.h"
#include "agents/random.h"
#include "cale/joystick.h"
#include "expect_refused.h"

namespace cale {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

// Networks ----------------------------------------------------------------------------

SacNetwork make_network(const EncoderConfig& encoder, std::uint64_t seed = 1) {
    return SacNetwork(encoder, HeadConfig{}, make_generator(seed));
}

TEST(SacNetwork, ParameterCountsOfTheReference) {
    EXPECT_EQ(count_parameters(*make_network({.encoder = EncoderKind::phi_sac})), 5'759'540);
    EXPECT_EQ(count_parameters(*make_network({.encoder = EncoderKind::phi_dqn})), 8'805'032);
    EXPECT_EQ(count_parameters(*make_network({.encoder = EncoderKind::phi_dqn, .phi_dqn = PhiDqn::row1d})),
              61'430'440);
}

TEST(SacNetwork, ActorsAndCriticsParametersMakeUpTheWhole) {
    const auto network = make_network({.observation = {4, kSide, kSide}});
    const auto actor = actor_parameters(*network), critic = critic_parameters(*network);
    EXPECT_EQ(actor.size() + critic.size(), network->parameters().size());
    EXPECT_EQ(actor.size(), 8u);  // actor_fc, actor_ln, fc1, out: weight and bias each
}

// Losses ------------------------------------------------------------------------------

struct Problem {
    SacConfig config = small_sac();
    SacNetwork network, target;
    torch::Tensor log_alpha = torch::full({1}, 0.3, torch::kFloat64).requires_grad_();
    Batch batch;
    SacNoise noise;

    Problem() : network(small_network(1)), target(small_network(2)) {
        auto random = make_generator(3);
        batch.observation = noise_frames(5, 1);
        batch.next_observation = noise_frames(5, 2);
        batch.action = torch::rand({5, 3}, random);
        batch.n_step_return = torch::randn({5}, random);
        batch.discount = torch::tensor({0.9f, 0.0f, 0.9f, 0.5f, 0.9f});
        noise = {torch::randn({5, 3}, random, torch::kFloat64),
                 torch::randn({5, 3}, random, torch::kFloat64)};
    }

    SacNetwork small_network(std::uint64_t seed) const {
        SacNetwork made(small_encoder(), HeadConfig{1, 16}, make_generator(seed));
        made->to(torch::kFloat64);
        return made;
    }

    SacLosses losses() { return sac_losses(network, target, log_alpha, batch, noise, config); }
};

TEST(SacLosses, TargetOfASampledActionIsTheOnlineActorsAsInSac) {
    const torch::NoGradGuard no_grad;
    Problem p;
    p.config.critic.target = CriticTarget::sampled_action;
    const auto next = sample(p.network->policy(p.network->encoder->trunk(p.batch.next_observation)),
                             p.noise.target, p.network->box);
    const auto z = p.target->encoder->critic_branch(p.target->encoder->trunk(p.batch.next_observation));
    const auto value = p.target->values(z, next.action).estimate(cale::TwinEstimate::minimum) -
                       std::exp(0.3) * next.log_prob;
    const auto expected =
        0.1 * p.batch.n_step_return.to(torch::kFloat64) + p.batch.discount.to(torch::kFloat64) * value;
    EXPECT_TRUE(torch::allclose(p.losses().target_values, expected));
    p.config.critic.target = CriticTarget::target_mean_action;
    EXPECT_FALSE(torch::allclose(p.losses().target_values, expected));
}

TEST(SacLosses, NothingFollowsWhereTheDiscountIsZero) {
    Problem p;
    EXPECT_NEAR(p.losses().target_values[1].item<double>(), 0.1 * p.batch.n_step_return[1].item<double>(),
                1e-12);
}

TEST(SacLosses, TheTargetMayLeaveTheEntropyOut) {
    const torch::NoGradGuard no_grad;
    Problem p;
    p.config.critic.target = CriticTarget::sampled_action;
    const auto with = p.losses().target_values;
    const auto next = sample(p.network->policy(p.network->encoder->trunk(p.batch.next_observation)),
                             p.noise.target, p.network->box);
    p.config.entropy_in_target = false;
    const auto without = p.losses();
    const auto bonus = -std::exp(0.3) * next.log_prob * p.batch.discount.to(torch::kFloat64);
    EXPECT_TRUE(torch::allclose(without.target_values, with - bonus));
    // The actor's own loss keeps it.
    p.config.entropy_in_target = true;
    EXPECT_TRUE(torch::equal(without.actor, p.losses().actor));
}

TEST(SacLosses, TheTwinsMayBeAveraged) {
    const torch::NoGradGuard no_grad;
    Problem p;
    p.config.twin_estimate = TwinEstimate::mean;
    const auto z = p.target->encoder->critic_branch(p.target->encoder->trunk(p.batch.next_observation));
    const auto next = p.target->policy(p.target->encoder->trunk(p.batch.next_observation));
    const auto q = p.target->values(z, mean_action(next, p.target->box));
    const auto soft = sample(next, p.noise.target, p.target->box).log_prob * std::exp(0.3);
    const auto expected = 0.1 * p.batch.n_step_return.to(torch::kFloat64) +
                          p.batch.discount.to(torch::kFloat64) * ((q.q1 + q.q2) / 2 - soft);
    const auto losses = p.losses();
    EXPECT_TRUE(torch::allclose(losses.target_values, expected));
    const auto features = p.network->encoder->trunk(p.batch.observation);
    const auto action = sample(p.network->policy(features), p.noise.actor, p.network->box);
    const auto values = p.network->values(p.network->encoder->critic_branch(features), action.action);
    const auto actor = (std::exp(0.3) * action.log_prob - (values.q1 + values.q2) / 2).mean();
    EXPECT_NEAR(losses.actor.item<double>(), actor.item<double>(), 1e-12);
    p.config.twin_estimate = TwinEstimate::minimum;
    EXPECT_TRUE((losses.target_values >= p.losses().target_values).all().item<bool>());
    EXPECT_LT(losses.actor.item<double>(), p.losses().actor.item<double>());
}

TEST(SacUpdate, EachLossTrainsItsOwnParameters) {
    Problem p;
    ActorCriticState<SacNetwork> learner(p.network, p.target, p.log_alpha, {});
    // Without the critics' loss, the actor's gradient is what it is with it, and vice versa.
    auto losses = p.losses();
    const auto critic = torch::autograd::grad({0.5 * losses.critic}, learner.critic, {}, true);
    const auto actor = torch::autograd::grad({losses.actor}, learner.actor, {}, true);
    sac_update(learner, p.batch, p.noise, p.config);
    for (std::size_t i = 0; i < critic.size(); ++i)
        EXPECT_TRUE(torch::allclose(learner.critic[i].grad(), critic[i]));
    for (std::size_t i = 0; i < actor.size(); ++i)
        EXPECT_TRUE(torch::allclose(learner.actor[i].grad(), actor[i]));
    for (const auto& parameter : learner.target_parameters) EXPECT_FALSE(parameter.grad().defined());
}

TEST(SacUpdate, TheLossesKeepNoGraph) {
    Problem p;
    ActorCriticState<SacNetwork> learner(p.network, p.target, p.log_alpha, {});
    const auto losses = sac_update(learner, p.batch, p.noise, p.config);
    for (const auto& loss :
         {losses.critic, losses.actor, losses.alpha, losses.q1, losses.target_values, losses.entropy})
        EXPECT_FALSE(loss.requires_grad());
}

TEST(SacLosses, ShapesThatWouldBroadcastAreRefused) {
    const ExpectRefused expect_refused{[] { return Problem(); }};
    expect_refused("n-step return", "[5]", "[5, 1]",
                   [](Problem& p) { p.batch.n_step_return = p.batch.n_step_return.unsqueeze(1); });
    expect_refused("discount", "[5]", "[]", [](Problem& p) { p.batch.discount = torch::tensor(0.9); });
    expect_refused("action", "[5, 3]", "[5, 2]",
                   [](Problem& p) { p.batch.action = p.batch.action.slice(1, 0, 2); });
    expect_refused("actor's noise", "[5, 3]", "[1, 3]",
                   [](Problem& p) { p.noise.actor = p.noise.actor.slice(0, 0, 1); });
    expect_refused("target's noise", "[5, 3]", "none", [](Problem& p) { p.noise.target = torch::Tensor(); });
    expect_refused("next observation", "[5, 2, 12, 12]", "[4, 2, 12, 12]",
                   [](Problem& p) { p.batch.next_observation = noise_frames(4, 1); });
    expect_refused("log_alpha", "[1]", "[]",
                   [](Problem& p) { p.log_alpha = torch::zeros({}, torch::requires_grad()); });
}

// Acting ------------------------------------------------------------------------------

TEST(Sac, ActsUniformlyInTheBoxUntilItsFirstUpdate) {
    const auto agent = make_sac(small_sac(), joystick_world(1000));
    expect_uniform_over_the_box(agent->act(noise_frames(1000, 1), ActMode::train));
}

TEST(Sac, SamplesItsPolicyOnceWarmAndActsOnItsMeanInEvaluation) {
    const auto spec = joystick_world();
    const auto agent = make_sac(small_sac(), spec);
    drive(*agent, spec, 0, 40);
    const auto mean = agent->act(same_frame(500), ActMode::evaluate);
    EXPECT_TRUE(torch::allclose(mean, mean[0].expand_as(mean), 1e-5, 1e-5));
    const auto sampled = agent->act(same_frame(500), ActMode::train);
    EXPECT_GT(sampled.select(1, 0).std().item<float>(), 0.1f);
    // A nearly untrained policy: u is close to N(0, 1), so its median is tanh's centre.
    EXPECT_NEAR(sampled.select(1, 0).median().item<float>(), mean[0][0].item<float>(), 0.1);
    EXPECT_FALSE(agent->metrics().contains("charts/epsilon"));
}

TEST(Sac, LogsAlphaItself) {
    const auto spec = joystick_world();
    const auto agent = make_sac(small_sac(), spec);
    drive(*agent, spec, 0, 30);
    const auto log_alpha = agent->state().at("log_alpha").item<float>();
    EXPECT_NE(log_alpha, 0);
    EXPECT_FLOAT_EQ(static_cast<float>(agent->metrics().at("losses/alpha")), std::exp(log_alpha));
}

// Options -----------------------------------------------------------------------------

TEST(Sac, AlphaStartsAndLearnsAsItIsTold) {
    const auto spec = joystick_world();
    auto config = small_sac();
    config.initial_alpha = 0.01;
    config.alpha_learning_rate = 0;
    const auto fixed = make_sac(config, spec);
    drive(*fixed, spec, 0, 30);
    EXPECT_FLOAT_EQ(fixed->state().at("log_alpha").item<float>(), std::log(0.01F));
    // Its first step of Adam is one learning rate long.
    config.alpha_learning_rate = 0.5;
    config.adam_epsilon = 1e-8;
    const auto quick = make_sac(config, spec);
    for (std::int64_t step = 0; gradient_steps_of(*quick) == 0; ++step) drive(*quick, spec, step, 1);
    EXPECT_NEAR(std::abs(quick->state().at("log_alpha").item<float>() - std::log(0.01F)), 0.5, 1e-4);
}

TEST(Sac, RandomActionsMayBeTheWorldsEvents) {
    auto config = small_sac();
    config.random_actions = RandomActions::events;
    auto spec = joystick_world(1000);
    EXPECT_THAT([&] { check_settings(config, spec); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("agent.random_actions")));
    EXPECT_THAT([&] { make_sac(config, spec); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("agent.random_actions")));
    spec.action_space = joystick_space(Joystick::cartesian);
    const auto actions = make_sac(config, spec)->act(noise_frames(1000, 1), ActMode::train);
    std::map<Event, int> events;
    for (std::int64_t i = 0; i < 1000; ++i) {
        const auto* const action = actions.const_data_ptr<float>() + 3 * i;
        ++events[joystick_event(stick(Joystick::cartesian, {action, 3}), 0.5F)];
    }
    EXPECT_EQ(events.size(), 18U);
    for (const auto& [event, count] : events) EXPECT_NEAR(count, 1000.0 / 18, 30) << event_name(event);
    // In evaluations they are anywhere in the box, as those of a policy file.
    config.exploration = Exploration::epsilon_greedy;
    config.epsilon.epsilon_eval = 1;
    const auto evaluated = make_sac(config, spec)->act(noise_frames(1000, 1), ActMode::evaluate);
    EXPECT_GT(std::get<0>(at::_unique(evaluated.select(1, 0))).numel(), 900);
}

TEST(Sac, ActsWithItsTargetWhereItIsTold) {
    const auto spec = joystick_world();
    for (const bool with_target : {false, true}) {
        auto config = small_sac();
        config.act_with_target = with_target;
        const auto agent = make_sac(config, spec);
        auto state = agent->state();
        make_constant(state, "network/actor.out", {-1, 0, 0, 0, 0, 0});
        make_constant(state, "target/actor.out", {1, 0, 0, 0, 0, 0});
        agent->load_state(state);
        const auto radius = agent->act(same_frame(1), ActMode::evaluate)[0][0].item<float>();
        EXPECT_NEAR(radius, 0.5 + 0.5 * std::tanh(with_target ? 1 : -1), 1e-6);
        const auto policy = agent->policy();  // what a policy file has
        EXPECT_EQ(policy->weights.at("actor.out.bias")[0].item<float>(), with_target ? 1 : -1);
    }
}

TEST(Sac, LayerNormStandsBehindEveryDenseLayerButTheLast) {
    auto config = small_sac();
    config.network.layer_norm = true;
    const auto state = make_sac(config, joystick_world())->state();
    for (const auto* head : {"actor", "critic.q1", "critic.q2"}) {
        EXPECT_TRUE(state.contains("network/" + std::string(head) + ".ln1.weight")) << head;
        EXPECT_FALSE(state.contains("network/" + std::string(head) + ".ln2.weight")) << head;
    }
    EXPECT_FALSE(make_sac(small_sac(), joystick_world())->state().contains("network/actor.ln1.weight"));
}

// Learning ----------------------------------------------------------------------------

TEST(Sac, LearnsToPushTheJoystickWhereTheFrameSays) {
    auto config = small_sac();
    config.network.hidden_units = 64;
    config.replay = {.min_replay = 200, .update_period = 8, .replay_capacity = 20'000, .batch_size = 32};
    config.replay.reward_scale = 10;  // so that the reward outweighs the entropy from the start
    config.learning_rate = 1e-3;
    config.tau = 0.02;
    auto spec = joystick_world(8);
    for (const auto precision : {Precision::float32, Precision::bf16}) {
        spec.precision = precision;
        EXPECT_GT(learned_after(*make_sac(config, spec), spec, 600), kSacLearned);
    }
}

}  // namespace
}  // namespace cale
