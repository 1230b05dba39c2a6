#include "agents/sac.h"

#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <ATen/Parallel.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>
#include <unistd.h>

#include "agents/random.h"

namespace cale {
namespace {

constexpr std::int64_t kSide = 12;
constexpr auto kPixels = static_cast<std::size_t>(kSide * kSide);

/// Small and quick: 12x12 frames, 2 of them stacked.
AgentSpec small_world(std::int64_t num_envs = 1, std::uint64_t seed = 1) {
    AgentSpec spec;
    spec.num_envs = num_envs;
    spec.stack = 2;
    spec.frame_height = kSide;
    spec.frame_width = kSide;
    spec.seed = seed;
    return spec;
}

SacConfig small_agent() {
    SacConfig config;
    config.network.encoder = EncoderKind::phi_dqn;
    config.network.hidden_units = 16;
    config.replay.min_replay = 20;
    config.replay.update_period = 1;
    config.replay.replay_capacity = 1000;
    config.replay.batch_size = 8;
    return config;
}

torch::Tensor noise_frames(std::int64_t count, std::uint64_t seed) {
    return torch::randint(0, 256, {count, 2, kSide, kSide}, make_generator(seed), torch::kUInt8);
}

/// Drives an agent through frames of noise; everything follows from the seed and the step.
void drive(Agent& agent, const AgentSpec& spec, std::int64_t first_step, std::int64_t steps) {
    for (std::int64_t step = first_step; step < first_step + steps; ++step) {
        const auto observations = noise_frames(spec.num_envs, static_cast<std::uint64_t>(step));
        agent.update(observations);
        const auto actions = agent.act(observations, ActMode::train);
        const auto newest = observations.select(1, 1).contiguous();
        std::vector<StepResult> results(static_cast<std::size_t>(spec.num_envs));
        for (auto& result : results) {
            result.reward = static_cast<float>(step % 3);
            result.terminal = result.episode_over = step % 7 == 6;
        }
        const std::span<const std::uint8_t> frames(newest.data_ptr<std::uint8_t>(),
                                                   static_cast<std::size_t>(newest.numel()));
        agent.observe({frames, actions, results, frames});
    }
}

void expect_equal(const TensorMap& first, const TensorMap& second) {
    ASSERT_EQ(first.size(), second.size());
    for (const auto& [name, tensor] : first) EXPECT_TRUE(torch::equal(tensor, second.at(name))) << name;
}

double updates_of(Agent& agent) {
    return agent.state().at("adam/steps").item<double>();
}

// Networks ----------------------------------------------------------------------------

SacNetwork make_network(const EncoderConfig& encoder, std::uint64_t seed = 1) {
    return SacNetwork(encoder, HeadConfig{}, make_generator(seed));
}

std::int64_t count(const SacNetwork& network) {
    std::int64_t sum = 0;
    for (const auto& parameter : network->parameters()) sum += parameter.numel();
    return sum;
}

TEST(SacNetwork, ParameterCountsOfTheReference) {
    EXPECT_EQ(count(make_network({.encoder = EncoderKind::phi_sac})), 5'759'540);
    EXPECT_EQ(count(make_network({.encoder = EncoderKind::phi_dqn})), 8'805'032);
    EXPECT_EQ(count(make_network({.encoder = EncoderKind::phi_dqn, .phi_dqn = PhiDqn::row1d})), 61'430'440);
}

TEST(SacNetwork, ActorsAndCriticsParametersMakeUpTheWhole) {
    const auto network = make_network({.frame_height = kSide, .frame_width = kSide});
    const auto actor = actor_parameters(*network), critic = critic_parameters(*network);
    EXPECT_EQ(actor.size() + critic.size(), network->parameters().size());
    EXPECT_EQ(actor.size(), 8u);  // actor_fc, actor_ln, fc1, out: weight and bias each
}

// Losses ------------------------------------------------------------------------------

struct Problem {
    SacConfig config = small_agent();
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
        SacNetwork made(EncoderConfig{EncoderKind::phi_dqn, PhiDqn::conv2d, 2, kSide, kSide},
                        HeadConfig{1, 16}, make_generator(seed));
        made->to(torch::kFloat64);
        return made;
    }

