#include "cale/cores.h"

#include <algorithm>
#include <numeric>
#include <thread>

#include <sched.h>

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

}  // namespace cale
