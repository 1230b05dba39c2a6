// A replay's configuration as numbers with names: to be checked, and to be written into its files.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>

#include "cale/fields.h"
#include "replay/replay_buffer.h"

namespace cale {

/// One number of the configuration, under the name its user knows.
struct ReplayConfigEntry {
    const char* key;
    double value;
    Range range;
    std::span<const std::string_view> names = {};  // of an enumeration's values

    /// `number` as this entry's value.
    std::string text(double number) const;
};

std::array<ReplayConfigEntry, 10> entries(const ReplayConfig& config);

/// Throws std::invalid_argument, naming key, value and range, for an impossible configuration.
void validate(const ReplayConfig& config);

}  // namespace cale