    SacLosses losses() { return sac_losses(network, target, log_alpha, batch, noise, config); }
};

TEST(SacLosses, TargetOfASampledActionIsTheOnlineActorsAsInSac) {
    const torch::NoGradGuard no_grad;
    Problem p;
    p.config.critic_target = CriticTarget::sampled_action;
    const auto next = sample(p.network->policy(p.network->encoder->trunk(p.batch.next_observation)),
                             p.noise.target, p.network->box);
    const auto z = p.target->encoder->critic_branch(p.target->encoder->trunk(p.batch.next_observation));
    const auto value = p.target->values(z, next.action).minimum() - std::exp(0.3) * next.log_prob;
    const auto expected =
        0.1 * p.batch.n_step_return.to(torch::kFloat64) + p.batch.discount.to(torch::kFloat64) * value;
    EXPECT_TRUE(torch::allclose(p.losses().target_values, expected));
    p.config.critic_target = CriticTarget::target_mean_action;
    EXPECT_FALSE(torch::allclose(p.losses().target_values, expected));
}

TEST(SacLosses, NothingFollowsWhereTheDiscountIsZero) {
    Problem p;
    EXPECT_NEAR(p.losses().target_values[1].item<double>(), 0.1 * p.batch.n_step_return[1].item<double>(),
                1e-12);
}

TEST(SacUpdate, EachLossTrainsItsOwnParameters) {
    Problem p;
    SacLearner learner(p.network, p.target, p.log_alpha, {});
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
    SacLearner learner(p.network, p.target, p.log_alpha, {});
    const auto losses = sac_update(learner, p.batch, p.noise, p.config);
    for (const auto& loss :
         {losses.critic, losses.actor, losses.alpha, losses.q1, losses.target_values, losses.log_prob})
        EXPECT_FALSE(loss.requires_grad());
}

TEST(SacLosses, ShapesThatWouldBroadcastAreRefused) {
    const auto message = [](auto&& change) -> std::string {
        Problem p;
        change(p);
        try {
            p.losses();
        } catch (const std::invalid_argument& error) {
            return error.what();
        }
        return "accepted";
    };
    using testing::HasSubstr;
    EXPECT_THAT(message([](Problem& p) { p.batch.n_step_return = p.batch.n_step_return.unsqueeze(1); }),
                testing::AllOf(HasSubstr("n-step return"), HasSubstr("[5]"), HasSubstr("[5, 1]")));
    EXPECT_THAT(message([](Problem& p) { p.batch.discount = torch::tensor(0.9); }), HasSubstr("discount"));
    EXPECT_THAT(message([](Problem& p) { p.batch.action = p.batch.action.slice(1, 0, 2); }),
                HasSubstr("action"));
    EXPECT_THAT(message([](Problem& p) { p.noise.actor = p.noise.actor.slice(0, 0, 1); }),
                HasSubstr("actor's noise"));
    EXPECT_THAT(message([](Problem& p) { p.noise.target = torch::Tensor(); }), HasSubstr("none"));
    EXPECT_THAT(message([](Problem& p) { p.batch.next_observation = noise_frames(4, 1); }),
                HasSubstr("next observation"));
    EXPECT_THAT(message([](Problem& p) { p.log_alpha = torch::zeros({}, torch::requires_grad()); }),
                HasSubstr("log_alpha"));
}

// Acting ------------------------------------------------------------------------------

TEST(Sac, ActsUniformlyInTheBoxUntilItsFirstUpdate) {
    const auto spec = small_world(1000);
    const auto agent = make_sac(small_agent(), spec);
    const auto actions = agent->act(noise_frames(1000, 1), ActMode::train);
    ASSERT_EQ(actions.sizes(), (std::vector<std::int64_t>{1000, 3}));
    ASSERT_EQ(actions.scalar_type(), torch::kFloat32);
    constexpr auto pi = static_cast<float>(std::numbers::pi);
    const float low[] = {0, -pi, 0}, high[] = {1, pi, 1};
    for (std::int64_t i = 0; i < 3; ++i) {
        const auto scaled = (actions.select(1, i) - low[i]) / (high[i] - low[i]);
        EXPECT_GE(scaled.min().item<float>(), 0);
        EXPECT_LE(scaled.max().item<float>(), 1);
        const auto histogram = torch::histc(scaled, 5, 0, 1) / 1000;
        EXPECT_LT((histogram - 0.2).abs().max().item<float>(), 0.05) << "coordinate " << i;
    }
    const auto centred = actions - actions.mean(0);
    const auto correlation = torch::corrcoef(centred.t()) - torch::eye(3);
    EXPECT_LT(correlation.abs().max().item<float>(), 0.15);
}

TEST(Sac, SamplesItsPolicyOnceWarmAndActsOnItsMeanInEvaluation) {
    const auto spec = small_world();
    const auto agent = make_sac(small_agent(), spec);
    drive(*agent, spec, 0, 40);
    const auto same = noise_frames(1, 3).expand({500, 2, kSide, kSide}).contiguous();
    const auto mean = agent->act(same, ActMode::evaluate);
    EXPECT_TRUE(torch::allclose(mean, mean[0].expand_as(mean), 1e-5, 1e-5));
    const auto sampled = agent->act(same, ActMode::train);
    EXPECT_GT(sampled.select(1, 0).std().item<float>(), 0.1f);
    // A nearly untrained policy: u is close to N(0, 1), so its median is tanh's centre.
    EXPECT_NEAR(sampled.select(1, 0).median().item<float>(), mean[0][0].item<float>(), 0.1);
}

TEST(Sac, EpsilonGreedyActsUniformlyWithProbabilityEpsilon) {
    auto config = small_agent();
    config.exploration = Exploration::epsilon_greedy;
    config.epsilon.epsilon_train = 0.25;
    config.epsilon.epsilon_eval = 0.5;
    config.epsilon.epsilon_decay_period = 1;
    const auto spec = small_world();
    const auto agent = make_sac(config, spec);
    drive(*agent, spec, 0, 40);
    EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 0.25);
    const auto same = noise_frames(1, 3).expand({2000, 2, kSide, kSide}).contiguous();
    const auto actions = agent->act(same, ActMode::evaluate);
    // Those that are not the mean action are random.
    const auto mean = std::get<0>(actions.select(1, 0).mode());
    const double random =
        ((actions.select(1, 0) - mean).abs() > 1e-4).to(torch::kFloat64).mean().item<double>();
    EXPECT_NEAR(random, 0.5, 0.06);
}

