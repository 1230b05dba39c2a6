// How much memory an agent takes, known before it is made.
#pragma once

#include <cstdint>
#include <string_view>

#include "agents/agent.h"

namespace cale {

/// A network and what is kept beside it.
struct NetworkMemory {
    std::int64_t parameters;    // bytes of the network's parameters
    bool target;                // whether a target of the same size is kept
    std::string_view settings;  // which make it smaller, for the sentence
};

/// Bytes of `available` that are left for the rest of the agent: the parameters, their gradients, Adam's two
/// moments and the target are subtracted, and the copies of them that a checkpoint is written from. On
/// another device than the CPU the copies alone count. Throws std::runtime_error, naming both figures and the
/// settings to lower, where they do not fit.
std::int64_t memory_beside(const NetworkMemory& networks, const AgentSpec& spec, std::int64_t available);

/// Throws std::runtime_error with the sentence of memory that does not suffice: `what` needs `needed` bytes,
/// and the way out.
[[noreturn]] void refuse_memory(std::string_view what, std::int64_t needed, std::int64_t available,
                                std::string_view way_out);

}  // namespace cale
