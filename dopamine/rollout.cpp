#include "dopamine/rollout.h"

#include <cstddef>
#include <stdexcept>
#include <utility>

#include <torch/types.h>

namespace cale {
namespace {

ReplayConfig one_step(const RolloutConfig& config) {
    return {.num_envs = config.num_envs,
            .observation = config.observation,
            .update_horizon = 1,
            .replay_terminal = ReplayTerminal::dopamine};
}

/// Of so many frames, without a stack.
std::vector<std::int64_t> frames_shape(const RolloutConfig& config, std::int64_t count) {
    std::vector<std::int64_t> shape{count};
    shape.insert(shape.end(), config.observation.shape.begin(), config.observation.shape.end());
    return shape;
}

}  // namespace

DopamineRollout::DopamineRollout(const RolloutConfig& rollout_config)
    : Rollout(rollout_config), accumulator_(one_step(config)) {
    if (config.num_envs == 1) return;
    throw std::invalid_argument("agent.replay_terminal: dopamine is a rule for env.num_envs = 1, not " +
                                std::to_string(config.num_envs));
}

void DopamineRollout::clear() {
    Rollout::clear();
    accumulator_.steps().clear();
    frames_.clear();
    frame_actions_.clear();
    elements_.clear();
    surplus_ = 0;
    next_observation = torch::Tensor();
}

void DopamineRollout::store_observations(const torch::Tensor& observations) {
    newest_ = observations[0].clone();
}

void DopamineRollout::store_step(const torch::Tensor& actions, std::span<const StepResult> results,
                                 std::span<const std::uint8_t>) {
    const auto& result = results.front();
    const auto id = static_cast<FrameId>(frames_.size());
    frames_.push_back(newest_[-1].clone());
    frame_actions_.push_back(actions[0].clone());
    const auto ending = result.terminal    ? EpisodeEnd::terminal
                        : result.truncated ? EpisodeEnd::truncated
                                           : EpisodeEnd::none;
    accumulator_.add({id, scaled(result.reward)}, ending, kBlankFrame, [&](const Transition& transition) {
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
        elements_[surplus_++ % elements_.size()] = std::move(element);
    });
    steps = static_cast<std::int64_t>(elements_.size());
    if (full()) lay_out_elements();
}

void DopamineRollout::lay_out_elements() {
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

std::map<std::string, torch::Tensor> DopamineRollout::state() const {
    const auto count = static_cast<std::int64_t>(elements_.size());
    auto element_frames = torch::empty({count, 2, config.observation.stack}, torch::kInt64);
    auto element_values = torch::empty({count, 2});
    for (std::int64_t i = 0; i < count; ++i) {
        const auto& element = elements_[static_cast<std::size_t>(i)];
        element_frames[i][0].copy_(torch::tensor(element.observation));
        element_frames[i][1].copy_(torch::tensor(element.next_observation));
        element_values[i].copy_(torch::tensor({element.reward, element.terminal}));
    }
    std::vector<std::int64_t> window_frames;
    std::vector<double> window_rewards;
    for (const auto& step : accumulator_.steps()) {
        window_frames.push_back(step.frame);
        window_rewards.push_back(step.reward);
    }
    const auto in_one = [](const std::vector<torch::Tensor>& parts, const torch::Tensor& none) {
        return parts.empty() ? none : torch::stack(parts);
    };
    return {{"frames", in_one(frames_, torch::empty(frames_shape(config, 0), torch::kUInt8))},
            {"frame_actions", in_one(frame_actions_, action[0].slice(0, 0, 0))},
            {"element_frames", element_frames},
            {"element_values", element_values},
            {"surplus", torch::tensor(static_cast<std::int64_t>(surplus_))},
            {"window_frames", torch::tensor(window_frames, torch::kInt64)},
            {"window_rewards", torch::tensor(window_rewards, torch::kFloat64)}};
}

void DopamineRollout::restore(const std::map<std::string, torch::Tensor>& state) {
    const auto frames = part(state, "frames", at::kByte, frames_shape(config, -1));
    auto action_shape = action[0][0].sizes().vec();
    action_shape.insert(action_shape.begin(), frames.size(0));
    const auto actions = part(state, "frame_actions", action.scalar_type(), action_shape);
    const auto element_frames = part(state, "element_frames", at::kLong, {-1, 2, config.observation.stack});
    const auto count = element_frames.size(0);
    const auto element_values = part(state, "element_values", at::kFloat, {count, 2});
    const auto surplus = part(state, "surplus", at::kLong, {}).item<std::int64_t>();
    const auto window_frames = part(state, "window_frames", at::kLong, {-1});
    const auto window_rewards = part(state, "window_rewards", at::kDouble, {window_frames.size(0)});
    const auto known = [&](const torch::Tensor& ids) {
        return ((ids >= kBlankFrame) & (ids < frames.size(0))).all().item<bool>();
    };
    // The newest frame of an element's observation is the one that its action was chosen on.
    const auto acted_on = element_frames.select(1, 0).select(1, config.observation.stack - 1);
    if (count > config.length || surplus < 0 || !known(element_frames) ||
        (acted_on == kBlankFrame).any().item<bool>() || !known(window_frames) ||
        (window_frames == kBlankFrame).any().item<bool>() || window_frames.size(0) > accumulator_.max_steps())
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

torch::Tensor DopamineRollout::stacked(const std::vector<FrameId>& ids) const {
    std::vector<torch::Tensor> shown;
    shown.reserve(ids.size());
    for (const auto id : ids) {
        shown.push_back(id == kBlankFrame ? torch::zeros_like(frames_.front())
                                          : frames_[static_cast<std::size_t>(id)]);
    }
    return torch::stack(shown);
}

}  // namespace cale
