// Experience replay in the process that trains: every frame is stored once, stacks
// and n-step returns are made from it (Mnih et al. 2015; n-step: Sutton 1988).
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string_view>

#include <torch/types.h>

namespace cale {

class ReplaySnapshot;

/// What is stored at an episode's end.
///   corrected  every transition once, last reward included, full stacks; truncation bootstraps
///   dopamine   what google/dopamine's accumulator emits, defects included (its issue #228)
enum class ReplayTerminal { corrected, dopamine };
std::span<const std::string_view> names_of(ReplayTerminal);

/// The defaults are those of 200 million frames.
struct ReplayConfig {
    std::int64_t capacity = 1'000'000;  // transitions
    std::int64_t num_envs = 1;          // that store here
    std::int64_t stack = 4;             // frames of an observation
    std::int64_t frame_height = 84;     // rows
    std::int64_t frame_width = 84;      // columns
    std::int64_t action_size = 3;       // continuous coordinates; 0: one discrete action
    std::int64_t update_horizon = 1;    // n of the n-step return
    double gamma = 0.99;                // discount per agent step
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;  // what is stored at an episode's end
    bool prioritised = false;  // sample by priority (Schaul et al. 2016), else uniformly
};

/// One agent step of one environment: `reward` followed `action`, which was chosen on
/// the stack that ends with `frame`.
struct Experience {
    std::span<const std::uint8_t> frame = {};        // height x width
    std::span<const float> action = {};              // action_size coordinates (continuous)
    std::int64_t discrete_action = 0;                // (discrete)
    float reward = 0;                                // of the step
    bool terminal = false;                           // nothing follows: no bootstrapping
    bool truncated = false;                          // cut off: what would have followed counts
    std::span<const std::uint8_t> final_frame = {};  // the frame that followed, needed where truncated
};

/// B transitions. `discount` is 0 where the window met a terminal, gamma^steps otherwise,
/// so that a target is always n_step_return + discount * value(next_observation).
struct Batch {
    torch::Tensor observation;       // [B, stack, H, W] uint8, newest frame last
    torch::Tensor action;            // [B, action_size] float32, or [B] int64
    torch::Tensor n_step_return;     // [B] float32
    torch::Tensor discount;          // [B] float32
    torch::Tensor next_observation;  // [B, stack, H, W] uint8
    torch::Tensor index;             // [B] int64: where they are stored, in [0, capacity)
    torch::Tensor probability = {};  // [B] float32: with which each one was drawn
};

/// Bytes that a buffer of this configuration takes once it is full. Throws
/// std::invalid_argument, naming key, value and range, for an impossible configuration.
std::int64_t memory_needed(const ReplayConfig& config);

/// Throws std::runtime_error, naming both figures and the key to lower, when the
/// `available` bytes are fewer than memory_needed(config).
void check_memory(const ReplayConfig& config, std::int64_t available);

/// Not synchronised: calls that overlap are the caller's to prevent, but for const ones without a mirror.
class ReplayBuffer {
  public:
    /// Memory is taken as the buffer fills. Throws as memory_needed and, with what the
    /// machine has left (see available_memory), as check_memory do.
    /// `mirror`: the device on which the frames are kept a second time, and observations put together (see
    /// FrameMirror). Batches then have `observation` and `next_observation` there, and the rest on the CPU.
    /// Throws std::runtime_error where that device lacks the memory.
    explicit ReplayBuffer(const ReplayConfig& config, std::optional<torch::Device> mirror = std::nullopt);
    ~ReplayBuffer();
    ReplayBuffer(ReplayBuffer&&) noexcept;
    ReplayBuffer& operator=(ReplayBuffer&&) noexcept;

    const ReplayConfig& config() const;  // as it was made with

    /// Takes the next step of environment `env` and stores the transitions it completes.
    /// Environments may be interleaved in any order. A transition whose frames were
    /// overwritten before it was complete is not stored; that takes an environment that
    /// pauses while others fill the buffer.
    /// Throws std::out_of_range for the environment, std::invalid_argument for a size
    /// that does not fit, or a missing final_frame.
    void add(std::int64_t env, const Experience& experience);

    /// Transitions that can be sampled: at most `capacity`, and fewer where one of the
    /// capacity newest frames serves no transition of its own (after a truncation).
    std::int64_t size() const;
    /// Transitions ever stored.
    std::int64_t add_count() const;

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

    /// What is stored now, to be written by another thread while this one goes on; see ReplaySnapshot.
    /// This buffer must outlive it. Throws std::logic_error while there is another.
    ReplaySnapshot snapshot();
    /// Writes everything: the transitions, the counters, the unfinished windows and the
    /// priorities. Throws std::runtime_error naming the file.
    void save(const std::filesystem::path& folder);
    /// Goes on exactly where save() was. Throws std::runtime_error, and leaves the buffer
    /// as it was, for a file that is missing, damaged, truncated, of another version, or of
    /// another configuration. What the buffer held is in memory until the files proved good.
    void load(const std::filesystem::path& folder);

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
