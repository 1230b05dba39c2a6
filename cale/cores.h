// The cores that a process may use.
#pragma once

#include <vector>

namespace cale {

/// Numbers of the cores that the calling thread may use, in ascending order, at least one: those that
/// taskset, Slurm or a container leaves it, which may be fewer than the machine has.
std::vector<int> usable_cores();

}  // namespace cale