TEST(Sac, EpsilonIsOneDuringTheWarmUp) {
    auto config = small_agent();
    config.exploration = Exploration::epsilon_greedy;
    config.epsilon.epsilon_train = 0;
    config.epsilon.epsilon_decay_period = 10;
    const auto spec = small_world();
    const auto agent = make_sac(config, spec);
    EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 1);
    drive(*agent, spec, 0, 20);
    EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 1);
    drive(*agent, spec, 20, 5);
    EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 0.5);
}

TEST(Sac, EvaluationLeavesTrainingAsItIs) {
    auto config = small_agent();
    config.exploration = Exploration::epsilon_greedy;
    const auto spec = small_world();
    const auto disturbed = make_sac(config, spec), undisturbed = make_sac(config, spec);
    drive(*disturbed, spec, 0, 25);
    for (int i = 0; i < 3; ++i) disturbed->act(noise_frames(7, 9), ActMode::evaluate);
    drive(*disturbed, spec, 25, 10);
    drive(*undisturbed, spec, 0, 35);
    auto first = disturbed->state(), second = undisturbed->state();
    EXPECT_FALSE(torch::equal(first.at("random/evaluation"), second.at("random/evaluation")));
    first.erase("random/evaluation");
    second.erase("random/evaluation");
    expect_equal(first, second);
}

// Rhythm ------------------------------------------------------------------------------

TEST(Sac, UpdatesOnceMoreThanMinReplayIsStoredAndEveryPeriod) {
    auto config = small_agent();
    config.replay.update_period = 4;
    const auto spec = small_world();
    const auto agent = make_sac(config, spec);
    drive(*agent, spec, 0, 21);  // 21 stored: more than 20 for the first time
    EXPECT_EQ(updates_of(*agent), 0);
    drive(*agent, spec, 21, 3);  // decisions 21, 22, 23
    EXPECT_EQ(updates_of(*agent), 0);
    drive(*agent, spec, 24, 1);
    EXPECT_EQ(updates_of(*agent), 1);
    drive(*agent, spec, 25, 40);
    EXPECT_EQ(updates_of(*agent), 11);
}

