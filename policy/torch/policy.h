// A trained policy: load a file, act.
//
//     const auto policy = cale::Policy::load("pong.safetensors");
//     torch::Tensor actions = policy.act(observations);
//
// Needs LibTorch. policy/policy_lite.h has the same without.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include <ATen/core/Generator.h>
#include <torch/types.h>

#include "policy/policy_info.h"

namespace cale {

/// Immutable once loaded: any number of threads may act with it at the same time. A copy shares the weights.
class Policy {
  public:
    Policy(const Policy&) = default;             // moving copies: what is moved from remains a policy
    Policy& operator=(const Policy&) = default;  // the same

    /// Reads a policy file (docs/policy_file.md) and checks all of it, including that its network reproduces
    /// the golden output on this device. Nothing in a file is executed: untrusted files are safe to open.
    /// Throws std::runtime_error, one sentence with the file's name and what is wrong with it.
    static Policy load(const std::filesystem::path& file, torch::Device device = torch::kCPU);
    /// The same for the contents of a file; `name` identifies it in errors.
    static Policy parse(std::string_view contents, const std::string& name = "policy",
                        torch::Device device = torch::kCPU);

    const PolicyInfo& info() const;  // all but the weights
    torch::Device device() const;    // where the network is

    /// The greedy actions for observations [N, stack, frame_height, frame_width] uint8 ([N, stack, bytes]
    /// where they are no frames) of any device: [N, 3] float32 (r, theta, fire), [N, coordinates] of another
    /// info().joystick (stick() leads to (r, theta, fire)), or [N] int64; on the CPU.
    /// Throws std::invalid_argument, naming both shapes, for anything else.
    torch::Tensor act(const torch::Tensor& observations) const;
    /// The same by `choice`, with the caller's generator (a CPU one). The draws are those of the agent's own
    /// evaluation, in the same order.
    torch::Tensor act(const torch::Tensor& observations, Choice choice, at::Generator random) const;

    /// The greedy decision on one observation of PolicyInfo::observation_size() bytes, as an Observer gives
    /// it.
    Decision act(std::span<const std::uint8_t> observation) const;
    /// The same by `choice`, with the caller's generator.
    Decision act(std::span<const std::uint8_t> observation, Choice choice, at::Generator random) const;

    /// Returns the network's output, float32 on the CPU: [N, 2 A] for the A coordinates of the joystick (the
    /// means of the Gaussian before the tanh, then the logarithms of its standard deviations), else [N, A]:
    /// log-probabilities, or action values.
    torch::Tensor output(const torch::Tensor& observations) const;
    /// Whether output() holds action values: discounted sums of the rewards that the agent learned from,
    /// clipped and scaled as in its settings.
    bool gives_action_values() const;

  private:
    Policy() = default;
    struct Impl;
    std::shared_ptr<const Impl> impl_;
};

}  // namespace cale
