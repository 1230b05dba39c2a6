// The memory that an agent needs, computed before it is constructed.
#pragma once

#include <cstdint>
#include <string_view>

#include "agents/agent.h"

namespace cale {

/// The memory of a network and its target.
struct NetworkMemory {
    std::int64_t parameters;    // bytes of the network's parameters
    bool target;                // whether there is a target of the same size
    std::string_view settings;  // that reduce its size, for the error message
};

/// Returns the bytes of `available` that remain for the rest of the agent, after the parameters, their
/// gradients, Adam's two moments, the target, and the copies of them that a checkpoint is written from. On a
/// device other than the CPU only the copies count. Throws std::runtime_error, naming both figures and the
/// settings to lower, where they do not fit.
std::int64_t memory_beside(const NetworkMemory& networks, const AgentSpec& spec, std::int64_t available);

/// Throws std::runtime_error for insufficient memory: `what` needs `needed` bytes, and how to reduce that.
[[noreturn]] void refuse_memory(std::string_view what, std::int64_t needed, std::int64_t available,
                                std::string_view way_out);

}  // namespace cale
