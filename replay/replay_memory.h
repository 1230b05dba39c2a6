// The memory that a replay needs, computed before it is constructed.
#pragma once

#include <cstdint>

#include "replay/types.h"

namespace cale {

/// Returns the bytes that a full buffer of this configuration takes. Throws std::invalid_argument, naming
/// key, value and range, for an impossible configuration.
std::int64_t memory_needed(const ReplayConfig& config);

/// Throws std::runtime_error, naming both figures and the key to lower, when the
/// `available` bytes are fewer than memory_needed(config).
void check_memory(const ReplayConfig& config, std::int64_t available);

}  // namespace cale
