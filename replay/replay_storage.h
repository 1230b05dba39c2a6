// Where the replay keeps frames and transitions: two rings, each frame once.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "replay/accumulator.h"
#include "replay/lazy_array.h"
#include "replay/replay_buffer.h"

namespace cale {

/// Frames that are kept: as many as there are transitions, and those of the windows that
/// are not yet complete while all environments step together, each with a final frame.
std::int64_t frame_capacity(const ReplayConfig& config);
std::int64_t bytes_per_frame(const ReplayConfig& config);
std::int64_t bytes_per_transition(const ReplayConfig& config);

/// Frames and transitions carry numbers that only grow; a number's slot is its remainder.
/// The action of a step lies with the frame it was chosen on, which is the last one of
/// the observation. First in, first out: with a frame go all transitions up to the last
/// one that shows it. Trusts its caller's sizes.
struct ReplayStorage {
    explicit ReplayStorage(const ReplayConfig& config);

    std::int64_t stack, action_size, frame_size, frames_capacity, capacity;

    LazyArray<std::uint8_t> frames;            // [frames_capacity, H, W]
    LazyArray<float> actions;                  // [frames_capacity, action_size]
    LazyArray<std::int64_t> discrete_actions;  // [frames_capacity] if action_size is 0
    LazyArray<std::int64_t> users_end;         // [frames_capacity] last transition with this frame, plus 1
    FrameId frames_end = 0;                    // frames ever stored

    LazyArray<FrameId> references;       // [capacity, 2, stack] observation, next observation
    LazyArray<float> n_step_returns;     // [capacity]
    LazyArray<float> discounts;          // [capacity]
    std::int64_t transitions_begin = 0;  // the oldest transition that is left
    std::int64_t transitions_end = 0;    // transitions ever stored

    FrameId frames_begin() const { return std::max<FrameId>(frames_end - frames_capacity, 0); }
    std::int64_t size() const { return transitions_end - transitions_begin; }
    /// The frames of a transition: its observation's, then its next observation's.
    std::span<FrameId> frames_of(std::int64_t transition);
    std::span<const FrameId> frames_of(std::int64_t transition) const;

    FrameId push_frame(std::span<const std::uint8_t> pixels);
    void push_action(FrameId frame, const Experience& experience);
    /// Does nothing if one of its frames has been overwritten.
    void push_transition(const Transition& transition);

    /// Copies a transition to row `row` of a batch of the right shapes.
    void copy(std::int64_t transition, Batch& batch, std::int64_t row) const;

    /// Recomputes users_end. False if a transition shows a frame that is not there.
    bool restore_users();

    /// Calls `exchange(pointer, count)` for all that is stored, oldest first, but for the counters.
    template <class Exchange>
    void for_each_run(const Exchange& exchange);

  private:
    void mark_users(std::int64_t transition);
    void copy_stack(std::span<const FrameId> shown, std::uint8_t* pixels) const;
};

template <class Exchange>
void ReplayStorage::for_each_run(const Exchange& exchange) {
    const auto runs = [](std::int64_t begin, std::int64_t end, std::int64_t ring, const auto& visit) {
        while (begin < end) {
            const std::int64_t slot = begin % ring;
            const std::int64_t count = std::min(end - begin, ring - slot);
            visit(slot, count);
            begin += count;
        }
    };
    runs(transitions_begin, transitions_end, capacity, [&](std::int64_t slot, std::int64_t count) {
        exchange(references.data() + slot * 2 * stack, count * 2 * stack);
        exchange(n_step_returns.data() + slot, count);
        exchange(discounts.data() + slot, count);
    });
    runs(frames_begin(), frames_end, frames_capacity, [&](std::int64_t slot, std::int64_t count) {
        if (action_size > 0)
            exchange(actions.data() + slot * action_size, count * action_size);
        else
            exchange(discrete_actions.data() + slot, count);
        exchange(frames.data() + slot * frame_size, count * frame_size);
    });
}

}  // namespace cale
