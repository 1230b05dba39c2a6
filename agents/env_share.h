// One process's share of the environments of all processes, and the matching part of a rollout.
#pragma once

#include <cstdint>
#include <vector>

#include "agents/agent.h"

namespace cale {

/// The environments first, ..., first + count - 1 of `all`. Every process draws the random numbers of all
/// environments, so that no draw depends on the number of processes.
struct EnvShare {
    /// The share of the process that the spec is for.
    explicit EnvShare(const AgentSpec& spec);
    /// All of `envs` environments: a single process.
    explicit EnvShare(std::int64_t envs) : count(envs), all(envs) {}

    /// Returns this process's rows of a tensor [all, ...].
    torch::Tensor own(const torch::Tensor& global) const;
    /// Returns a tensor [all, ...] with `own` [count, ...] in this process's rows and `filler` in the others.
    torch::Tensor among_all(const torch::Tensor& own, double filler) const;
    /// Returns those of the row indices [any] into T x `all` that are this process's, as indices into T x
    /// `count`.
    torch::Tensor own_rows(const torch::Tensor& rows) const;

    std::int64_t first = 0, count, all;
};

/// Merges Rollout::state() of every process, by rank, into that of one process with all environments. Empty
/// in, empty out.
TensorMap joined_rollouts(const std::vector<TensorMap>& shares);

/// The share of such a state. Throws std::runtime_error where it lacks a part or has another number of
/// environments.
TensorMap share_of_rollout(const TensorMap& whole, const EnvShare& share);

}  // namespace cale
