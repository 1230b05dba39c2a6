// The replay's storage: a ring of frames, each stored once, and a ring of transitions.
#pragma once

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <system_error>
#include <type_traits>
#include <utility>

#include "replay/accumulator.h"
#include "replay/types.h"

namespace cale {

/// A fixed-size array, all zero at first, whose pages the operating system commits when they are first
/// written, so that a ring of 7 GB costs nothing before it fills. Throws std::system_error when the address
/// space cannot be reserved.
template <class T>
class LazyArray {
    static_assert(std::is_trivially_copyable_v<T>);

  public:
    LazyArray() = default;
    /// So many elements, all zero.
    explicit LazyArray(std::int64_t size) : bytes_(static_cast<std::size_t>(size) * sizeof(T)) {
        if (bytes_ == 0) return;
        void* memory = ::mmap(nullptr, bytes_, PROT_READ | PROT_WRITE,
                              MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (memory == MAP_FAILED)
            throw std::system_error(errno, std::generic_category(),
                                    "the replay cannot reserve " + std::to_string(bytes_) +
                                        " bytes; lower agent.replay_capacity");
        data_ = static_cast<T*>(memory);
    }
    ~LazyArray() {
        if (data_ != nullptr) ::munmap(data_, bytes_);
    }
    /// Leaves the other empty.
    LazyArray(LazyArray&& other) noexcept
        : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
    /// Exchanges the two.
    LazyArray& operator=(LazyArray&& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(bytes_, other.bytes_);
        return *this;
    }

    T* data() { return data_; }                                     // the first element; null if empty
    const T* data() const { return data_; }                         // the same
    T& operator[](std::int64_t i) { return data_[i]; }              // element i, not checked
    const T& operator[](std::int64_t i) const { return data_[i]; }  // the same

  private:
    T* data_ = nullptr;
    std::size_t bytes_ = 0;
};

/// Returns the number of frames kept: one per transition, plus those of the unfinished windows of all
/// environments stepping together, each with a final frame.
std::int64_t frame_capacity(const ReplayConfig& config);
/// Memory of a frame with the action chosen on it.
std::int64_t bytes_per_frame(const ReplayConfig& config);
/// Memory of a transition without its frames.
std::int64_t bytes_per_transition(const ReplayConfig& config);

/// Protects a range of growing numbers that another thread still reads: their slots must not be overwritten
/// until it releases them.
class Hold {
  public:
    /// Holds this number and all later ones.
    void from(std::int64_t number) {
        from_.store(number, std::memory_order_release);
        from_.notify_all();
    }
    /// Holds nothing any more.
    void release() { from(kNone); }
    /// Returns whether a number is held.
    bool is_held() const { return from_.load(std::memory_order_relaxed) != kNone; }
    /// Blocks until the number is no longer held.
    void wait_for(std::int64_t number) const {
        for (auto held = from_.load(std::memory_order_acquire); number >= held;
             held = from_.load(std::memory_order_acquire))
            from_.wait(held, std::memory_order_acquire);
    }

  private:
    static constexpr std::int64_t kNone = std::numeric_limits<std::int64_t>::max();
    std::atomic<std::int64_t> from_{kNone};
};

/// Calls visit(slot, count) for the one or two runs of slots in which the numbers [begin, end) lie.
template <class Visit>
void for_each_run(std::int64_t begin, std::int64_t end, std::int64_t ring, const Visit& visit) {
    while (begin < end) {
        const std::int64_t slot = begin % ring;
        const std::int64_t count = std::min(end - begin, ring - slot);
        visit(slot, count);
        begin += count;
    }
}

/// Frames and transitions are numbered consecutively; a number's slot is its remainder modulo the ring's
/// size. The action of a step is stored with the frame it was chosen on, the last one of the observation.
/// First in, first out: overwriting a frame removes all transitions up to the last one that uses it. Does not
/// check sizes.
struct FrameRing {
    /// Empty rings of the configured sizes.
    explicit FrameRing(const ReplayConfig& config);

    std::int64_t stack, action_size;         // frames of an observation; coordinates of an action, or 0
    std::int64_t frame_size;                 // bytes of a frame
    std::int64_t frames_capacity, capacity;  // slots for frames, and for transitions

    LazyArray<std::uint8_t> frames;            // [frames_capacity, H, W]
    LazyArray<float> actions;                  // [frames_capacity, action_size]
    LazyArray<std::int64_t> discrete_actions;  // [frames_capacity] if action_size is 0
    LazyArray<std::int64_t> users_end;  // [frames_capacity] last transition that uses this frame, plus 1
    FrameId frames_end = 0;             // frames ever stored

    LazyArray<FrameId> references;       // [capacity, 2, stack] observation, next observation
    LazyArray<float> n_step_returns;     // [capacity]
    LazyArray<float> discounts;          // [capacity]
    std::int64_t transitions_begin = 0;  // the oldest stored transition
    std::int64_t transitions_end = 0;    // transitions ever stored

    Hold held_frames, held_transitions;  // by a snapshot

    /// Returns the oldest stored frame.
    FrameId frames_begin() const { return std::max<FrameId>(frames_end - frames_capacity, 0); }
    /// Returns how many transitions are stored.
    std::int64_t size() const { return transitions_end - transitions_begin; }
    /// Returns whether a snapshot still reads it.
    bool is_held() const { return held_frames.is_held() || held_transitions.is_held(); }
    /// The frames of a transition: its observation's, then its next observation's.
    std::span<FrameId> frames_of(std::int64_t transition);
    std::span<const FrameId> frames_of(std::int64_t transition) const;  // the same

    /// Blocks while a snapshot holds the frame that is overwritten. Returns the new frame's number.
    FrameId push_frame(std::span<const std::uint8_t> pixels);
    /// Stores the action that was chosen on this frame.
    void push_action(FrameId frame, const Experience& experience);
    /// Does nothing if one of its frames has been overwritten.
    void push_transition(const Transition& transition);

    /// Copies a transition to row `row` of a batch of the right shapes.
    void copy(std::int64_t transition, Batch& batch, std::int64_t row) const;
    /// The same for what is not pixels.
    void copy_values(std::int64_t transition, Batch& batch, std::int64_t row) const;

    /// Recomputes users_end. Returns false if a transition uses a frame that is not stored.
    bool restore_users();

    /// Calls visit(pointer, values per number) for each array of the frames' ring.
    template <class Visit>
    void for_each_frame_array(const Visit& visit);
    /// The same for those of the transitions' ring.
    template <class Visit>
    void for_each_transition_array(const Visit& visit);

  private:
    void mark_users(std::int64_t transition);
    void copy_stack(std::span<const FrameId> shown, std::uint8_t* pixels) const;
};

template <class Visit>
void FrameRing::for_each_frame_array(const Visit& visit) {
    if (action_size > 0)
        visit(actions.data(), action_size);
    else
        visit(discrete_actions.data(), std::int64_t{1});
    visit(frames.data(), frame_size);
}

template <class Visit>
void FrameRing::for_each_transition_array(const Visit& visit) {
    visit(references.data(), 2 * stack);
    visit(n_step_returns.data(), std::int64_t{1});
    visit(discounts.data(), std::int64_t{1});
}

}  // namespace cale
