// The first update of every agent with a replay, made once more by hand: from settings to what is sampled,
// shifted, drawn, weighed and learned. The losses themselves are held by the golden tests.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agent_worlds.h"
#include "agents/critic.h"
#include "agents/random.h"
#include "cale/joystick.h"
#include "policy/network_text.h"
#include "replay/random_shift.h"
#include "replay/replay_buffer.h"

namespace cale {
namespace {

constexpr std::int64_t kMinReplay = 30;

/// Settings of which none is a default's.
ReplaySettings unusual_replay() {
    auto settings = small_replay();
    settings.min_replay = kMinReplay;
    settings.update_horizon = 3;
    settings.gamma = 0.5;
    settings.reward_clip = 1.5;
    settings.reward_scale = 0.7;
    settings.random_shift = 2;
    return settings;
}

/// The agent's memory, and the streams that its updates draw from (agents/off_policy.cpp) from their start.
struct Sampler {
    Sampler(Agent& agent, const AgentSpec& spec)
        : replay(dynamic_cast<ReplayBuffer&>(*agent.replay())),
          engine(stream_seed(spec.seed, 2)),
          updates(make_generator(stream_seed(spec.seed, 3))) {}

    Batch sample(const ReplaySettings& settings) {
        auto batch = replay.empty_batch(settings.batch_size);
        replay.sample_into(batch, engine);
        batch.observation = random_shift(batch.observation, settings.random_shift, updates);
        batch.next_observation = random_shift(batch.next_observation, settings.random_shift, updates);
        return batch;
    }

