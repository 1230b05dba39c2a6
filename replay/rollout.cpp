#include "replay/rollout.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

#include <torch/torch.h>

namespace cale {

namespace {

void require_shape(const char* what, const torch::Tensor& tensor, at::IntArrayRef expected) {
    if (tensor.sizes() == expected) return;
    std::ostringstream message;
    message << "the rollout takes " << what << " of shape " << expected << ", not " << tensor.sizes();
    throw std::invalid_argument(message.str());
}

ReplayConfig one_step(const RolloutConfig& config) {
    return {.num_envs = config.num_envs,
            .stack = config.stack,
            .update_horizon = 1,
            .replay_terminal = config.replay_terminal};
}

}  // namespace

Rollout::Rollout(const RolloutConfig& rollout_config)
    : config(rollout_config),
      observation(torch::empty(
          {config.length, config.num_envs, config.stack, config.frame_height, config.frame_width},
          torch::kUInt8)),
      action(config.action_size > 0 ? torch::empty({config.length, config.num_envs, config.action_size})
                                    : torch::empty({config.length, config.num_envs}, torch::kInt64)),
      reward(torch::empty({config.length, config.num_envs})),
      terminal(torch::empty({config.length, config.num_envs})),
      accumulator_(one_step(config)) {
    if (config.replay_terminal == ReplayTerminal::dopamine && config.num_envs != 1) {
        throw std::invalid_argument("agent.replay_terminal: dopamine is a rule for env.num_envs = 1, not " +
                                    std::to_string(config.num_envs));
    }
}

void Rollout::set_observations(const torch::Tensor& observations) {
    if (full()) throw std::logic_error("a full rollout was not learned from before the next decision");
    require_shape("observations", observations, observation.sizes().slice(1));
    if (config.replay_terminal == ReplayTerminal::dopamine) {
        newest_ = observations[0].clone();
    } else {
        observation[steps].copy_(observations);
    }
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
    for (std::size_t env = 0; env < count; ++env) {
        if (!std::isfinite(results[env].reward)) {
            throw std::invalid_argument("the reward of environment " + std::to_string(env) + " is " +
                                        std::to_string(results[env].reward));
        }
    }
    const auto frame_size = static_cast<std::size_t>(config.frame_height * config.frame_width);
    const bool cut_off = std::any_of(results.begin(), results.end(), [](const StepResult& result) {
        return result.truncated && !result.terminal;
    });
    if (cut_off && final_frames.size() != count * frame_size)
        throw std::invalid_argument("where an episode is cut off the rollout needs its final frame");
    // Nothing is refused from here on: a step is taken as a whole.
    if (config.replay_terminal == ReplayTerminal::corrected) action[steps].copy_(actions);
    auto* rewards = reward[steps].data_ptr<float>();
    auto* terminals = terminal[steps].data_ptr<float>();
    const auto limit = static_cast<float>(config.reward_clip.value_or(INFINITY));
    for (std::size_t env = 0; env < count; ++env) {
        const auto& result = results[env];
        const auto scaled =
            static_cast<float>(config.reward_scale) * std::clamp(result.reward, -limit, limit);
        if (config.replay_terminal == ReplayTerminal::dopamine)
            return add_by_dopamines_rule(actions[0], scaled, result);
        rewards[env] = scaled;
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
    accumulator_.steps().clear();
    frames_.clear();
    frame_actions_.clear();
    elements_.clear();
    surplus_ = 0;
    next_observation = torch::Tensor();
}

void Rollout::add_by_dopamines_rule(const torch::Tensor& chosen, float scaled_reward,
                                    const StepResult& result) {
    const auto id = static_cast<FrameId>(frames_.size());
    frames_.push_back(newest_[-1].clone());
    frame_actions_.push_back(chosen.clone());
    const auto ending = result.terminal    ? EpisodeEnd::terminal
                        : result.truncated ? EpisodeEnd::truncated
                                           : EpisodeEnd::none;
    accumulator_.add({id, scaled_reward}, ending, kBlankFrame, [&](const Transition& transition) {
        Element element{{transition.observation.begin(), transition.observation.end()},
                        {transition.next_observation.begin(), transition.next_observation.end()},
                        static_cast<float>(transition.n_step_return),
                        transition.discount == 0 ? 1.0f : 0.0f};
        if (elements_.size() < static_cast<std::size_t>(config.length)) {
            elements_.push_back(std::move(element));
            return;
        }
        // An episode's end may store more than fits: the reference's ring drops its oldest element and moves
        // its newest into the gap, so that the surplus comes to lie in front.
        elements_[surplus_++] = std::exchange(elements_.back(), std::move(element));
    });
    steps = static_cast<std::int64_t>(elements_.size());
    if (full()) lay_out_elements();
}

void Rollout::lay_out_elements() {
    for (std::size_t i = 0; i < elements_.size(); ++i) {
        const auto& element = elements_[i];
        const auto row = static_cast<std::int64_t>(i);
        observation[row][0].copy_(stacked(element.observation));
        action[row][0].copy_(frame_actions_[static_cast<std::size_t>(element.observation.back())]);
        reward[row][0] = element.reward;
        terminal[row][0] = element.terminal;
    }
    next_observation = stacked(elements_.back().next_observation).unsqueeze(0);
}

torch::Tensor Rollout::stacked(const std::vector<FrameId>& ids) const {
    std::vector<torch::Tensor> shown;
    for (const auto id : ids) {
        shown.push_back(id == kBlankFrame ? torch::zeros_like(frames_.front())
                                          : frames_[static_cast<std::size_t>(id)]);
    }
    return torch::stack(shown);
}

}  // namespace cale
