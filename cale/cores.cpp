#include "cale/cores.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numeric>
#include <thread>

#include <sched.h>

#include "cale/control_groups.h"

namespace cale {

std::vector<int> usable_cores() {
    std::vector<int> cores;
    cpu_set_t usable;
    CPU_ZERO(&usable);
    if (::sched_getaffinity(0, sizeof(usable), &usable) == 0) {
        for (int core = 0; core < CPU_SETSIZE; ++core) {
            if (CPU_ISSET(core, &usable)) cores.push_back(core);
        }
    }
    if (cores.empty()) {  // a machine with more cores than a cpu_set_t has
        cores.resize(std::max(1u, std::thread::hardware_concurrency()));
        std::iota(cores.begin(), cores.end(), 0);
    }
    return cores;
}

std::size_t core_quota(const std::filesystem::path& root) {
    std::size_t least = 0;
    for (const auto& [group, version_2] : control_groups(root, "cpu")) {
        double time = 0, period = 0;  // microseconds
        if (version_2) {
            std::ifstream(group / "cpu.max") >> time >> period;  // "max 100000" is no limit
        } else {
            std::ifstream(group / "cpu.cfs_quota_us") >> time;  // -1 is none
            std::ifstream(group / "cpu.cfs_period_us") >> period;
        }
        if (time <= 0 || period <= 0) continue;
        const auto cores = static_cast<std::size_t>(std::ceil(time / period));
        least = least == 0 ? cores : std::min(least, cores);
    }
    return least;
}

std::int64_t core_count() {
    const auto cores = std::ssize(usable_cores());
    const auto quota = static_cast<std::int64_t>(core_quota());
    return quota > 0 ? std::min(cores, quota) : cores;
}

}  // namespace cale
