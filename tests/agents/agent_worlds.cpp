#include "agent_worlds.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "agents/random.h"
#include "replay/replay_buffer.h"
#include "test_device.h"

namespace cale {

// Settings ----------------------------------------------------------------------------

namespace {

AgentSpec small_world(ActionSpace actions, std::int64_t num_envs, std::uint64_t seed) {
    return {.num_envs = num_envs,
            .action_space = std::move(actions),
            .observation = {.stack = kStack, .shape = {kSide, kSide}},
            .total_steps = 1000,
            .seed = seed,
            .device = test_device()};
}

NetworkSettings small_network() {
    return {.encoder = EncoderKind::phi_dqn, .hidden_units = 16};
}

}  // namespace

AgentSpec joystick_world(std::int64_t num_envs, std::uint64_t seed) {
    return small_world(joystick_space(), num_envs, seed);
}

AgentSpec discrete_world(std::int64_t num_envs, std::uint64_t seed) {
    return small_world(Discrete{kNumActions}, num_envs, seed);
}

ReplaySettings small_replay() {
    return {.min_replay = 20, .update_period = 1, .replay_capacity = 1000, .batch_size = 8};
}

EncoderConfig small_encoder() {
    return {.encoder = EncoderKind::phi_dqn, .observation = {kStack, kSide, kSide}};
}

SacConfig small_sac() {
    SacConfig config;
    config.network = small_network();
    config.replay = small_replay();
    config.replay.reward_scale = 0.1;
    return config;
}

DqnConfig small_dqn() {
    DqnConfig config;
    config.hidden_units = 16;
    config.replay = small_replay();
    config.target_update_period = 10;
    return config;
}

DerConfig small_der() {
    DerConfig config;
    config.hidden_units = 16;
    config.num_atoms = 11;
    config.replay = small_replay();
    config.target_update_period = 10;
    return config;
}

SacdConfig small_sacd() {
    SacdConfig config;
    config.network = small_network();
    config.replay = small_replay();
    config.replay.reward_scale = 0.1;
    return config;
}

PpoConfig small_ppo() {
    PpoConfig config;
    config.network.encoder = EncoderKind::phi_dqn;
    config.network.hidden_units = 16;
    config.rollout_steps = 8;
    config.minibatch_size = 4;
    config.epochs = 2;
    return config;
}

// Noise -------------------------------------------------------------------------------

torch::Tensor noise_frames(std::int64_t count, std::uint64_t seed) {
    return torch::randint(0, 256, {count, kStack, kSide, kSide}, make_generator(seed), torch::kUInt8);
}

torch::Tensor same_frame(std::int64_t count) {
    return noise_frames(1, 3).expand({count, kStack, kSide, kSide}).contiguous();
}

NoiseStep::NoiseStep(const AgentSpec& spec, std::int64_t step)
    : observations(noise_frames(spec.num_envs, static_cast<std::uint64_t>(step))),
      frames(observations.select(1, kStack - 1).contiguous()),
      final_frames(255 - frames),
      results(static_cast<std::size_t>(spec.num_envs)) {
    for (std::size_t env = 0; env < results.size(); ++env) {
        auto& result = results[env];
        result.reward = static_cast<float>((static_cast<std::size_t>(step) + env) % 5) - 2;
        result.episode_over = step % 7 == 6;
        result.truncated = step % 14 == 13;
        result.terminal = result.episode_over && !result.truncated;
    }
}

namespace {

std::span<const std::uint8_t> bytes_of(const torch::Tensor& frames) {
    return {frames.const_data_ptr<std::uint8_t>(), static_cast<std::size_t>(frames.numel())};
}

}  // namespace

StepBatch NoiseStep::experiences(const torch::Tensor& actions) const {
    return {bytes_of(frames), actions, results, bytes_of(final_frames)};
}

void act_and_observe(Agent& agent, const AgentSpec& spec, std::int64_t step) {
    const NoiseStep noise(spec, step);
    agent.observe(noise.experiences(agent.act(noise.observations, ActMode::train)));
}

std::int64_t drive(Agent& agent, const AgentSpec& spec, std::int64_t first_step, std::int64_t steps) {
    std::int64_t updates = 0;
    for (std::int64_t step = first_step; step < first_step + steps; ++step) {
        updates += agent.update(NoiseStep(spec, step).observations);
        act_and_observe(agent, spec, step);
    }
    return updates;
}

// What is there to see ----------------------------------------------------------------

std::int64_t gradient_steps_of(Agent& agent) {
    return static_cast<std::int64_t>(agent.state().at("adam/steps").item<double>());
}

Batch memory_of(Agent& agent) {
    const auto& replay = dynamic_cast<const ReplayBuffer&>(*agent.replay());
    std::vector<std::int64_t> positions(static_cast<std::size_t>(replay.size()));
    std::iota(positions.begin(), positions.end(), 0);
    return replay.gather(positions);
}

void expect_equal(const TensorMap& first, const TensorMap& second) {
    ASSERT_EQ(first.size(), second.size());
    for (const auto& [name, tensor] : first) EXPECT_TRUE(torch::equal(tensor, second.at(name))) << name;
}

TensorMap copy_of(const TensorMap& tensors) {
    TensorMap copies;
    for (const auto& [name, tensor] : tensors) copies[name] = tensor.clone();
    return copies;
}

void expect_uniform_over_the_box(const torch::Tensor& actions) {
    const auto box = joystick_box();
    const auto scaled = (actions - box.centre) / box.half_width;
    ASSERT_EQ(scaled.dim(), 2);
    EXPECT_LE(scaled.abs().max().item<float>(), 1);
    for (std::int64_t axis = 0; axis < 3; ++axis) {
        const auto histogram =
            torch::histc(scaled.select(1, axis), 5, -1, 1) / static_cast<double>(actions.size(0));
        EXPECT_LT((histogram - 0.2).abs().max().item<float>(), 0.05) << "coordinate " << axis;
    }
    const auto correlation = torch::corrcoef(scaled.t()) - torch::eye(3);
    EXPECT_LT(correlation.abs().max().item<float>(), 0.15);
}

std::vector<double> frequencies(const torch::Tensor& actions) {
    const auto counts = torch::bincount(actions, {}, kNumActions).to(torch::kFloat64);
    std::vector<double> parts;
    for (std::int64_t action = 0; action < counts.size(0); ++action)
        parts.push_back(counts[action].item<double>() / static_cast<double>(actions.size(0)));
    return parts;
}

TensorMap parameters_of(const torch::nn::Module& module) {
    TensorMap parameters;
    for (const auto& parameter : module.named_parameters())
        parameters[parameter.key()] = parameter.value().detach();
    return parameters;
}

std::int64_t count_parameters(const torch::nn::Module& module) {
    std::int64_t sum = 0;
    for (const auto& parameter : module.parameters()) sum += parameter.numel();
    return sum;
}

void make_constant(const TensorMap& parameters, const std::string& layer,
                   const std::vector<double>& outputs) {
    for (const auto& [name, tensor] : parameters) {
        if (name.starts_with(layer + ".")) tensor.zero_();
        if (name == layer + ".bias" || name == layer + ".bias_mu")
            tensor.copy_(torch::tensor(outputs, torch::kFloat64));
    }
}

// A world to learn --------------------------------------------------------------------

Quarters::Quarters(std::int64_t num_envs, std::uint64_t seed)
    : num_envs_(num_envs), random_(make_generator(seed)) {}

torch::Tensor Quarters::show() {
    lit_ = torch::randint(0, kNumActions, {num_envs_}, random_, torch::kInt64);
    auto observations = torch::zeros({num_envs_, kStack, kSide, kSide}, torch::kUInt8);
    for (std::int64_t env = 0; env < num_envs_; ++env) {
        const auto quarter = lit_[env].item<std::int64_t>();
        const auto row = quarter / 2 * kSide / 2, column = quarter % 2 * kSide / 2;
        observations[env][-1].slice(0, row, row + kSide / 2).slice(1, column, column + kSide / 2) = 255;
    }
    return observations;
}

namespace {

/// The quarter that an action means; -1: none.
std::int64_t meant_by(const torch::Tensor& action) {
    if (action.dim() == 0) return action.item<std::int64_t>();
    const float radius = action[0].item<float>(), theta = action[1].item<float>();
    if (radius <= 0.5f) return -1;
    return std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor((theta / std::numbers::pi + 1) * 2)),
                                    0, 3);
}

}  // namespace

