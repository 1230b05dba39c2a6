// What other programs call the settings, for "did you mean".
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "settings/config.h"

namespace cale {

/// Another library's name of a setting, and ours.
struct PeerName {
    std::string_view name;  // "buffer_size"
    std::string_view key;   // "agent.replay_capacity"
};

/// Names of ALE, Gymnasium, Dopamine, CleanRL, Stable-Baselines3 and Tianshou. A name with several keys has
/// them in the order in which they are suggested.
std::span<const PeerName> peer_names();

/// The first of the entries' keys that a peer calls `name`; empty if none does.
std::string key_of_peer(std::string_view name, std::span<const ConfigEntry> entries);

}  // namespace cale
