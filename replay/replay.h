// The interface of a replay: add steps, sample batches of transitions.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <random>

#include <ATen/core/Generator.h>
#include <torch/types.h>

#include "replay/types.h"

namespace cale {

struct FrameRing;
struct ReplayState;

/// Not thread-safe: the caller must prevent overlapping calls.
class Replay {
  public:
    virtual ~Replay() = default;

    virtual const ReplayConfig& config() const = 0;  // as it was made with

    /// Adds the next step of environment `env` and stores the transitions it completes. Environments may be
    /// interleaved in any order. A transition whose frames were overwritten before it was complete is not
    /// stored; this happens only if an environment pauses while others fill the buffer. Throws
    /// std::out_of_range for the environment, std::invalid_argument for a size that does not fit, or a
    /// missing final_frame (see Experience).
    virtual void add(std::int64_t env, const Experience& experience) = 0;

    /// Returns how many transitions can be sampled: at most `capacity`, and fewer where frames of the
    /// newest serve no transition of their own (after a truncation; with the reference's rules also in
    /// episodes shorter than the n-step return).
    virtual std::int64_t size() const = 0;
    /// Returns how many transitions were ever stored.
    virtual std::int64_t add_count() const = 0;

    /// Independent draws with replacement, the same on every platform.
    /// Uniform: for each one, 64 random bits w are drawn until w >= 2^64 mod size(), and w
    /// mod size() is its position (0: the oldest), so that it is exactly uniform.
    /// Prioritised: for each one, 64 random bits w are drawn, and its index is the first up to
    /// which the priorities sum to more than (w >> 11) * 2^-53 of their total. Its probability
    /// is its priority divided by that total, with no exponent and no strata: google/dopamine's
    /// form of Schaul et al. 2016. Where every priority is 0 it draws uniformly, as there.
    /// Throws std::runtime_error when nothing is stored.
    /// Writes into existing tensors, such as those of empty_batch(), without allocating; their size is the
    /// batch size. Throws std::invalid_argument unless they are contiguous tensors of Batch's shapes and
    /// types.
    virtual void sample_into(Batch& batch, std::mt19937_64& random) const = 0;
    /// Returns tensors for sample_into().
    virtual Batch empty_batch(std::int64_t batch_size) const = 0;

    /// Gives the transitions at `index`, [B] int64 as in Batch::index, these priorities, [B]
    /// float32 or float64; contiguous CPU tensors. Must be called before the next add(), which may reuse a
    /// slot. An index without a transition is ignored. For a repeated index the first priority counts. A new
    /// transition gets the largest priority ever given (including repeated ones), at least 1. Throws, and
    /// changes nothing: std::logic_error unless config().prioritised; std::invalid_argument for other
    /// tensors, and for a priority, which it names, outside [0, largest float32]; std::out_of_range for an
    /// index outside [0, capacity).
    virtual void set_priorities(const torch::Tensor& index, const torch::Tensor& priority) = 0;

    /// Returns the frames and transitions, valid until restore().
    virtual FrameRing& ring() = 0;
    /// Returns all other state.
    virtual ReplayState state() const = 0;
    /// Replaces the contents by a ring made with config() and its state. Throws std::logic_error while a
    /// snapshot of the current ring is being read.
    virtual void restore(std::unique_ptr<FrameRing> ring, ReplayState state) = 0;
};

/// Returns the batch with every observation moved by random_shift(), in memory of its own.
Batch randomly_shifted(Batch batch, std::int64_t pad, const at::Generator& random);

/// Returns a ReplayBuffer; see there.
std::unique_ptr<Replay> make_replay(const ReplayConfig& config, std::optional<torch::Device> mirror);

}  // namespace cale
