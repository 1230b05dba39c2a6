// Experience replay in the process that trains: every frame is stored once, stacks
// and n-step returns are made from it (Mnih et al. 2015; n-step: Sutton 1988).
#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <string_view>

#include <torch/types.h>

namespace cale {

/// What is stored at an episode's end.
///   corrected  every transition once, last reward included, full stacks; truncation bootstraps
///   dopamine   what google/dopamine's accumulator emits, defects included (its issue #228)
enum class ReplayTerminal { corrected, dopamine };
std::span<const std::string_view> names_of(ReplayTerminal);

struct ReplayConfig {
    std::int64_t capacity = 1'000'000;  // transitions
    std::int64_t num_envs = 1;
    std::int64_t stack = 4;
    std::int64_t frame_height = 84;
    std::int64_t frame_width = 84;
    std::int64_t action_size = 3;  // continuous coordinates; 0: one discrete action
    std::int64_t update_horizon = 1;
    double gamma = 0.99;
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;
    bool prioritised = false;  // sample by priority (Schaul et al. 2016), else uniformly
};

/// One agent step of one environment: `reward` followed `action`, which was chosen on
/// the stack that ends with `frame`.
struct Experience {
    std::span<const std::uint8_t> frame = {};  // height x width
    std::span<const float> action = {};        // action_size coordinates (continuous)
    std::int64_t discrete_action = 0;          // (discrete)
    float reward = 0;
    bool terminal = false;
    bool truncated = false;
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

/// Not synchronised: calls that overlap are the caller's to prevent, but for const ones.
class ReplayBuffer {
  public:
    /// Memory is taken as the buffer fills. Throws as memory_needed and, with what the
    /// machine has left (see available_memory), as check_memory do.
    explicit ReplayBuffer(const ReplayConfig& config);
    ~ReplayBuffer();
    ReplayBuffer(ReplayBuffer&&) noexcept;
    ReplayBuffer& operator=(ReplayBuffer&&) noexcept;

    const ReplayConfig& config() const;

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
    /// contiguous CPU tensors of Batch's shapes and types.
    void sample_into(Batch& batch, std::mt19937_64& random) const;
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

    /// Everything: the transitions, the counters, the unfinished windows and the priorities.
    /// The file appears complete or not at all. Throws std::runtime_error naming the file.
    void save(const std::string& path) const;
    /// Goes on exactly where save() was. Throws std::runtime_error, and leaves the buffer
    /// as it was, for a file that is damaged, truncated, of another version, or of
    /// another configuration. What the buffer held is in memory until the file proved good.
    void load(const std::string& path);

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
