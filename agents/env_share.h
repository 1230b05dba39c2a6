// The environments that are one process's among those of all, and what of a rollout belongs to them.
#pragma once

#include <cstdint>
#include <vector>

#include "agents/agent.h"

namespace cale {

/// The environments first, ..., first + count - 1 of `all`. Whatever is drawn for environments is drawn for
/// all of them in every process, so that no draw depends on how many processes there are.
struct EnvShare {
    /// Of the process that the spec is for.
    explicit EnvShare(const AgentSpec& spec);
    /// All of `count`.
    explicit EnvShare(std::int64_t count_) : count(count_), all(count_) {}

    /// The own rows of a tensor [all, ...].
    torch::Tensor own(const torch::Tensor& global) const;
    /// A tensor [all, ...] in which `own` [count, ...] is in its place, and `filler` elsewhere.
    torch::Tensor among_all(const torch::Tensor& own, double filler) const;
    /// Of numbers of rows [any] in T x `all` those that are own, as numbers of rows in T x `count`.
    torch::Tensor own_rows(const torch::Tensor& rows) const;

    std::int64_t first = 0, count, all;
};

/// Rollout::state() of every process, by rank, as that of one process with all the environments. None: none.
TensorMap joined_rollouts(const std::vector<TensorMap>& shares);

/// The share of such a state. Throws std::runtime_error where it lacks a part or has another number of
/// environments.
TensorMap share_of_rollout(const TensorMap& whole, const EnvShare& share);

}  // namespace cale
