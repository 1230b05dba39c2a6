#include "cale/cores.h"

#include <iterator>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include "cale/vector_env.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

TEST(Cores, AreThoseThatAreLeftToTheProcess) {
    EnvConfig many;
    many.num_envs = 8;
    const auto all = usable_cores();
    ASSERT_FALSE(all.empty());
    // An affinity is a thread's: the test's own stays.
    std::thread([&] {
        cpu_set_t last;
        CPU_ZERO(&last);
        CPU_SET(all.back(), &last);
        ASSERT_EQ(::sched_setaffinity(0, sizeof(last), &last), 0);
        EXPECT_THAT(usable_cores(), testing::ElementsAre(all.back()));
        EXPECT_EQ(VectorEnv::threads(many), 1);
    }).join();
    EXPECT_EQ(usable_cores(), all);
}

TEST(Cores, AreGrantedByTheSmallestQuotaOfTheControlGroups) {
    const test::TemporaryFolder root;
    EXPECT_EQ(core_quota(root.path()), 0u);
    root.write("proc/self/cgroup", "0::/job/step\n");
    root.write("sys/fs/cgroup/job/step/cpu.max", "max 100000\n");
    EXPECT_EQ(core_quota(root.path()), 0u);
    root.write("sys/fs/cgroup/job/cpu.max", "250000 100000\n");
    root.write("sys/fs/cgroup/cpu.max", "400000 100000\n");
    EXPECT_EQ(core_quota(root.path()), 3u);
    root.write("proc/self/cgroup", "3:cpuset:/x\n4:cpu,cpuacct:/of/the/host\n");
    root.write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n");
    root.write("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
    EXPECT_EQ(core_quota(root.path()), 0u);
    root.write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "50000\n");
    EXPECT_EQ(core_quota(root.path()), 1u);
}

TEST(Cores, CountNoMoreThanAreUsable) {
    EXPECT_GE(core_count(), 1);
    EXPECT_LE(core_count(), std::ssize(usable_cores()));
}

}  // namespace
}  // namespace cale
