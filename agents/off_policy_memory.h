// The memory that an agent with a replay needs, computed before it is constructed.
#pragma once

#include <cstdint>

#include "agents/memory.h"
#include "agents/off_policy.h"
#include "networks/layers.h"
#include "replay/replay_memory.h"

namespace cale {

/// Returns the bytes of the largest tensor of a C51 projection, [batch, atoms, atoms]; 0 without one.
template <class Config>
std::int64_t projection_bytes(const Config& config) {
    std::int64_t atoms = 0;
    if constexpr (requires { config.distributional; }) atoms = config.distributional ? config.num_atoms : 0;
    if constexpr (requires { config.critic.atoms; })
        atoms = config.critic.atoms > 1 ? config.critic.atoms : 0;
    return 4 * config.replay.batch_size * atoms * atoms;
}

/// See agents/agent.h: of every agent with a replay whose make_network(config, spec, generator) has an
/// `acting` half. Names what is too large and the settings to lower: Config::kSizeSettings, the batch's or
/// the replay's.
template <class Config>
requires requires(const Config& config) {
    config.replay;
    Config::kSizeSettings;
}
void check_memory(const Config& config, const AgentSpec& spec, std::int64_t available) {
    const auto network = make_network(config, spec, no_values());
    const NetworkMemory networks{parameter_bytes(*network), /*target=*/true, Config::kSizeSettings};
    auto left = memory_beside_batch({*network, network->acting}, config.replay.batch_size, spec,
                                    memory_beside(networks, spec, available), "agent.batch_size");
    if (spec.device.is_cpu()) {
        const auto projection = projection_bytes(config);
        const bool critics = requires {
            config.critic.atoms;
        };
        if (projection > left)
            refuse_memory("C51's projection of a batch", projection, left,
                          critics ? "lower agent.batch_size or agent.critic_atoms"
                                  : "lower agent.batch_size or agent.num_atoms");
        left -= projection;
    }
    check_memory(replay_config(config.replay, spec, is_prioritised(config)), left,
                 /*mirrored=*/config.replay.replay_on_device && spec.device.is_cpu());
}

}  // namespace cale
