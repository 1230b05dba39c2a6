// A defect of the reference's PPO: what it finds in its replay, which loses an episode's last reward and
// repeats the step before it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include <torch/types.h>

#include "replay/accumulator.h"
#include "replay/rollout.h"

namespace cale {

/// A rollout of one environment, whose steps are what the reference's accumulator makes of them.
class DopamineRollout final : public Rollout {
  public:
    /// Throws std::invalid_argument for several environments.
    explicit DopamineRollout(const RolloutConfig& config);

    void clear() override;
    std::map<std::string, torch::Tensor> state() const override;
    void restore(const std::map<std::string, torch::Tensor>& state) override;

  private:
    /// A transition of the accumulator.
    struct Element {
        std::vector<FrameId> observation, next_observation;
        float reward = 0;
        float terminal = 0;
    };
    void store_observations(const torch::Tensor& observations) override;
    void store_step(const torch::Tensor& actions, std::span<const StepResult> results,
                    std::span<const std::uint8_t> final_frames) override;
    void lay_out_elements();
    torch::Tensor stacked(const std::vector<FrameId>& ids) const;

    torch::Tensor newest_;  // [stack, H, W] that the next action is chosen on
    Accumulator accumulator_;
    std::vector<torch::Tensor> frames_;         // by FrameId
    std::vector<torch::Tensor> frame_actions_;  // chosen on them
    std::vector<Element> elements_;
    std::size_t surplus_ = 0;  // elements beyond the rollout's length
};

}  // namespace cale
