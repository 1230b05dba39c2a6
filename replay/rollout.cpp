#include "replay/rollout.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

#include <torch/types.h>

#include "replay/types.h"

namespace cale {

namespace {

void require_shape(const char* what, const torch::Tensor& tensor, at::IntArrayRef expected) {
    if (tensor.sizes() == expected) return;
    std::ostringstream message;
    message << "the rollout takes " << what << " of shape " << expected << ", not " << tensor.sizes();
    throw std::invalid_argument(message.str());
}

}  // namespace

torch::Tensor Rollout::part(const std::map<std::string, torch::Tensor>& state, const std::string& name,
                            at::ScalarType type, at::IntArrayRef shape) {
    const auto found = state.find(name);
    if (found == state.end()) throw std::runtime_error("a stored rollout lacks 'rollout/" + name + "'");
    const auto& tensor = found->second;
    bool matches = tensor.scalar_type() == type && tensor.dim() == static_cast<std::int64_t>(shape.size());
    for (std::size_t i = 0; matches && i < shape.size(); ++i)
        matches = shape[i] == -1 || tensor.sizes()[i] == shape[i];
    if (matches) return tensor;
    throw std::runtime_error("a stored rollout holds 'rollout/" + name +
                             "' in another shape: it was saved with another configuration");
}

Rollout::Rollout(const RolloutConfig& rollout_config)
    : config(rollout_config),
      observation(
          torch::empty(config.observation.tensor_shape({config.length, config.num_envs}), torch::kUInt8)),
      action(config.action_size > 0 ? torch::empty({config.length, config.num_envs, config.action_size})
                                    : torch::empty({config.length, config.num_envs}, torch::kInt64)),
      reward(torch::empty({config.length, config.num_envs})),
      terminal(torch::empty({config.length, config.num_envs})) {}

void Rollout::set_observations(const torch::Tensor& observations) {
    if (full()) throw std::logic_error("a full rollout was not learned from before the next decision");
    require_shape("observations", observations, observation.sizes().slice(1));
    if (observations.scalar_type() != torch::kUInt8)
        throw std::invalid_argument("the rollout stores observations of type uint8");
    store_observations(observations);
}

void Rollout::store_observations(const torch::Tensor& observations) {
    observation[steps].copy_(observations);
}

void Rollout::add(const torch::Tensor& actions, std::span<const StepResult> results,
                  std::span<const std::uint8_t> final_frames) {
    if (full()) throw std::logic_error("a full rollout cannot take another step");
    const auto count = static_cast<std::size_t>(config.num_envs);
    if (results.size() != count) {
        throw std::invalid_argument("the rollout expects the results of " + std::to_string(count) +
                                    " environments, not of " + std::to_string(results.size()));
    }
    require_shape("actions", actions, action.sizes().slice(1));
    require_finite_rewards(results);
    const auto frame_size = static_cast<std::size_t>(config.observation.frame_size());
    const bool cut_off = std::ranges::any_of(
        results, [](const StepResult& result) { return result.truncated && !result.terminal; });
    if (cut_off && final_frames.size() != count * frame_size)
        throw std::invalid_argument("where an episode is cut off the rollout needs its final frame");
    store_step(actions, results, final_frames);
}

float Rollout::scaled(float value) const {
    const auto limit = static_cast<float>(config.reward_clip.value_or(INFINITY));
    return static_cast<float>(config.reward_scale) * std::clamp(value, -limit, limit);
}

void Rollout::store_step(const torch::Tensor& actions, std::span<const StepResult> results,
                         std::span<const std::uint8_t> final_frames) {
    const auto frame_size = static_cast<std::size_t>(config.observation.frame_size());
    action[steps].copy_(actions);
    auto* rewards = reward[steps].data_ptr<float>();
    auto* terminals = terminal[steps].data_ptr<float>();
    for (std::size_t env = 0; env < results.size(); ++env) {
        const auto& result = results[env];
        rewards[env] = scaled(result.reward);
        terminals[env] = result.terminal || result.truncated ? 1.0f : 0.0f;
        if (result.terminal || !result.truncated) continue;
        const auto column = static_cast<std::int64_t>(env);
        auto left_with = torch::empty(config.observation.tensor_shape(), torch::kUInt8);
        left_with.slice(0, 0, -1).copy_(observation[steps][column].slice(0, 1));
        const auto last = final_frames.subspan(env * frame_size, frame_size);
        std::copy(last.begin(), last.end(), left_with[-1].data_ptr<std::uint8_t>());
        truncations.push_back({steps, column, left_with});
    }
    ++steps;
}

std::map<std::string, torch::Tensor> Rollout::state() const {
    const auto cuts = static_cast<std::int64_t>(truncations.size());
    auto cut_at = torch::empty({cuts, 2}, torch::kInt64);
    auto cut_observation = torch::empty(config.observation.tensor_shape({cuts}), torch::kUInt8);
    for (std::int64_t i = 0; i < cuts; ++i) {
        const auto& cut = truncations[static_cast<std::size_t>(i)];
        cut_at[i][0] = cut.step;
        cut_at[i][1] = cut.env;
        cut_observation[i].copy_(cut.observation);
    }
    const auto made = [this](const torch::Tensor& whole) { return whole.slice(0, 0, steps).clone(); };
    return {{"observation", made(observation)}, {"action", made(action)},
            {"reward", made(reward)},           {"terminal", made(terminal)},
            {"truncation_at", cut_at},          {"truncation_observation", cut_observation}};
}

void Rollout::restore(const std::map<std::string, torch::Tensor>& state) {
    const auto count = part(state, "reward", at::kFloat, {-1, config.num_envs}).size(0);
    if (count > config.length)
        throw std::runtime_error("a stored rollout is longer than agent.rollout_steps");
    const auto whole = [&](const std::string& name, const torch::Tensor& like) {
        auto shape = like.sizes().vec();
        shape.front() = count;
        return part(state, name, like.scalar_type(), shape);
    };
    const auto observations = whole("observation", observation), actions = whole("action", action),
               rewards = whole("reward", reward), terminals = whole("terminal", terminal);
    const auto cut_at = part(state, "truncation_at", at::kLong, {-1, 2});
    const auto cut_observation =
        part(state, "truncation_observation", at::kByte, config.observation.tensor_shape({cut_at.size(0)}));
    const auto limits = torch::tensor({count, config.num_envs});
    if (!((cut_at >= 0) & (cut_at < limits)).all().item<bool>())
        throw std::runtime_error("a stored rollout was cut off where it has no step");

    clear();
    steps = count;
    observation.slice(0, 0, count).copy_(observations);
    action.slice(0, 0, count).copy_(actions);
    reward.slice(0, 0, count).copy_(rewards);
    terminal.slice(0, 0, count).copy_(terminals);
    for (std::int64_t i = 0; i < cut_at.size(0); ++i) {
        truncations.push_back({cut_at[i][0].item<std::int64_t>(), cut_at[i][1].item<std::int64_t>(),
                               cut_observation[i].clone()});
    }
}

void Rollout::clear() {
    steps = 0;
    truncations.clear();
}

}  // namespace cale
