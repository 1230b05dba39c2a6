#include "replay/rollout.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <torch/torch.h>

namespace cale {

Rollout::Rollout(const RolloutConfig& rollout_config)
    : config(rollout_config),
      observation(torch::empty(
          {config.length, config.num_envs, config.stack, config.frame_height, config.frame_width},
          torch::kUInt8)),
      action(config.action_size > 0 ? torch::empty({config.length, config.num_envs, config.action_size})
                                    : torch::empty({config.length, config.num_envs}, torch::kInt64)),
      reward(torch::empty({config.length, config.num_envs})),
      terminal(torch::empty({config.length, config.num_envs})) {}

void Rollout::set_observations(const torch::Tensor& observations) {
    if (full()) throw std::logic_error("a full rollout was not learned from before the next decision");
    observation[steps].copy_(observations);
}

void Rollout::add(const torch::Tensor& actions, std::span<const StepResult> results,
                  std::span<const std::uint8_t> final_frames) {
    if (full()) throw std::logic_error("a full rollout cannot take another step");
    const auto count = static_cast<std::size_t>(config.num_envs);
    if (results.size() != count || actions.sizes() != action[steps].sizes()) {
        throw std::invalid_argument("the rollout expects the results and actions of " +
                                    std::to_string(count) + " environments, not of " +
                                    std::to_string(results.size()));
    }
    action[steps].copy_(actions);
    auto* rewards = reward[steps].data_ptr<float>();
    auto* terminals = terminal[steps].data_ptr<float>();
    const auto limit = static_cast<float>(config.reward_clip.value_or(INFINITY));
    const auto frame_size = static_cast<std::size_t>(config.frame_height * config.frame_width);
    for (std::size_t env = 0; env < count; ++env) {
        const auto& result = results[env];
        if (!std::isfinite(result.reward)) {
            throw std::invalid_argument("the reward of environment " + std::to_string(env) + " is " +
                                        std::to_string(result.reward));
        }
        rewards[env] = static_cast<float>(config.reward_scale) * std::clamp(result.reward, -limit, limit);
        terminals[env] = result.terminal || result.truncated ? 1.0f : 0.0f;
        if (result.terminal || !result.truncated) continue;
        const auto column = static_cast<std::int64_t>(env);
        auto left_with = torch::empty({config.stack, config.frame_height, config.frame_width}, torch::kUInt8);
        left_with.slice(0, 0, -1).copy_(observation[steps][column].slice(0, 1));
        const auto last = final_frames.subspan(env * frame_size, frame_size);
        std::copy(last.begin(), last.end(), left_with[-1].data_ptr<std::uint8_t>());
        truncations.push_back({steps, column, left_with});
    }
    ++steps;
}

void Rollout::clear() {
    steps = 0;
    truncations.clear();
}

}  // namespace cale
