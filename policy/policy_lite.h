// A trained policy without LibTorch: a few hundred kilobytes of code, no dependency but the C++ standard
// library.
//
//     const auto policy = cale::lite::Policy::load("pong.safetensors");
//     auto workspace = policy.workspace();
//     const cale::Decision decision = policy.act(observation, workspace);
//
// policy/torch/policy.h has the same with LibTorch. The numbers of both agree within 1e-4 of the largest of
// them (both round their sums in their own order), so the actions do wherever two actions are not that close
// to equal.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "policy/aligned.h"
#include "policy/policy_info.h"

namespace cale::lite {

struct InferencePlan;  // the network as this library computes it

/// Memory for the numbers inside a network on one or several observations, one per thread. Made by
/// Policy::workspace(), for that policy.
class Workspace {
  private:
    friend class Policy;
    std::shared_ptr<const InferencePlan> plan_;  // kept, so that no other plan is ever at its address
    Floats numbers_;
};

/// Immutable once loaded: any number of threads may act with it, each with its own workspace. A copy shares
/// the weights.
class Policy {
  public:
    Policy(const Policy&) = default;             // moving copies: what is moved from remains a policy
    Policy& operator=(const Policy&) = default;  // the same

    /// Reads a policy file (docs/policy_file.md) and checks all of it, including that its network reproduces
    /// the golden output. Nothing in a file is executed: untrusted files are safe to open. Throws
    /// std::runtime_error, one sentence with the file's name and what is wrong with it.
    static Policy load(const std::filesystem::path& file);
    /// The same for the contents of a file; `name` identifies it in errors.
    static Policy parse(std::string_view contents, const std::string& name = "policy");

    const PolicyInfo& info() const;  // all but the weights
    /// Numbers that the network gives for an observation: 2 A for the A coordinates of the joystick (the
    /// means of the Gaussian before the tanh, then the logarithms of its standard deviations), else one per
    /// action: log-probabilities, or action values.
    std::size_t output_size() const;
    /// Whether these numbers are action values.
    bool gives_action_values() const;

    /// Memory for one thread that acts with this policy, on up to so many observations at a time: they share
    /// each pass over the weights. Eight are worth it; more only cost memory. Throws std::invalid_argument
    /// for 0, std::length_error for more than any memory has room for, and std::bad_alloc.
    Workspace workspace(std::size_t observations = 1) const;

    /// The greedy decision on an observation [stack, frame_height, frame_width]. Allocates nothing.
    /// Throws std::invalid_argument for another number of bytes or another policy's workspace, and
    /// std::runtime_error where the network's numbers are not finite, as those of large weights can be.
    Decision act(std::span<const std::uint8_t> observation, Workspace& workspace) const;
    /// The same by `choice`, with the caller's generator.
    Decision act(std::span<const std::uint8_t> observation, Workspace& workspace, Choice choice,
                 std::mt19937_64& random) const;
    /// For N observations, one after another, N decisions: the same as one by one, and sooner where the
    /// workspace has room for several and no noise is drawn.
    void act(std::span<const std::uint8_t> observations, std::span<Decision> decisions,
             Workspace& workspace) const;
    /// The same by `choice`.
    void act(std::span<const std::uint8_t> observations, std::span<Decision> decisions, Workspace& workspace,
             Choice choice, std::mt19937_64& random) const;

    /// The network's output for one observation, which may be infinite or NaN; valid until the workspace is
    /// used again. Throws std::invalid_argument as act() does.
    std::span<const float> output(std::span<const std::uint8_t> observation, Workspace& workspace) const;
    /// That of the last observation acted on alone with this workspace, with the noise that was drawn.
    /// Says nothing where there is none, or a batch has come after it.
    std::span<const float> newest_output(const Workspace& workspace) const;

  private:
    std::span<const float> output(std::span<const std::uint8_t> observation, Workspace& workspace,
                                  std::mt19937_64* noise) const;
    explicit Policy(std::shared_ptr<const InferencePlan> plan) : plan_(std::move(plan)) {}
    std::shared_ptr<const InferencePlan> plan_;
};

/// Returns the decision for a draw u of a policy's Gaussian, before the tanh. Throws std::invalid_argument
/// unless it has as many numbers as the policy's joystick has coordinates, none of them NaN; also for
/// `factored`, which has none.
Decision squashed_decision(const PolicyInfo& info, std::span<const float> u);

/// The instruction set that this library computes with on this machine: "avx512", "avx2" or "portable".
std::string_view instruction_set();

}  // namespace cale::lite
