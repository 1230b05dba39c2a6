// The rollout of an on-policy agent: the steps since its last update, in order.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <torch/types.h>

#include "replay/types.h"
#include "world/spaces.h"
#include "world/step_result.h"

namespace cale {

/// The defaults are those of CALE's PPO.
struct RolloutConfig {
    std::int64_t length = 1024;                        // steps of each environment
    std::int64_t num_envs = 1;                         // that step together
    ObservationSpace observation = {};                 // its arrays are the frames
    std::int64_t action_size = 3;                      // continuous coordinates; 0: one discrete action
    double reward_scale = 1;                           // factor of the rewards
    std::optional<double> reward_clip = std::nullopt;  // before the scale
};

/// T steps of N environments, on the CPU.
class Rollout {
  public:
    /// Allocates all memory at once.
    explicit Rollout(const RolloutConfig& config);
    virtual ~Rollout() = default;

    /// Stores the observations that the next actions are chosen on: [N, stack, ...] uint8. Throws
    /// std::invalid_argument for another shape or type, and std::logic_error where the rollout is full.
    void set_observations(const torch::Tensor& observations);

    /// Stores the step that followed. Throws std::invalid_argument for other counts, a reward that is not
    /// finite or a final frame that is missing, and std::logic_error where the rollout is full.
    void add(const torch::Tensor& actions, std::span<const StepResult> results,
             std::span<const std::uint8_t> final_frames);

    /// Returns whether the rollout is complete.
    bool full() const { return steps == config.length; }
    /// Clears everything, an unfinished episode included.
    virtual void clear();

    /// Returns copies of the steps so far, by name.
    virtual std::map<std::string, torch::Tensor> state() const;
    /// Restores exactly what state() returned. Throws std::runtime_error, and changes nothing, for a state
    /// that is incomplete or of another configuration.
    virtual void restore(const std::map<std::string, torch::Tensor>& state);

    RolloutConfig config;       // as it was made with
    std::int64_t steps = 0;     // so far
    torch::Tensor observation;  // [T, N, stack, ...] uint8
    torch::Tensor action;       // [T, N, action_size] float32, or [T, N] int64
    torch::Tensor reward;       // [T, N] float32, clipped and scaled
    torch::Tensor terminal;     // [T, N] float32: 1 where the episode ended or was cut off
    /// The observations after the last step, [N, stack, ...], where they are not the next observations.
    torch::Tensor next_observation;

    /// A truncated episode and its final observation [stack, ...], whose value is bootstrapped.
    struct Truncation {
        std::int64_t step, env;     // where
        torch::Tensor observation;  // [stack, ...] uint8
    };
    std::vector<Truncation> truncations;  // of this rollout

  protected:
    /// Stores observations that fit.
    virtual void store_observations(const torch::Tensor& observations);
    /// Stores a step that fits.
    virtual void store_step(const torch::Tensor& actions, std::span<const StepResult> results,
                            std::span<const std::uint8_t> final_frames);
    /// Returns a reward clipped and scaled.
    float scaled(float value) const;
    /// Returns the tensor of that name, type and shape, in which -1 is any size. Throws std::runtime_error.
    static torch::Tensor part(const std::map<std::string, torch::Tensor>& state, const std::string& name,
                              at::ScalarType type, at::IntArrayRef shape);
};

}  // namespace cale
