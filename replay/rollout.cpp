#include "replay/rollout.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

#include <torch/types.h>

#include "replay/rewards.h"

namespace cale {

namespace {

void require_shape(const char* what, const torch::Tensor& tensor, at::IntArrayRef expected) {
    if (tensor.sizes() == expected) return;
    std::ostringstream message;
    message << "the rollout takes " << what << " of shape " << expected << ", not " << tensor.sizes();
    throw std::invalid_argument(message.str());
}

/// The tensor of that name, type and shape, in which -1 is any size.
torch::Tensor part(const std::map<std::string, torch::Tensor>& state, const std::string& name,
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

void Rollout::set_observations(const torch::Tensor& given) {
    const bool bytes = given.dim() == 3 && given.size(1) == config.stack && config.frame_height == 1;
    const auto observations = bytes ? given.unsqueeze(2) : given;
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
    require_finite_rewards(results);
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

std::map<std::string, torch::Tensor> Rollout::state() const {
    if (config.replay_terminal == ReplayTerminal::dopamine) return state_by_dopamines_rule();
    const auto cuts = static_cast<std::int64_t>(truncations.size());
    auto cut_at = torch::empty({cuts, 2}, torch::kInt64);
    auto cut_observation =
        torch::empty({cuts, config.stack, config.frame_height, config.frame_width}, torch::kUInt8);
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
    if (config.replay_terminal == ReplayTerminal::dopamine) return restore_by_dopamines_rule(state);
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
        part(state, "truncation_observation", at::kByte,
             {cut_at.size(0), config.stack, config.frame_height, config.frame_width});
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
        // An episode's end may store more than fits: the reference drops its oldest element and moves the one
        // that has just come into the gap, so that the surplus comes to lie in front.
        elements_[surplus_++] = std::move(element);
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

std::map<std::string, torch::Tensor> Rollout::state_by_dopamines_rule() const {
    const auto count = static_cast<std::int64_t>(elements_.size());
    auto element_frames = torch::empty({count, 2, config.stack}, torch::kInt64);
    auto element_values = torch::empty({count, 2});
    for (std::int64_t i = 0; i < count; ++i) {
        const auto& element = elements_[static_cast<std::size_t>(i)];
        element_frames[i][0].copy_(torch::tensor(element.observation));
        element_frames[i][1].copy_(torch::tensor(element.next_observation));
        element_values[i].copy_(torch::tensor({element.reward, element.terminal}));
    }
    std::vector<std::int64_t> window_frames;
    std::vector<double> window_rewards;
    auto window = accumulator_;
    for (const auto& step : window.steps()) {
        window_frames.push_back(step.frame);
        window_rewards.push_back(step.reward);
    }
    const auto in_one = [](const std::vector<torch::Tensor>& parts, const torch::Tensor& none) {
        return parts.empty() ? none : torch::stack(parts);
    };
    return {{"frames",
             in_one(frames_, torch::empty({0, config.frame_height, config.frame_width}, torch::kUInt8))},
            {"frame_actions", in_one(frame_actions_, action[0].slice(0, 0, 0))},
            {"element_frames", element_frames},
            {"element_values", element_values},
            {"surplus", torch::tensor(static_cast<std::int64_t>(surplus_))},
            {"window_frames", torch::tensor(window_frames, torch::kInt64)},
            {"window_rewards", torch::tensor(window_rewards, torch::kFloat64)}};
}

void Rollout::restore_by_dopamines_rule(const std::map<std::string, torch::Tensor>& state) {
    const auto frames = part(state, "frames", at::kByte, {-1, config.frame_height, config.frame_width});
    auto action_shape = action[0][0].sizes().vec();
    action_shape.insert(action_shape.begin(), frames.size(0));
    const auto actions = part(state, "frame_actions", action.scalar_type(), action_shape);
    const auto element_frames = part(state, "element_frames", at::kLong, {-1, 2, config.stack});
    const auto count = element_frames.size(0);
    const auto element_values = part(state, "element_values", at::kFloat, {count, 2});
    const auto surplus = part(state, "surplus", at::kLong, {}).item<std::int64_t>();
    const auto window_frames = part(state, "window_frames", at::kLong, {-1});
    const auto window_rewards = part(state, "window_rewards", at::kDouble, {window_frames.size(0)});
    const auto known = [&](const torch::Tensor& ids) {
        return ((ids >= kBlankFrame) & (ids < frames.size(0))).all().item<bool>();
    };
    if (count > config.length || surplus < 0 || surplus >= config.length || !known(element_frames) ||
        !known(window_frames) || window_frames.size(0) > accumulator_.max_steps())
        throw std::runtime_error("the parts of a stored rollout contradict each other");

    clear();
    frames_ = frames.clone().unbind();
    frame_actions_ = actions.clone().unbind();
    const auto ids = [](const torch::Tensor& row) {
        const auto whole = row.contiguous();
        return std::vector<FrameId>(whole.const_data_ptr<FrameId>(),
                                    whole.const_data_ptr<FrameId>() + whole.numel());
    };
    for (std::int64_t i = 0; i < count; ++i) {
        elements_.push_back({ids(element_frames[i][0]), ids(element_frames[i][1]),
                             element_values[i][0].item<float>(), element_values[i][1].item<float>()});
    }
    surplus_ = static_cast<std::size_t>(surplus);
    for (std::int64_t i = 0; i < window_frames.size(0); ++i)
        accumulator_.steps().push_back({window_frames[i].item<FrameId>(), window_rewards[i].item<double>()});
    steps = count;
    if (full()) lay_out_elements();
}

torch::Tensor Rollout::stacked(const std::vector<FrameId>& ids) const {
    std::vector<torch::Tensor> shown;
    shown.reserve(ids.size());
    for (const auto id : ids) {
        shown.push_back(id == kBlankFrame ? torch::zeros_like(frames_.front())
                                          : frames_[static_cast<std::size_t>(id)]);
    }
    return torch::stack(shown);
}

}  // namespace cale
