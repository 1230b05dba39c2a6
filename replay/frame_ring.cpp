#include "replay/frame_ring.h"

#include <cstring>

namespace cale {

std::int64_t frame_capacity(const ReplayConfig& config) {
    return config.capacity + 2 * config.num_envs * (config.update_horizon + config.observation.stack);
}

std::int64_t bytes_per_frame(const ReplayConfig& config) {
    const auto action = config.action_size > 0 ? config.action_size * std::int64_t{sizeof(float)}
                                               : std::int64_t{sizeof(std::int64_t)};
    return config.observation.frame_size() + action + std::int64_t{sizeof(std::int64_t)};
}

std::int64_t bytes_per_transition(const ReplayConfig& config) {
    return 2 * config.observation.stack * std::int64_t{sizeof(FrameId)} + 2 * std::int64_t{sizeof(float)};
}

FrameRing::FrameRing(const ReplayConfig& config)
    : stack(config.observation.stack),
      action_size(config.action_size),
      frame_size(config.observation.frame_size()),
      frames_capacity(frame_capacity(config)),
      capacity(config.capacity),
      frames(frames_capacity * frame_size),
      actions(frames_capacity * action_size),
      discrete_actions(action_size == 0 ? frames_capacity : 0),
      users_end(frames_capacity),
      references(capacity * 2 * stack),
      n_step_returns(capacity),
      discounts(capacity) {}

std::span<FrameId> FrameRing::frames_of(std::int64_t transition) {
    return {references.data() + transition % capacity * 2 * stack, static_cast<std::size_t>(2 * stack)};
}

std::span<const FrameId> FrameRing::frames_of(std::int64_t transition) const {
    return {references.data() + transition % capacity * 2 * stack, static_cast<std::size_t>(2 * stack)};
}

FrameId FrameRing::push_frame(std::span<const std::uint8_t> pixels) {
    held_frames.wait_for(frames_end - frames_capacity);
    const std::int64_t slot = frames_end % frames_capacity;
    transitions_begin = std::max(transitions_begin, users_end[slot]);
    std::memcpy(frames.data() + slot * frame_size, pixels.data(), pixels.size());
    return frames_end++;
}

void FrameRing::push_action(FrameId frame, const Experience& experience) {
    const std::int64_t slot = frame % frames_capacity;
    if (action_size == 0)
        discrete_actions[slot] = experience.discrete_action;
    else
        std::ranges::copy(experience.action, actions.data() + slot * action_size);
}

void FrameRing::push_transition(const Transition& transition) {
    const auto overwritten = [this](FrameId frame) { return frame != kBlankFrame && frame < frames_begin(); };
    if (std::ranges::any_of(transition.observation, overwritten) ||
        std::ranges::any_of(transition.next_observation, overwritten))
        return;
    held_transitions.wait_for(transitions_end - capacity);
    if (size() == capacity) ++transitions_begin;
    const std::int64_t slot = transitions_end % capacity;
    const auto next = std::ranges::copy(transition.observation, frames_of(transitions_end).begin()).out;
    std::ranges::copy(transition.next_observation, next);
    n_step_returns[slot] = static_cast<float>(transition.n_step_return);
    discounts[slot] = static_cast<float>(transition.discount);
    mark_users(transitions_end++);
}

void FrameRing::mark_users(std::int64_t transition) {
    for (const FrameId frame : frames_of(transition))
        if (frame != kBlankFrame) users_end[frame % frames_capacity] = transition + 1;
}

bool FrameRing::restore_users() {
    const auto present = [this](FrameId frame) {
        return frame == kBlankFrame || (frame >= frames_begin() && frame < frames_end);
    };
    for (std::int64_t transition = transitions_begin; transition < transitions_end; ++transition) {
        const auto shown = frames_of(transition);
        const FrameId newest = shown[static_cast<std::size_t>(stack) - 1];
        if (newest == kBlankFrame || !std::ranges::all_of(shown, present)) return false;
        mark_users(transition);
    }
    return true;
}

void FrameRing::copy(std::int64_t transition, Batch& batch, std::int64_t row) const {
    const auto shown = frames_of(transition);
    const auto depth = static_cast<std::size_t>(stack);
    const std::int64_t pixels = row * stack * frame_size;
    copy_stack(shown.first(depth), batch.observation.data_ptr<std::uint8_t>() + pixels);
    copy_stack(shown.last(depth), batch.next_observation.data_ptr<std::uint8_t>() + pixels);
    copy_values(transition, batch, row);
}

void FrameRing::copy_values(std::int64_t transition, Batch& batch, std::int64_t row) const {
    const std::int64_t slot = transition % capacity;
    const std::int64_t step = frames_of(transition)[static_cast<std::size_t>(stack) - 1] % frames_capacity;
    if (action_size == 0)
        batch.action.data_ptr<std::int64_t>()[row] = discrete_actions[step];
    else
        std::copy_n(actions.data() + step * action_size, action_size,
                    batch.action.data_ptr<float>() + row * action_size);
    batch.n_step_return.data_ptr<float>()[row] = n_step_returns[slot];
    batch.discount.data_ptr<float>()[row] = discounts[slot];
    batch.index.data_ptr<std::int64_t>()[row] = slot;
}

void FrameRing::copy_stack(std::span<const FrameId> shown, std::uint8_t* pixels) const {
    const auto bytes = static_cast<std::size_t>(frame_size);
    for (const FrameId frame : shown) {
        if (frame == kBlankFrame)
            std::memset(pixels, 0, bytes);
        else
            std::memcpy(pixels, frames.data() + frame % frames_capacity * frame_size, bytes);
        pixels += frame_size;
    }
}

}  // namespace cale
