// A defect of the reference's PPO, for those who chase its curves.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>

#include <torch/types.h>

#include "world/step_result.h"

namespace cale {

/// After an update the reference pushes the frame before the newest onto its stack once more, where it stays
/// until the stack has been filled with newer ones or a new episode begins. One environment.
class RepeatedFrame {
  public:
    /// The frame [H * W] that the last action was chosen on, and what followed.
    void remember(std::span<const std::uint8_t> frame, const StepResult& result);
    /// An update happened.
    void push();
    /// What the reference sees of the next observations [1, stack, H, W] uint8.
    torch::Tensor next(const torch::Tensor& observations);

    /// By name; a frame that is not there is empty.
    std::map<std::string, torch::Tensor> state() const;
    /// Throws std::runtime_error, and changes nothing, for a state that lacks a part or has
    /// one of another kind.
    void restore(const std::map<std::string, torch::Tensor>& state);

  private:
    torch::Tensor previous_, repeated_;  // [H * W]
    std::int64_t newer_ = 0;             // frames pushed since
};

}  // namespace cale