std::vector<StepResult> Quarters::judge(const torch::Tensor& actions) const {
    std::vector<StepResult> results(static_cast<std::size_t>(num_envs_));
    for (std::int64_t env = 0; env < num_envs_; ++env) {
        auto& result = results[static_cast<std::size_t>(env)];
        result.reward = meant_by(actions[env]) == lit_[env].item<std::int64_t>() ? 1.0f : 0.0f;
        result.terminal = result.episode_over = true;
    }
    return results;
}

double learned_after(Agent& agent, const AgentSpec& spec, std::int64_t steps) {
    at::set_num_threads(1);
    Quarters lesson(spec.num_envs, 11);
    for (std::int64_t step = 0; step < steps; ++step) {
        const auto observations = lesson.show();
        agent.update(observations);
        const auto actions = agent.act(observations, ActMode::train);
        const auto newest = observations.select(1, kStack - 1).contiguous();
        agent.observe({bytes_of(newest), actions, lesson.judge(actions), bytes_of(newest)});
    }
    constexpr std::int64_t kQuestions = 400;
    Quarters examination(kQuestions, 12);
    const auto questions = examination.show();
    double right = 0;
    for (const auto& result : examination.judge(agent.act(questions, ActMode::evaluate)))
        right += result.reward;
    return right / kQuestions;
}

}  // namespace cale
