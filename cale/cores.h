// The cores that a process may use.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace cale {

/// Numbers of the cores that the calling thread may use, in ascending order, at least one: those that
/// taskset, Slurm or a container's cpuset leaves it, which may be fewer than the machine has.
std::vector<int> usable_cores();

/// How many cores' time the control groups of this process grant (docker --cpus), rounded up; 0 where they do
/// not limit it. `root` is the folder that holds proc/ and sys/.
std::size_t core_quota(const std::filesystem::path& root = "/");

/// Returns how many threads can run at once: the number of usable cores, or the quota where that is less.
std::int64_t core_count();

}  // namespace cale