TEST(Sac, SeveralEnvironmentsKeepTheUpdatesPerAgentStep) {
    for (const auto& [num_envs, period, expected] : {std::tuple{8, 4, 40}, {3, 4, 15}, {2, 1, 40}}) {
        auto config = small_agent();
        config.replay.min_replay = 0;
        config.replay.update_period = period;
        const auto spec = small_world(num_envs);
        const auto agent = make_sac(config, spec);
        drive(*agent, spec, 0, 5);  // until something is stored
        const double before = updates_of(*agent);
        drive(*agent, spec, 5, 20);
        EXPECT_NEAR(updates_of(*agent) - before, expected, 1) << num_envs << " environments";
    }
}

TEST(Sac, TheTargetFollowsByTau) {
    auto config = small_agent();
    config.tau = 1;
    const auto spec = small_world();
    const auto agent = make_sac(config, spec);
    const auto start = agent->state();
    EXPECT_TRUE(
        torch::equal(start.at("network/critic.q1.out.weight"), start.at("target/critic.q1.out.weight")));
    drive(*agent, spec, 0, 30);
    const auto state = agent->state();
    EXPECT_FALSE(
        torch::equal(state.at("network/critic.q1.out.weight"), start.at("network/critic.q1.out.weight")));
    EXPECT_TRUE(
        torch::equal(state.at("network/critic.q1.out.weight"), state.at("target/critic.q1.out.weight")));
}

TEST(Sac, RewardsAreClippedWhenStored) {
    const auto spec = small_world();
    const auto trained_with = [&](std::optional<double> clip) {
        auto config = small_agent();
        config.replay.reward_clip = clip;
        const auto agent = make_sac(config, spec);
        drive(*agent, spec, 0, 30);  // rewards 0, 1, 2
        return agent->state();
    };
    expect_equal(trained_with(std::nullopt), trained_with(2.0));
    EXPECT_FALSE(torch::equal(trained_with(std::nullopt).at("network/critic.q1.out.weight"),
                              trained_with(1.0).at("network/critic.q1.out.weight")));
}

// State -------------------------------------------------------------------------------

TEST(Sac, TheSameSeedGivesTheSameBits) {
    const auto spec = small_world(2);
    const auto first = make_sac(small_agent(), spec), second = make_sac(small_agent(), spec);
    const auto other = make_sac(small_agent(), small_world(2, 5));
    drive(*first, spec, 0, 40);
    torch::rand({3});  // the global generator is nobody's
    drive(*second, spec, 0, 40);
    drive(*other, spec, 0, 40);
    expect_equal(first->state(), second->state());
    EXPECT_FALSE(torch::equal(first->state().at("network/encoder.conv1.weight"),
                              other->state().at("network/encoder.conv1.weight")));
}

std::filesystem::path memory_file() {
    return std::filesystem::temp_directory_path() / ("cale_sac_memory_" + std::to_string(::getpid()));
}

TEST(Sac, ARestoredAgentGoesOnAsTheOriginal) {
    auto config = small_agent();
    config.exploration = Exploration::epsilon_greedy;
    config.epsilon.epsilon_decay_period = 50;
    config.replay.update_horizon = 3;
    const auto spec = small_world(2);
    const auto memory = memory_file();
    const auto original = make_sac(config, spec);
    drive(*original, spec, 0, 28);  // to an episode's end: restored agents begin new games
    original->act(noise_frames(2, 1), ActMode::evaluate);
    const auto state = original->state();
    original->save_memory(memory);
    drive(*original, spec, 28, 30);

    const auto restored = make_sac(config, small_world(2, 99));
    restored->load_state(state);
    restored->load_memory(memory);
    std::filesystem::remove(memory);
    expect_equal(restored->state(), state);
    drive(*restored, spec, 28, 30);
    expect_equal(restored->state(), original->state());
    EXPECT_TRUE(torch::equal(restored->act(noise_frames(2, 1), ActMode::evaluate),
                             original->act(noise_frames(2, 1), ActMode::evaluate)));
}

