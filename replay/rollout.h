// What an on-policy agent learns from: the steps since its last update, in the order they were made.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <torch/types.h>

#include "cale/env.h"

namespace cale {

struct RolloutConfig {
    std::int64_t length = 1024;  // steps of each environment
    std::int64_t num_envs = 1;
    std::int64_t stack = 4;
    std::int64_t frame_height = 84;
    std::int64_t frame_width = 84;
    std::int64_t action_size = 3;  // continuous coordinates; 0: one discrete action
    double reward_scale = 1;
    std::optional<double> reward_clip = std::nullopt;  // before the scale
};

/// T steps of N environments, on the CPU.
struct Rollout {
    explicit Rollout(const RolloutConfig& config);

    /// What the actions of the next step are chosen on: [N, stack, H, W] uint8.
    void set_observations(const torch::Tensor& observations);

    /// The step that followed. Throws std::invalid_argument for other counts, and std::logic_error
    /// where the rollout is full.
    void add(const torch::Tensor& actions, std::span<const StepResult> results,
             std::span<const std::uint8_t> final_frames);

    bool full() const { return steps == config.length; }
    void clear();

    RolloutConfig config;
    std::int64_t steps = 0;     // so far
    torch::Tensor observation;  // [T, N, stack, H, W] uint8
    torch::Tensor action;       // [T, N, action_size] float32, or [T, N] int64
    torch::Tensor reward;       // [T, N] float32, clipped and scaled
    torch::Tensor terminal;     // [T, N] float32: 1 where the episode ended or was cut off

    /// Where an episode was cut off, and the observation [stack, H, W] that it was left with: what would have
    /// followed still counts.
    struct Truncation {
        std::int64_t step, env;
        torch::Tensor observation;
    };
    std::vector<Truncation> truncations;
};

}  // namespace cale
