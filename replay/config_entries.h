// The numbers of a replay's configuration, each with its key and its range: for checks and for files.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

#include "cale/fields.h"
#include "replay/types.h"

namespace cale {

/// One number of a configuration, with the key of its setting.
struct ReplayConfigEntry {
    const char* key;                               // such as agent.replay_capacity
    double value;                                  // of this configuration
    Range range;                                   // of possible values
    std::span<const std::string_view> names = {};  // of an enumeration's values

    /// Returns `number` as this entry's value is written.
    std::string text(double number) const;
};
/// Returns all of them, in the order of a replay's files.
std::array<ReplayConfigEntry, 10> entries(const ReplayConfig& config);

/// Throws std::invalid_argument, naming key, value and range, for an impossible configuration.
void validate(const ReplayConfig& config);

}  // namespace cale
