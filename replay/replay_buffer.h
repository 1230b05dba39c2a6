// Experience replay in the process that trains: every frame is stored once, stacks
// and n-step returns are made from it (Mnih et al. 2015; n-step: Sutton 1988).
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include <torch/types.h>

#include "replay/accumulator.h"
#include "replay/frame_mirror.h"
#include "replay/frame_ring.h"
#include "replay/sum_tree.h"
#include "replay/types.h"

namespace cale {

/// The largest priority: what float32 can say. The sum of as many as there may be is far from overflowing.
inline constexpr double kMaxPriority = std::numeric_limits<float>::max();

/// What of a replay is neither frame nor transition.
struct ReplayState {
    FrameId frames_end = 0;                          // frames ever stored
    std::int64_t transitions_begin = 0;              // the oldest transition that is left
    std::int64_t transitions_end = 0;                // transitions ever stored
    std::vector<std::vector<StoredStep>> windows{};  // the unfinished one of each environment
    std::vector<double> priorities{};                // of each slot, if prioritised
    double largest_priority = 1;                     // that was ever given
};

/// Not synchronised: calls that overlap are the caller's to prevent, but for const ones without a mirror.
/// To write it to the disk and to read it: replay_snapshot.h.
class ReplayBuffer {
  public:
    /// Memory is taken as the buffer fills; whether there will be enough: replay_memory.h. Throws as
    /// validate() does.
    /// `mirror`: the device on which the frames are kept a second time, and observations put together (see
    /// FrameMirror). Batches then have `observation` and `next_observation` there, and the rest on the CPU.
    /// Throws std::runtime_error where that device lacks the memory.
    explicit ReplayBuffer(const ReplayConfig& config, std::optional<torch::Device> mirror = std::nullopt);

    const ReplayConfig& config() const { return config_; }  // as it was made with

    /// Takes the next step of environment `env` and stores the transitions it completes.
    /// Environments may be interleaved in any order. A transition whose frames were
    /// overwritten before it was complete is not stored; that takes an environment that
    /// pauses while others fill the buffer.
    /// Throws std::out_of_range for the environment, std::invalid_argument for a size
    /// that does not fit, or a missing final_frame.
    void add(std::int64_t env, const Experience& experience);

    /// Transitions that can be sampled: at most `capacity`, and fewer where one of the
    /// capacity newest frames serves no transition of its own (after a truncation).
    std::int64_t size() const { return ring_->size(); }
    /// Transitions ever stored.
    std::int64_t add_count() const { return ring_->transitions_end; }

    /// Independent draws with replacement, the same on every platform.
    /// Uniform: for each one, 64 random bits w are drawn until w >= 2^64 mod size(), and w
    /// mod size() is its position (0: the oldest), so that it is exactly uniform.
    /// Prioritised: for each one, 64 random bits w are drawn, and its index is the first up to
    /// which the priorities sum to more than (w >> 11) * 2^-53 of their total. Its probability
    /// is its priority divided by that total, with no exponent and no strata: google/dopamine's
    /// form of Schaul et al. 2016.
    /// Throws std::runtime_error when nothing is stored, or every priority is 0.
    Batch sample(std::int64_t batch_size, std::mt19937_64& random) const;
    /// The same into tensors that exist, such as those of empty_batch(), without
    /// allocating; they say how many. Throws std::invalid_argument unless they are
    /// contiguous tensors of Batch's shapes and types, on the CPU but for a mirror's.
    void sample_into(Batch& batch, std::mt19937_64& random) const;
    /// Tensors for sample_into().
    Batch empty_batch(std::int64_t batch_size) const;
    /// The transitions at these positions, 0 being the oldest; `probability` is that with
    /// which sample() would draw them. Throws std::out_of_range.
    Batch gather(std::span<const std::int64_t> positions) const;

    /// Gives the transitions at `index`, [B] int64 as in Batch::index, these priorities, [B]
    /// float32 or float64; contiguous CPU tensors. To be called before the next add(), which
    /// may put another transition in the same place. An index where no transition lies is
    /// ignored. Where one occurs twice, its first priority counts. A new transition enters
    /// with the largest priority that was ever given (those later ones included), at least 1.
    /// Throws, and changes nothing: std::logic_error unless config().prioritised;
    /// std::invalid_argument for other tensors, and for a priority, which it names, outside
    /// [0, largest float32]; std::out_of_range for an index outside [0, capacity).
    void set_priorities(const torch::Tensor& index, const torch::Tensor& priority);

    /// The frames and transitions, in their place in memory until restore().
    FrameRing& ring() { return *ring_; }
    /// Returns everything else that is stored.
    ReplayState state() const;
    /// Replaces the contents by a ring made with config(), and by what belongs to it. Throws std::logic_error
    /// while a snapshot of the present ring is read.
    void restore(std::unique_ptr<FrameRing> ring, ReplayState state);

  private:
    /// Returns [batch_size, stack, ...].
    std::vector<std::int64_t> stacks_shape(std::int64_t batch_size) const;
    void require_shapes(const Batch& batch) const;
    std::int64_t position_of(std::int64_t slot) const;
    double probability(std::int64_t position) const;
    torch::Device pixels_device() const { return mirror_ ? mirror_->device() : torch::kCPU; }
    void copy(std::int64_t position, Batch& batch, std::int64_t row) const;
    void sample_uniformly(Batch& batch, std::mt19937_64& random) const;
    void sample_by_priority(Batch& batch, std::mt19937_64& random) const;
    void follow_ring(std::int64_t begin, std::int64_t end);

    ReplayConfig config_;
    std::unique_ptr<FrameRing> ring_;
    std::vector<Accumulator> accumulators_;  // one per environment
    std::optional<SumTree> priorities_;      // if prioritised: of each slot, 0 where nothing lies
    double largest_priority_ = 1;            // that was ever given
    std::unique_ptr<FrameMirror> mirror_;    // or none
};

}  // namespace cale