TEST(Sac, AfterARestoreNoTransitionJoinsTheOldGameWithTheNew) {
    const auto spec = small_world();
    const auto path = memory_file();
    const auto transitions_of = [&](const Agent& agent) {
        agent.save_memory(path);
        ReplayBuffer replay({.capacity = small_agent().replay.replay_capacity,
                             .stack = spec.stack,
                             .frame_height = kSide,
                             .frame_width = kSide});
        replay.load(path);
        return replay.add_count();
    };
    const auto original = make_sac(small_agent(), spec);
    drive(*original, spec, 0, 10);
    const auto before = transitions_of(*original);
    const auto restored = make_sac(small_agent(), spec);
    restored->load_memory(path);
    drive(*restored, spec, 10, 1);
    EXPECT_EQ(transitions_of(*restored), before);
    drive(*original, spec, 10, 1);
    EXPECT_EQ(transitions_of(*original), before + 1);
    std::filesystem::remove(path);
}

TEST(Sac, ItsStateIsACopy) {
    const auto spec = small_world();
    const auto agent = make_sac(small_agent(), spec);
    const auto state = agent->state();
    const auto before = state.at("network/critic.q1.out.weight").clone();
    drive(*agent, spec, 0, 30);
    EXPECT_TRUE(torch::equal(state.at("network/critic.q1.out.weight"), before));
}

TEST(Sac, AStateThatDoesNotFitIsRefusedAndNothingChanges) {
    const auto spec = small_world();
    const auto agent = make_sac(small_agent(), spec);
    const auto own = agent->state();
    auto lacking = own;
    lacking.erase("target/actor.out.bias");
    const auto message = [&](const TensorMap& state) -> std::string {
        try {
            agent->load_state(state);
        } catch (const std::runtime_error& error) {
            return error.what();
        }
        return "accepted";
    };
    EXPECT_THAT(message(lacking), testing::HasSubstr("target/actor.out.bias"));
    auto wider = small_agent();
    wider.network.hidden_units = 17;
    const auto other = make_sac(wider, small_world(1, 2))->state();
    EXPECT_THAT(message(other), testing::HasSubstr("another shape"));
    auto garbled = own;
    garbled["network/actor.out.bias"] = torch::ones({6});
    garbled["random/replay"] = torch::zeros({4}, torch::kUInt8);
    EXPECT_THAT(message(garbled), testing::HasSubstr("random state"));
    expect_equal(agent->state(), own);
}

// Bad input and the log ---------------------------------------------------------------

TEST(Sac, RefusesRewardsThatAreNoNumbersAndOtherCounts) {
    const auto spec = small_world();
    const auto agent = make_sac(small_agent(), spec);
    const std::vector<std::uint8_t> frame(kPixels);
    std::vector<StepResult> results(1);
    results[0].reward = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THROW(agent->observe({frame, torch::zeros({1, 3}), results, frame}), std::invalid_argument);
    results[0].reward = 0;
    EXPECT_NO_THROW(agent->observe({frame, torch::zeros({1, 3}), results, frame}));
    EXPECT_THROW(agent->observe({frame, torch::zeros({2, 3}), results, frame}), std::invalid_argument);
    results.resize(2);
    EXPECT_THROW(agent->observe({frame, torch::zeros({1, 3}), results, frame}), std::invalid_argument);
}

TEST(Sac, ADivergedActorIsReported) {
    const auto spec = small_world();
    const auto agent = make_sac(small_agent(), spec);
    auto state = agent->state();
    state["network/actor.out.bias"] = torch::full({6}, std::numeric_limits<float>::quiet_NaN());
    agent->load_state(state);
    EXPECT_THROW(agent->act(noise_frames(1, 1), ActMode::evaluate), std::runtime_error);
}

TEST(Sac, DiscreteWorldsAreRefused) {
    auto spec = small_world();
    spec.num_actions = 6;
    EXPECT_THROW(make_sac(small_agent(), spec), std::invalid_argument);
}

