// The memory that an agent with a replay needs, computed before it is constructed.
#pragma once

#include <cstdint>

#include "agents/memory.h"
#include "agents/off_policy.h"
#include "networks/layers.h"
#include "replay/replay_memory.h"

namespace cale {

/// See AgentSpec: of every agent with a replay whose make_network(config, spec, generator) has an `acting`
/// half. Names what is too large and the settings to lower: Config::kSizeSettings, the batch's or the
/// replay's.
template <class Config>
requires requires(const Config& config) {
    config.replay;
    Config::kSizeSettings;
}
void check_memory(const Config& config, const AgentSpec& spec, std::int64_t available) {
    const auto network = make_network(config, spec, no_values());
    const NetworkMemory networks{parameter_bytes(*network), /*target=*/true, Config::kSizeSettings};
    const auto left = memory_beside_batch({*network, network->acting}, config.replay.batch_size, spec,
                                          memory_beside(networks, spec, available), "agent.batch_size");
    check_memory(replay_config(config.replay, spec, is_prioritised(config)), left,
                 /*mirrored=*/config.replay.replay_on_device && spec.device.is_cpu());
}

}  // namespace cale
