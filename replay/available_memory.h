// How much memory this process may still take.
#pragma once

#include <cstdint>
#include <filesystem>

namespace cale {

/// Bytes that can be taken without swapping: the kernel's MemAvailable, or what is left of a control group's
/// limit (version 1 or 2: containers, batch systems) or of the process's own (`ulimit -v`) where that is
/// less. `root` is the folder that holds proc/ and sys/. A figure that cannot be read does not count; the
/// largest std::int64_t when none can.
std::int64_t available_memory(const std::filesystem::path& root = "/");

}  // namespace cale