    ReplayBuffer& replay;
    std::mt19937_64 engine;
    at::Generator updates;
};

void load(const torch::nn::Module& module, const TensorMap& state, const std::string& prefix) {
    const auto stored = part_of(state, prefix);
    const auto parameters = parameters_of(module);
    ASSERT_EQ(parameters.size(), stored.size()) << prefix;
    for (const auto& [name, parameter] : parameters) parameter.copy_(stored.at(name));
}

void expect_close(const torch::nn::Module& module, const TensorMap& state, const std::string& prefix) {
    const auto stored = part_of(state, prefix);
    for (const auto& [name, parameter] : parameters_of(module))
        EXPECT_TRUE(torch::allclose(parameter, stored.at(name), 1e-5, 1e-7)) << prefix << name;
}

/// A network and its target, each made by `make`, with the parameters of the agent's.
template <class Make>
auto pair_of(const Make& make, const TensorMap& state) {
    std::pair networks{make(), make()};
    load(*networks.first, state, "network/");
    load(*networks.second, state, "target/");
    return networks;
}

/// By hand everything is on the CPU, so the agent is, too.
AgentSpec on_the_cpu(AgentSpec spec) {
    spec.device = torch::kCPU;
    return spec;
}

/// Drives the agent to its first update; returns its state there.
TensorMap at_first_update(Agent& agent, const AgentSpec& spec) {
    for (std::int64_t step = 0; agent.replay()->add_count() <= kMinReplay; ++step)
        drive(agent, spec, step, 1);
    EXPECT_EQ(gradient_steps_of(agent), 0);
    return agent.state();
}

void update(Agent& agent, const AgentSpec& spec) {
    EXPECT_TRUE(agent.update(NoiseStep(spec, 0).observations));
    EXPECT_EQ(gradient_steps_of(agent), 1);
}

/// A step in which the size of a gradient counts, not only its sign.
constexpr double kLearningRate = 0.01, kAdamEpsilon = 0.05, kWeightDecay = 0.1;

template <class Config>
Config with_optimiser(Config config) {
    config.learning_rate = kLearningRate;
    config.adam_epsilon = kAdamEpsilon;
    config.weight_decay = kWeightDecay;
    return config;
}

const AdamConfig kAdam{.learning_rate = kLearningRate, .epsilon = kAdamEpsilon, .weight_decay = kWeightDecay};

TEST(UpdatesByHand, OfTheMemory) {
    auto config = small_dqn();
    config.replay = unusual_replay();
    const auto spec = on_the_cpu(discrete_world());
    const auto agent = make_dqn(config, spec);
    drive(*agent, spec, 0, 10);
    // Rewards -2 -1 0 1 2 -2 -1, clipped to 1.5; the seventh step is the last of its episode. Each discounts
    // by a half.
    const auto memory = memory_of(*agent);
    const std::vector<float> clipped{-1.5f, -1, 0, 1, 1.5f, -1.5f, -1};
    ASSERT_GE(memory.index.size(0), 7);
    for (std::size_t i = 0; i < 7; ++i) {
        float expected = 0, factor = 1;
        for (std::size_t j = i; j < std::min<std::size_t>(i + 3, 7); ++j, factor /= 2)
            expected += factor * clipped[j];
        const auto at = static_cast<std::int64_t>(i);
        EXPECT_FLOAT_EQ(memory.n_step_return[at].item<float>(), expected) << i;
        EXPECT_FLOAT_EQ(memory.discount[at].item<float>(), i < 4 ? 0.125f : 0.0f) << i;
    }
}

TEST(UpdatesByHand, OfDqn) {
    auto config = with_optimiser(small_dqn());
    config.replay = unusual_replay();
    config.layer_norm = config.dueling = config.double_dqn = true;
    const auto spec = on_the_cpu(discrete_world());
    const auto agent = make_dqn(config, spec);
    const auto before = at_first_update(*agent, spec);
    const QHeadConfig head{
        .num_actions = kNumActions, .hidden_units = 16, .dueling = true, .layer_norm = true};
    const auto [network, target] =
        pair_of([&] { return QNetwork(small_encoder(), head, make_generator(1)); }, before);
    QState by_hand(network, target, kAdam);
    const auto losses = dqn_update(by_hand, Sampler(*agent, spec).sample(config.replay), config);

    update(*agent, spec);
    expect_close(*network, agent->state(), "network/");
    EXPECT_NEAR(agent->metrics().at("losses/td_loss"), losses.loss.item<double>(), 1e-5);
    EXPECT_NEAR(agent->metrics().at("losses/q_values"), losses.q.mean().item<double>(), 1e-5);
}

TEST(UpdatesByHand, OfDerWithTheJoystick) {
    auto config = with_optimiser(small_der());
    config.replay = unusual_replay();
    config.layer_norm = true;
    config.importance_exponent = 1;
    config.priority_exponent = 0.25;
    config.num_atoms = 7;
    config.value_limit = 3;
    auto spec = on_the_cpu(discrete_world());
    spec.action_space = joystick_space(Joystick::factored);
    const auto agent = make_der(config, spec);
    const auto before = at_first_update(*agent, spec);

    Sampler sampler(*agent, spec);
    const auto stored = memory_of(*agent).index;
    const auto uneven = torch::arange(1, stored.size(0) + 1, torch::kFloat64);
    sampler.replay.set_priorities(stored, uneven);

    const QHeadConfig head{.num_actions = 18,
                           .hidden_units = 16,
                           .num_atoms = 7,
                           .dueling = true,
                           .noisy = true,
                           .value_limit = 3,
                           .factors = {3, 3, 2},
                           .layer_norm = true};
    const auto [network, target] =
        pair_of([&] { return QNetwork(small_encoder(), head, make_generator(1)); }, before);
    QState by_hand(network, target, kAdam);
    const auto batch = sampler.sample(config.replay);
    EXPECT_GT((batch.probability.max() / batch.probability.min()).item<double>(), 1.5);
    const auto weights = 1 / (batch.probability + 1e-10);
    const auto online = network->head->draw_noise(sampler.updates),
               next = network->head->draw_noise(sampler.updates);
    const auto losses = der_update(by_hand, batch, weights / weights.max(), {online, next}, config);

    update(*agent, spec);
    expect_close(*network, agent->state(), "network/");
    const auto metrics = agent->metrics();
    EXPECT_NEAR(metrics.at("losses/cross_entropy"), losses.per_transition.mean().item<double>(), 1e-5);
    EXPECT_NEAR(metrics.at("losses/q_values"), losses.q.mean().item<double>(), 1e-5);
    EXPECT_NEAR(metrics.at("charts/gradient_norm"), gradient_norm(network->parameters()).value(), 1e-4);

    // Each sampled transition has the fourth root of its loss, where it was sampled first.
    std::map<std::int64_t, double> priorities;
    for (std::int64_t i = 0; i < config.replay.batch_size; ++i)
        priorities.emplace(batch.index[i].item<std::int64_t>(),
                           std::pow(losses.per_transition[i].item<double>(), 0.25));
    for (std::int64_t i = 0; i < stored.size(0); ++i)
        priorities.emplace(stored[i].item<std::int64_t>(), uneven[i].item<double>());
    double sum = 0;
    for (const auto& [index, priority] : priorities) sum += priority;
    const auto after = memory_of(*agent);
    for (std::int64_t i = 0; i < stored.size(0); ++i)
        EXPECT_NEAR(after.probability[i].item<double>(),
                    priorities.at(after.index[i].item<std::int64_t>()) / sum, 1e-6);
}

TEST(UpdatesByHand, OfSacWithTheOptionsOfItsNetworksAndItsReplay) {
    auto config = with_optimiser(small_sac());
    config.replay = unusual_replay();
    config.network.layer_norm = true;
    config.network.hidden_layers = 2;
    config.critic.target = CriticTarget::sampled_action;
    config.critic.atoms = 7;
    config.critic.limit = 3;
    config.initial_alpha = 0.3;
    config.alpha_learning_rate = 0.02;
    config.tau = 0.25;
    auto spec = on_the_cpu(joystick_world());
    spec.action_space = joystick_space(Joystick::cartesian);
    const auto agent = make_sac(config, spec);
    const auto before = at_first_update(*agent, spec);

    const ActionBox box{torch::tensor({0.0f, 0.0f, 0.5f}), torch::tensor({1.0f, 1.0f, 0.5f}), std::log(0.5)};
    auto encoder = small_encoder();
    encoder.layer_norm = true;
    const HeadConfig head{.hidden_layers = 2, .hidden_units = 16, .layer_norm = true};
    const auto support = torch::linspace(-3, 3, 7);
    const auto [network, target] =
        pair_of([&] { return SacNetwork(encoder, head, make_generator(1), box, support); }, before);
    ActorCriticState<SacNetwork> by_hand(network, target, torch::tensor({std::log(0.3f)}).requires_grad_(),
                                         kAdam, AdamConfig{.learning_rate = 0.02, .epsilon = kAdamEpsilon});
    Sampler sampler(*agent, spec);
    const auto batch = sampler.sample(config.replay);
    const auto noise = torch::randn({2, config.replay.batch_size, 3}, sampler.updates);
    const auto losses = sac_update(by_hand, batch, {noise[0], noise[1]}, config);

    update(*agent, spec);
    const auto after = agent->state();
    expect_close(*network, after, "network/");
    expect_close(*target, after, "target/");
    EXPECT_TRUE(torch::allclose(after.at("log_alpha"), by_hand.log_alpha.detach(), 1e-5, 1e-7));
    const auto metrics = agent->metrics();
    for (const auto& [tag, expected] :
         std::map<std::string, torch::Tensor>{{"losses/qf_loss", losses.critic},
                                              {"losses/qf1_values", losses.q1},
                                              {"losses/qf2_values", losses.q2},
                                              {"losses/target_values", losses.target_values},
                                              {"losses/actor_loss", losses.actor},
                                              {"losses/alpha_loss", losses.alpha},
                                              {"losses/entropy", losses.entropy},
                                              {"losses/alpha", by_hand.log_alpha.exp()},
                                              {"charts/mean_log_std", losses.policy.log_std}})
        EXPECT_NEAR(metrics.at(tag), expected.mean().item<double>(), 1e-4) << tag;
    EXPECT_NEAR(metrics.at("charts/critic_gradient_norm"), gradient_norm(critic_parameters(*network)).value(),
                1e-4);
    EXPECT_NEAR(metrics.at("charts/actor_gradient_norm"), gradient_norm(actor_parameters(*network)).value(),
                1e-4);
}

TEST(UpdatesByHand, OfSacd) {
    auto config = with_optimiser(small_sacd());
    config.replay = unusual_replay();
    config.target_entropy_scale = 0.5;
    config.initial_alpha = 0.3;
    const auto spec = on_the_cpu(discrete_world());
    const auto agent = make_sacd(config, spec);
    const auto before = at_first_update(*agent, spec);
    const HeadConfig head{.hidden_units = 16};
    const auto [network, target] =
        pair_of([&] { return SacdNetwork(small_encoder(), head, kNumActions, make_generator(1)); }, before);
    ActorCriticState<SacdNetwork> by_hand(
        network, target, torch::tensor({std::log(0.3f)}).requires_grad_(), kAdam,
        AdamConfig{.learning_rate = kLearningRate, .epsilon = kAdamEpsilon});
    const auto losses =
        sacd_update(by_hand, Sampler(*agent, spec).sample(config.replay), 0.5 * std::log(4.0), config);

    update(*agent, spec);
    expect_close(*network, agent->state(), "network/");
    EXPECT_TRUE(torch::allclose(agent->state().at("log_alpha"), by_hand.log_alpha.detach(), 1e-5, 1e-7));
    EXPECT_NEAR(agent->metrics().at("losses/qf2_values"), losses.q2.mean().item<double>(), 1e-4);
}

TEST(InitialNetworks, LastLayersOfSacAndSacdStartAtZeroWhereTheyAreToldTo) {
    for (const bool zero : {true, false}) {
        auto sac = small_sac();
        auto sacd = small_sacd();
        sac.zero_outputs = sacd.zero_outputs = zero;
        for (const auto& state :
             {make_sac(sac, joystick_world())->state(), make_sacd(sacd, discrete_world())->state()})
            for (const auto* layer : {"actor.out.weight", "critic.q1.out.weight", "critic.q2.out.weight"})
                EXPECT_EQ(state.at(std::string("network/") + layer).any().item<bool>(), !zero) << layer;
    }
}

TEST(InitialNetworks, ThatEvaluateAreWhatTheSettingsSay) {
    auto config = small_der();
    config.layer_norm = config.noisy_evaluation = true;
    config.dueling = config.distributional = false;
    auto spec = on_the_cpu(discrete_world());
    spec.action_space = joystick_space(Joystick::factored);
    EXPECT_THAT(
        network_text(make_der(config, spec)->policy()->network),
        testing::EndsWith(
            "dense head.fc1 16 noisy; layer_norm head.ln1; relu; values 18 1 10 noisy factors 3 3 2"));
    auto by_rows = small_sac();
    by_rows.network.phi_dqn = PhiDqn::row1d;
    EXPECT_THAT(network_text(make_sac(by_rows, joystick_world())->policy()->network),
                testing::HasSubstr("conv encoder.conv1 32 8 4 rows"));
}

}  // namespace
}  // namespace cale
