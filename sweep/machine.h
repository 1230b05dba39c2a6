// How many runs a machine trains at once, and the cores and device of each.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "cale/cores.h"
#include "sweep/plan.h"

namespace cale {

/// What runs may use.
struct Machine {
    std::vector<int> cpus;    // usable_cores()
    std::int64_t memory = 0;  // bytes that are left
    int gpus = 0;             // that LibTorch can use
    std::size_t quota = 0;    // core_quota()

    /// The machine that this process is on; `gpus` is for the caller to fill in.
    static Machine here();
};

/// How runs share the machine.
struct Sharing {
    int jobs = 0;                        // runs at once; 0: computed
    int threads = 1;                     // of a run, at least 1
    std::int64_t memory_per_run = 0;     // bytes; 0: estimated
    std::vector<std::string> devices{};  // "cpu", "cuda:0", ...; empty: all GPUs, or the CPU if there is none
    int per_gpu = 1;                     // runs at once on a GPU, at least 1
};

/// A place for one run.
struct Slot {
    std::string device = "cpu";
    std::vector<int> cpus{};  // of its own, where runs fill a machine without a quota; else empty
};

/// The places for runs that are trained at once.
struct Slots {
    std::vector<Slot> slots;
    std::string reason;  // why that many: "2 cores, 1 thread a run"
};

/// Throws ConfigError where auto, or cpu beside another one, is among the devices.
void check_devices(std::span<const std::string> devices);

/// As many places as cores, memory and GPUs allow, one at least, and no more than there are runs; or as many
/// as `sharing.jobs`. Runs on one GPU after the other, so that a few runs are spread over all of them.
/// Throws as check_devices() does, and ConfigError for a device that find_device does not know or a GPU that
/// is not there.
Slots share(const Machine& machine, const Sharing& sharing, std::span<const PlannedRun> runs);

}  // namespace cale
