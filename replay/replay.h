// What an agent knows of its memory: steps go in, batches of transitions come out.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include <torch/types.h>

#include "replay/types.h"

namespace cale {

class FrameRing;

/// What of a replay is neither frame nor transition.
struct ReplayState {
    FrameId frames_end = 0;                          // frames ever stored
    std::int64_t transitions_begin = 0;              // the oldest transition that is left
    std::int64_t transitions_end = 0;                // transitions ever stored
    std::vector<std::vector<StoredStep>> windows{};  // the unfinished one of each environment
    std::vector<double> priorities{};                // of each slot, if prioritised
    double largest_priority = 1;                     // that was ever given
};

/// Not synchronised: calls that overlap are the caller's to prevent.
class Replay {
  public:
    virtual ~Replay() = default;

    virtual const ReplayConfig& config() const = 0;  // as it was made with

    /// Takes the next step of environment `env` and stores the transitions it completes.
    /// Environments may be interleaved in any order. A transition whose frames were
    /// overwritten before it was complete is not stored; that takes an environment that
    /// pauses while others fill the buffer.
    /// Throws std::out_of_range for the environment, std::invalid_argument for a size
    /// that does not fit, or a missing final_frame.
    virtual void add(std::int64_t env, const Experience& experience) = 0;

    /// Returns how many transitions can be sampled: at most `capacity`, and fewer where one of the
    /// capacity newest frames serves no transition of its own (after a truncation).
    virtual std::int64_t size() const = 0;
    /// Returns how many transitions were ever stored.
    virtual std::int64_t add_count() const = 0;

    /// Independent draws with replacement, the same on every platform.
    /// Uniform: for each one, 64 random bits w are drawn until w >= 2^64 mod size(), and w
    /// mod size() is its position (0: the oldest), so that it is exactly uniform.
    /// Prioritised: for each one, 64 random bits w are drawn, and its index is the first up to
    /// which the priorities sum to more than (w >> 11) * 2^-53 of their total. Its probability
    /// is its priority divided by that total, with no exponent and no strata: google/dopamine's
    /// form of Schaul et al. 2016.
    /// Throws std::runtime_error when nothing is stored, or every priority is 0.
    /// They go into tensors that exist, such as those of empty_batch(), without allocating; they say how
    /// many. Throws std::invalid_argument unless they are contiguous tensors of Batch's shapes and types.
    virtual void sample_into(Batch& batch, std::mt19937_64& random) const = 0;
    /// Returns tensors for sample_into().
    virtual Batch empty_batch(std::int64_t batch_size) const = 0;

    /// Gives the transitions at `index`, [B] int64 as in Batch::index, these priorities, [B]
    /// float32 or float64; contiguous CPU tensors. To be called before the next add(), which
    /// may put another transition in the same place. An index where no transition lies is
    /// ignored. Where one occurs twice, its first priority counts. A new transition enters
    /// with the largest priority that was ever given (those later ones included), at least 1.
    /// Throws, and changes nothing: std::logic_error unless config().prioritised;
    /// std::invalid_argument for other tensors, and for a priority, which it names, outside
    /// [0, largest float32]; std::out_of_range for an index outside [0, capacity).
    virtual void set_priorities(const torch::Tensor& index, const torch::Tensor& priority) = 0;

    /// The frames and transitions, in their place in memory until restore().
    virtual FrameRing& ring() = 0;
    /// Returns everything else that is stored.
    virtual ReplayState state() const = 0;
    /// Replaces the contents by a ring made with config(), and by what belongs to it. Throws std::logic_error
    /// while a snapshot of the present ring is read.
    virtual void restore(std::unique_ptr<FrameRing> ring, ReplayState state) = 0;
};

/// Returns a ReplayBuffer; see there.
std::unique_ptr<Replay> make_replay(const ReplayConfig& config, std::optional<torch::Device> mirror);

}  // namespace cale
