#include "sweep/machine.h"

#include <algorithm>

#include <fmt/format.h>

#include "cale/text.h"
#include "replay/available_memory.h"
#include "settings/command_line.h"
#include "settings/config.h"

namespace cale {
namespace {

std::vector<std::string> devices_of(const Machine& machine, const Sharing& sharing) {
    check_devices(sharing.devices);
    std::vector<std::string> devices;
    const auto gpus = static_cast<std::uint64_t>(machine.gpus);
    // A GPU that is not there would fail every run, one after the other.
    for (const auto& name : sharing.devices) {
        auto device = find_device(name, gpus);
        if (device.is_cuda() && !device.has_index()) device.set_index(0);
        devices.push_back(device.str());
        if (std::ranges::count(devices, devices.back()) > 1)
            throw ConfigError(
                fmt::format("--device {} is given more than once; --per-gpu says how many runs share it",
                            devices.back()));
    }
    if (!devices.empty()) return devices;
    devices.reserve(static_cast<std::size_t>(machine.gpus));
    for (int gpu = 0; gpu < machine.gpus; ++gpu) devices.push_back(fmt::format("cuda:{}", gpu));
    if (devices.empty()) devices.emplace_back("cpu");
    return devices;
}

std::string gigabytes(std::int64_t bytes) {
    return fmt::format("{:.1f} GB", static_cast<double>(bytes) / 1e9);
}

}  // namespace

Machine Machine::here() {
    return {.cpus = usable_cores(), .memory = available_memory(), .quota = core_quota()};
}

void check_devices(std::span<const std::string> devices) {
    for (const auto& device : devices) {
        if (device == "auto")
            throw ConfigError("--device auto stands for all devices: give no other beside it");
        if (device == "cpu" && devices.size() > 1)
            throw ConfigError(
                "--device cpu: give no other beside it, as a sweep's runs share GPUs or have none");
    }
}

Slots share(const Machine& machine, const Sharing& sharing, std::span<const PlannedRun> runs) {
    const auto devices = devices_of(machine, sharing);
    const auto threads = static_cast<std::size_t>(sharing.threads);
    const auto memory = sharing.memory_per_run > 0 ? sharing.memory_per_run : largest_memory(runs);
    Slots result;
    const bool has_quota = machine.quota > 0 && machine.quota < machine.cpus.size();
    const auto cores = has_quota ? machine.quota : machine.cpus.size();
    auto jobs = std::max<std::size_t>(1, cores / threads);
    result.reason = fmt::format("{}{}, {} a run", counted(cores, "core"), has_quota ? " of the quota" : "",
                                counted(threads, "thread"));
    const auto limit = [&](std::size_t most, std::string reason) {
        if (most >= jobs) return;
        jobs = std::max<std::size_t>(1, most);
        result.reason = std::move(reason);
    };
    limit(static_cast<std::size_t>(machine.memory / memory),
          fmt::format("{} of memory, {} a run", gigabytes(machine.memory), gigabytes(memory)));
    if (devices.front() != "cpu") {
        const auto gpus = devices.size();
        limit(gpus * static_cast<std::size_t>(sharing.per_gpu),
              fmt::format("{}, {} on each", counted(gpus, "GPU"), counted(sharing.per_gpu, "run")));
    }
    if (sharing.jobs > 0) {
        jobs = static_cast<std::size_t>(sharing.jobs);
        result.reason = "--jobs";
    }
    limit(runs.size(), "all of them");

    // Only where the sweep fills the machine: beside other work the kernel places runs better.
    const bool own_cores = !has_quota && jobs * threads <= cores && (jobs + 1) * threads > cores;
    for (std::size_t job = 0; job < jobs; ++job) {
        Slot slot{.device = devices[job % devices.size()]};
        if (own_cores) {
            const auto first = machine.cpus.begin() + static_cast<std::ptrdiff_t>(job * threads);
            slot.cpus.assign(first, first + static_cast<std::ptrdiff_t>(threads));
        }
        result.slots.push_back(std::move(slot));
    }
    return result;
}

}  // namespace cale
