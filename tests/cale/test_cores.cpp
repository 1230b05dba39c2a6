#include "cale/cores.h"

#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include "cale/vector_env.h"

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

}  // namespace
}  // namespace cale
