// What an on-policy agent learns from: the steps since its last update, in the order they were made.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <torch/types.h>

#include "cale/env.h"
#include "replay/accumulator.h"

namespace cale {

/// The defaults are those of CALE's PPO.
struct RolloutConfig {
    std::int64_t length = 1024;                        // steps of each environment
    std::int64_t num_envs = 1;                         // that step together
    std::int64_t stack = 4;                            // frames of an observation
    std::int64_t frame_height = 84;                    // rows
    std::int64_t frame_width = 84;                     // columns
    std::int64_t action_size = 3;                      // continuous coordinates; 0: one discrete action
    double reward_scale = 1;                           // factor of the rewards
    std::optional<double> reward_clip = std::nullopt;  // before the scale
    /// corrected: every step once. dopamine: what the reference's PPO finds in its replay, which loses an
    /// episode's last reward and repeats the step before it; for one environment.
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;
};

/// T steps of N environments, on the CPU.
class Rollout {
  public:
    /// Throws std::invalid_argument for the dopamine rule with several environments.
    explicit Rollout(const RolloutConfig& config);

    /// What the actions of the next step are chosen on: [N, stack, H, W] uint8; bytes that are no image
    /// may come as [N, stack, W], with H = 1.
    void set_observations(const torch::Tensor& given);

    /// The step that followed. Throws std::invalid_argument for other counts, and std::logic_error
    /// where the rollout is full.
    void add(const torch::Tensor& actions, std::span<const StepResult> results,
             std::span<const std::uint8_t> final_frames);

    /// Whether every environment has made its steps.
    bool full() const { return steps == config.length; }
    /// Forgets everything, an unfinished episode included.
    void clear();

    /// The steps so far, by name, in memory of their own.
    std::map<std::string, torch::Tensor> state() const;
    /// Goes on exactly where state() was. Throws std::runtime_error, and changes nothing, for a state that
    /// lacks a part or is of another configuration.
    void restore(const std::map<std::string, torch::Tensor>& state);

    RolloutConfig config;       // as it was made with
    std::int64_t steps = 0;     // so far
    torch::Tensor observation;  // [T, N, stack, H, W] uint8
    torch::Tensor action;       // [T, N, action_size] float32, or [T, N] int64
    torch::Tensor reward;       // [T, N] float32, clipped and scaled
    torch::Tensor terminal;     // [T, N] float32: 1 where the episode ended or was cut off
    /// What follows the last step, [1, stack, H, W]: defined by the dopamine rule only, in a full rollout.
    torch::Tensor next_observation;

    /// Where an episode was cut off, and the observation [stack, H, W] that it was left with: what would have
    /// followed still counts.
    struct Truncation {
        std::int64_t step, env;     // where
        torch::Tensor observation;  // [stack, H, W] uint8
    };
    std::vector<Truncation> truncations;  // of this rollout

  private:
    /// A transition of the dopamine rule.
    struct Element {
        std::vector<FrameId> observation, next_observation;
        float reward = 0;
        float terminal = 0;
    };
    void add_by_dopamines_rule(const torch::Tensor& chosen, float scaled_reward, const StepResult& result);
    void lay_out_elements();
    std::map<std::string, torch::Tensor> state_by_dopamines_rule() const;
    void restore_by_dopamines_rule(const std::map<std::string, torch::Tensor>& state);
    torch::Tensor stacked(const std::vector<FrameId>& ids) const;

    torch::Tensor newest_;  // [stack, H, W] that the next action is chosen on
    Accumulator accumulator_;
    std::vector<torch::Tensor> frames_;         // by FrameId
    std::vector<torch::Tensor> frame_actions_;  // chosen on them
    std::vector<Element> elements_;
    std::size_t surplus_ = 0;  // elements beyond the rollout's length
};

}  // namespace cale
