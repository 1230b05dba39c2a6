// How much memory an agent takes, known before it is made.
#pragma once

#include <cstdint>
#include <string_view>

#include "agents/agent.h"
#include "agents/off_policy.h"
#include "networks/layers.h"
#include "replay/replay_memory.h"

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

/// See AgentSpec: of every agent with a replay that has make_network(config, spec, generator). Names what is
/// too large and the settings to lower: Config::kSizeSettings, or the replay's.
template <class Config>
requires requires(const Config& config) {
    config.replay;
    Config::kSizeSettings;
}
void check_memory(const Config& config, const AgentSpec& spec, std::int64_t available) {
    const auto network = make_network(config, spec, no_values());
    const NetworkMemory networks{parameter_bytes(*network), /*target=*/true, Config::kSizeSettings};
    check_memory(replay_config(config.replay, spec, is_prioritised(config)),
                 memory_beside(networks, spec, available));
}

/// Throws std::runtime_error with the sentence of memory that does not suffice: `what` needs `needed` bytes,
/// and the way out.
[[noreturn]] void refuse_memory(std::string_view what, std::int64_t needed, std::int64_t available,
                                std::string_view way_out);

}  // namespace cale
