// The replay's common types: configuration, steps in, batches out.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include <torch/types.h>

#include "world/spaces.h"
#include "world/step_result.h"

namespace cale {

/// What is stored at an episode's end.
///   corrected  every transition once, last reward included, full stacks; truncation bootstraps
///   dopamine   what google/dopamine's accumulator emits, defects included (its issue #228)
enum class ReplayTerminal { corrected, dopamine };
std::span<const std::string_view> names_of(ReplayTerminal);

/// The defaults are those of 200 million frames.
struct ReplayConfig {
    std::int64_t capacity = 1'000'000;  // transitions
    std::int64_t num_envs = 1;          // that store here
    ObservationSpace observation = {};  // its arrays are the frames
    std::int64_t action_size = 3;       // continuous coordinates; 0: one discrete action
    std::int64_t update_horizon = 1;    // n of the n-step return
    double gamma = 0.99;                // discount per agent step
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;  // what is stored at an episode's end
    bool prioritised = false;  // sample by priority (Schaul et al. 2016), else uniformly
};

/// One agent step of one environment: `reward` followed `action`, which was chosen on
/// the stack that ends with `frame`.
struct Experience {
    std::span<const std::uint8_t> frame = {};  // of ObservationSpace::frame_size() bytes
    std::span<const float> action = {};        // action_size coordinates (continuous)
    std::int64_t discrete_action = 0;          // (discrete)
    float reward = 0;                          // of the step
    bool terminal = false;                     // nothing follows: no bootstrapping
    bool truncated = false;                    // cut off: bootstraps
    /// The frame that followed. Needed where truncated and not terminal, unless by ReplayTerminal::dopamine.
    std::span<const std::uint8_t> final_frame = {};
};

/// B transitions. `discount` is 0 where the window contains a terminal, gamma^steps otherwise, so that a
/// target is always n_step_return + discount * value(next_observation).
struct Batch {
    torch::Tensor observation;       // [B, stack, ...] uint8, newest frame last
    torch::Tensor action;            // [B, action_size] float32, or [B] int64
    torch::Tensor n_step_return;     // [B] float32
    torch::Tensor discount;          // [B] float32
    torch::Tensor next_observation;  // [B, stack, ...] uint8
    torch::Tensor index;             // [B] int64: where they are stored, in [0, capacity)
    torch::Tensor probability = {};  // [B] float32: with which each one was drawn
};

/// Throws std::invalid_argument, naming the environment and the value, for a reward that is no finite number.
void require_finite_rewards(std::span<const StepResult> results);

}  // namespace cale
