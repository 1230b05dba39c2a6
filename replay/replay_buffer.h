// In-process experience replay: every frame is stored once; stacks and n-step returns are built from it (Mnih
// et al. 2015; n-step: Sutton 1988).
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
#include "replay/replay.h"
#include "replay/sum_tree.h"
#include "replay/types.h"

namespace cale {

/// The largest priority: the largest float32. The sum over a full replay cannot overflow.
inline constexpr double kMaxPriority = std::numeric_limits<float>::max();

/// The state of a replay besides frames and transitions.
struct ReplayState {
    FrameId frames_end = 0;                          // frames ever stored
    std::int64_t transitions_begin = 0;              // the oldest stored transition
    std::int64_t transitions_end = 0;                // transitions ever stored
    std::vector<std::vector<StoredStep>> windows{};  // the unfinished one of each environment
    std::vector<double> priorities{};                // of each slot, if prioritised
    double largest_priority = 1;                     // that was ever given
};

/// See Replay for what it overrides. Not thread-safe: the caller must prevent overlapping calls, except const
/// ones without a mirror. Saving and loading: replay_snapshot.h.
class ReplayBuffer final : public Replay {
  public:
    /// Memory is committed as the buffer fills; replay_memory.h checks whether it will suffice. Throws as
    /// validate() does. `mirror`: the device that holds a second copy of the frames and assembles
    /// observations (see FrameMirror). Batches then have `observation` and `next_observation` there, and the
    /// rest on the CPU. Throws std::runtime_error where that device lacks the memory.
    explicit ReplayBuffer(const ReplayConfig& config, std::optional<torch::Device> mirror = std::nullopt);

    const ReplayConfig& config() const override { return config_; }

    void add(std::int64_t env, const Experience& experience) override;
    std::int64_t size() const override { return ring_->size(); }
    std::int64_t add_count() const override { return ring_->transitions_end; }

    /// Returns a newly allocated batch, filled by sample_into().
    Batch sample(std::int64_t batch_size, std::mt19937_64& random) const;
    void sample_into(Batch& batch, std::mt19937_64& random) const override;
    Batch empty_batch(std::int64_t batch_size) const override;
    /// Returns the transitions at these positions, 0 being the oldest; `probability` is that with which
    /// sample() would draw them. Throws std::out_of_range.
    Batch gather(std::span<const std::int64_t> positions) const;

    void set_priorities(const torch::Tensor& index, const torch::Tensor& priority) override;

    FrameRing& ring() override { return *ring_; }
    ReplayState state() const override;
    void restore(std::unique_ptr<FrameRing> ring, ReplayState state) override;

  private:
    void require_shapes(const Batch& batch) const;
    std::int64_t position_of(std::int64_t slot) const;
    bool draws_by_priority() const { return priorities_ && priorities_->total() > 0; }
    double probability(std::int64_t position) const;
    torch::Device pixels_device() const { return mirror_ ? mirror_->device() : torch::kCPU; }
    void copy(std::int64_t position, Batch& batch, std::int64_t row) const;
    void sample_uniformly(Batch& batch, std::mt19937_64& random) const;
    void sample_by_priority(Batch& batch, std::mt19937_64& random) const;
    void follow_ring(std::int64_t begin, std::int64_t end);

    ReplayConfig config_;
    std::unique_ptr<FrameRing> ring_;
    std::vector<Accumulator> accumulators_;  // one per environment
    std::optional<SumTree> priorities_;      // if prioritised: by slot, 0 for an empty one
    double largest_priority_ = 1;            // ever given
    std::unique_ptr<FrameMirror> mirror_;    // or none
};

}  // namespace cale
