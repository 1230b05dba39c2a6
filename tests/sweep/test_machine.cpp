// How many runs at once, and where.
#include "sweep/machine.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "settings/config.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::int64_t kGigabyte = 1'000'000'000;

std::vector<PlannedRun> runs_of(std::size_t count, std::int64_t memory = kGigabyte) {
    std::vector<PlannedRun> runs(count);
    for (auto& run : runs) run.memory = memory;
    return runs;
}

std::vector<std::string> devices(const Slots& slots) {
    std::vector<std::string> result;
    for (const auto& slot : slots.slots) result.push_back(slot.device);
    return result;
}

const Machine kFourCores{.cpus = {2, 3, 6, 7}, .memory = 64 * kGigabyte};

TEST(Sharing, ARunPerCoreEachWithItsOwn) {
    const auto slots = share(kFourCores, {}, runs_of(100));
    ASSERT_EQ(slots.slots.size(), 4u);
    EXPECT_EQ(slots.reason, "4 cores, 1 thread a run");
    EXPECT_THAT(slots.slots[2].cpus, ElementsAre(6));
    const auto wide = share(kFourCores, {.threads = 2}, runs_of(100));
    ASSERT_EQ(wide.slots.size(), 2u);
    EXPECT_THAT(wide.slots[1].cpus, ElementsAre(6, 7));
}

TEST(Sharing, OneRunAtLeastAndNoMoreThanThereAre) {
    EXPECT_EQ(share(kFourCores, {.threads = 16}, runs_of(100)).slots.size(), 1u);
    const auto few = share(kFourCores, {}, runs_of(2));
    ASSERT_EQ(few.slots.size(), 2u);
    EXPECT_THAT(few.slots[0].cpus, IsEmpty()) << "they leave cores free, so the kernel may choose";
}

TEST(Sharing, MemoryLimits) {
    EXPECT_EQ(share(kFourCores, {}, runs_of(100, 20 * kGigabyte)).slots.size(), 3u);
    EXPECT_EQ(share(kFourCores, {}, runs_of(100, 20 * kGigabyte)).reason, "64.0 GB of memory, 20.0 GB a run");
    EXPECT_EQ(share(kFourCores, {.memory_per_run = kGigabyte}, runs_of(100, 20 * kGigabyte)).slots.size(),
              4u);
    EXPECT_EQ(share(kFourCores, {}, runs_of(100, 100 * kGigabyte)).slots.size(), 1u)
        << "the run says it better";
}

TEST(Sharing, JobsGoBeforeAll) {
    const auto slots = share(kFourCores, {.jobs = 6}, runs_of(100));
    ASSERT_EQ(slots.slots.size(), 6u);
    EXPECT_THAT(slots.slots[0].cpus, IsEmpty()) << "there are not enough to go round";
}

TEST(Sharing, CudaDevicesTakeTurns) {
    Machine machine = kFourCores;
    machine.gpus = 2;
    EXPECT_THAT(devices(share(machine, {}, runs_of(100))), ElementsAre("cuda:0", "cuda:1"));
    EXPECT_THAT(devices(share(machine, {.per_gpu = 2}, runs_of(3))),
                ElementsAre("cuda:0", "cuda:1", "cuda:0"));
    EXPECT_THAT(devices(share(machine, {.devices = {"cuda:1"}}, runs_of(100))), ElementsAre("cuda:1"));
    EXPECT_EQ(share(machine, {.devices = {"cpu"}}, runs_of(100)).slots.size(), 4u);
}

TEST(Sharing, AQuotaOfTheirTimeLimitsCores) {
    Machine machine = kFourCores;
    machine.quota = 3;
    auto slots = share(machine, {}, runs_of(100));
    EXPECT_EQ(slots.slots.size(), 3u);
    EXPECT_EQ(slots.reason, "3 cores of the quota, 1 thread a run");
    EXPECT_THAT(slots.slots[0].cpus, IsEmpty()) << "others have the same cores";
    machine.quota = 8;
    EXPECT_EQ(share(machine, {}, runs_of(100)).reason, "4 cores, 1 thread a run");
}

TEST(Sharing, RefusesWhatIsNoDevice) {
    for (const std::string device : {"gpu", "cuda:", "cuda:x", ""})
        EXPECT_THAT(
            test::error_of<ConfigError>([&] { share(kFourCores, {.devices = {device}}, runs_of(1)); }),
            testing::HasSubstr("--device must be auto, cpu, cuda or cuda:<index>, not '" + device + "'"));
}

TEST(Sharing, RefusesACudaDeviceThatIsNotThere) {
    const auto mistake = [](int gpus, const std::string& device) {
        Machine machine = kFourCores;
        machine.gpus = gpus;
        return test::error_of<ConfigError>([&] { share(machine, {.devices = {device}}, runs_of(1)); });
    };
    EXPECT_EQ(mistake(0, "cuda:0"),
              "--device cuda:0: this LibTorch finds no CUDA device; use --device cpu, or scripts/setup "
              "--cuda on a machine with an NVIDIA GPU");
    EXPECT_THAT(mistake(0, "cuda"), testing::HasSubstr("LibTorch finds no CUDA device"));
    EXPECT_EQ(mistake(2, "cuda:2"),
              "--device cuda:2: cuda:2 is not there; this machine has 2, counted from 0");
    EXPECT_THAT(mistake(1, "cuda:99999999999"), testing::HasSubstr("this machine has 1, counted from 0"));
    EXPECT_EQ(mistake(1, "auto"), "--device auto stands for all devices: give no other beside it");
    EXPECT_EQ(mistake(1, "cuda"), "no error");
    EXPECT_EQ(test::error_of<ConfigError>([] {
                  share(kFourCores, {.devices = {"cpu", "cuda:0"}}, runs_of(1));
              }),
              "--device cpu: give no other beside it, as a sweep's runs share GPUs or have none");
    EXPECT_EQ(mistake(2, "cuda:1"), "no error");
    EXPECT_EQ(test::error_of<ConfigError>([] {
                  Machine machine = kFourCores;
                  machine.gpus = 2;
                  share(machine, {.devices = {"cuda", "cuda:1", "cuda:0"}}, runs_of(1));
              }),
              "--device cuda:0 is given more than once; --per-gpu says how many runs share it");
}

TEST(Sharing, KnowsThisMachine) {
    const auto machine = Machine::here();
    EXPECT_FALSE(machine.cpus.empty());
    EXPECT_GT(machine.memory, 0);
}

}  // namespace
}  // namespace cale