TEST(Sac, LogsWhatTheLastUpdateSaw) {
    const auto spec = small_world();
    const auto agent = make_sac(small_agent(), spec);
    EXPECT_FALSE(agent->metrics().contains("losses/qf_loss"));
    drive(*agent, spec, 0, 30);
    const auto metrics = agent->metrics();
    for (const auto* tag : {"losses/qf_loss", "losses/qf1_values", "losses/qf2_values", "losses/actor_loss",
                            "losses/alpha_loss", "losses/alpha", "losses/entropy", "charts/learning_rate"}) {
        ASSERT_TRUE(metrics.contains(tag)) << tag;
        EXPECT_TRUE(std::isfinite(metrics.at(tag))) << tag;
    }
    EXPECT_FLOAT_EQ(static_cast<float>(metrics.at("losses/alpha")),
                    std::exp(agent->state().at("log_alpha").item<float>()));
    EXPECT_FALSE(metrics.contains("charts/epsilon"));
}

// Learning ----------------------------------------------------------------------------

/// One decision per episode: the lit quarter of the frame says where the joystick must be
/// pushed, and the reward is 1 if it is pushed there: r > 1/2, theta within the quadrant.
/// A random action succeeds one time in eight.
struct Quarters {
    std::int64_t num_envs;
    at::Generator random = make_generator(11);
    torch::Tensor lit{};

    torch::Tensor show() {
        lit = torch::randint(0, 4, {num_envs}, random, torch::kInt64);
        auto observations = torch::zeros({num_envs, 2, kSide, kSide}, torch::kUInt8);
        for (std::int64_t env = 0; env < num_envs; ++env) {
            const auto quarter = lit[env].item<std::int64_t>();
            const auto row = quarter / 2 * kSide / 2, column = quarter % 2 * kSide / 2;
            observations[env][1].slice(0, row, row + kSide / 2).slice(1, column, column + kSide / 2) = 255;
        }
        return observations;
    }

    std::vector<StepResult> judge(const torch::Tensor& actions) const {
        std::vector<StepResult> results(static_cast<std::size_t>(num_envs));
        for (std::int64_t env = 0; env < num_envs; ++env) {
            const float radius = actions[env][0].item<float>(), theta = actions[env][1].item<float>();
            const auto pointed = std::clamp<std::int64_t>(
                static_cast<std::int64_t>(std::floor((theta / std::numbers::pi + 1) * 2)), 0, 3);
            auto& result = results[static_cast<std::size_t>(env)];
            result.reward = radius > 0.5f && pointed == lit[env].item<std::int64_t>() ? 1.0f : 0.0f;
            result.terminal = result.episode_over = true;
        }
        return results;
    }
};

double success(const std::vector<StepResult>& results) {
    double sum = 0;
    for (const auto& result : results) sum += result.reward;
    return sum / static_cast<double>(results.size());
}

TEST(Sac, LearnsToPushTheJoystickWhereTheFrameSays) {
    at::set_num_threads(1);
    auto config = small_agent();
    config.network.hidden_units = 64;
    config.replay.min_replay = 200;
    config.replay.update_period = 8;
    config.replay.batch_size = 32;
    config.replay.replay_capacity = 20'000;
    config.learning_rate = 1e-3;
    config.replay.reward_scale = 10;  // so that the reward outweighs the entropy from the start
    config.tau = 0.02;
    const auto spec = small_world(8);
    const auto agent = make_sac(config, spec);
    Quarters world{.num_envs = 8};
    for (int step = 0; step < 600; ++step) {
        agent->update({});
        const auto observations = world.show();
        const auto actions = agent->act(observations, ActMode::train);
        const auto results = world.judge(actions);
        const auto newest = observations.select(1, 1).contiguous();
        const std::span<const std::uint8_t> frames(newest.data_ptr<std::uint8_t>(), 8 * kPixels);
        agent->observe({frames, actions, results, frames});
    }
    Quarters examination{.num_envs = 400, .random = make_generator(12)};
    const auto shown = examination.show();
    EXPECT_GT(success(examination.judge(agent->act(shown, ActMode::evaluate))), 0.8);
}

}  // namespace
}  // namespace cale
