// Experience replay in the process that trains: every frame is stored once, stacks
// and n-step returns are made from it (Mnih et al. 2015; n-step: Sutton 1988).
#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <span>
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
};

/// One agent step of one environment: `reward` followed `action`, which was chosen on
/// the stack that ends with `frame`.
struct Experience {
    std::span<const std::uint8_t> frame;  // height x width
    std::span<const float> action;        // action_size coordinates (continuous)
    std::int64_t discrete_action = 0;     // (discrete)
    float reward = 0;
    bool terminal = false;
    bool truncated = false;
    std::span<const std::uint8_t> final_frame;  // the frame that followed, needed where truncated
};

/// B transitions. `discount` is 0 where the window met a terminal, gamma^steps otherwise,
/// so that a target is always n_step_return + discount * value(next_observation).
struct Batch {
    torch::Tensor observation;       // [B, stack, H, W] uint8, newest frame last
    torch::Tensor action;            // [B, action_size] float32, or [B] int64
    torch::Tensor n_step_return;     // [B] float32
    torch::Tensor discount;          // [B] float32
    torch::Tensor next_observation;  // [B, stack, H, W] uint8
    torch::Tensor index;             // [B] int64: where they are stored
};

/// Bytes that a buffer of this configuration takes once it is full.
std::int64_t memory_needed(const ReplayConfig& config);

class ReplayBuffer {
  public:
    /// Throws std::runtime_error, naming both figures and the key to lower, when the
    /// machine has less memory left than memory_needed(config).
    explicit ReplayBuffer(const ReplayConfig& config);
    ~ReplayBuffer();
    ReplayBuffer(ReplayBuffer&&) noexcept;
    ReplayBuffer& operator=(ReplayBuffer&&) noexcept;

    void add(std::int64_t env, const Experience& experience);

    std::int64_t size() const;       // transitions that can be sampled
    std::int64_t add_count() const;  // transitions ever stored

    /// Uniform with replacement over all stored transitions.
    Batch sample(std::int64_t batch_size, std::mt19937_64& random) const;
    /// The transitions at these positions, 0 being the oldest.
    Batch gather(std::span<const std::int64_t> positions) const;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
