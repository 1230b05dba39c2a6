// How many of a network's units take no part any more.
//   Sokar et al. 2023, "The Dormant Neuron Phenomenon in Deep Reinforcement Learning"
#pragma once

#include <cstdint>
#include <optional>

#include "agents/agent.h"

namespace cale {

/// Returns the share of the units before the last layer of the acting network that are dormant on 64
/// observations drawn from the agent's replay with `seed`: those whose mean absolute activation is at most
/// 0.025 times the mean of their layer (definition 3.1; the units of a convolution are its channels). Changes
/// nothing. None for an agent without a replay, before its first transition, or without an exportable policy.
std::optional<double> dormant_share(Agent& agent, std::uint64_t seed);

}  // namespace cale
