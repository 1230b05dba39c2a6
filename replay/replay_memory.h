// The memory that a replay needs, computed before it is constructed.
#pragma once

#include <cstdint>

#include "replay/types.h"

namespace cale {

/// Returns the bytes that a full buffer of this configuration takes, `mirrored`: with a second copy of its
/// frames in the same memory. Throws std::invalid_argument, naming key, value and range, for an impossible
/// configuration.
std::int64_t memory_needed(const ReplayConfig& config, bool mirrored = false);

/// Throws std::runtime_error, naming both figures and the key to lower, when the `available` bytes are fewer
/// than memory_needed(config, mirrored).
void check_memory(const ReplayConfig& config, std::int64_t available, bool mirrored = false);

}  // namespace cale
