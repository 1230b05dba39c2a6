#include <array>

#include <gtest/gtest.h>

#include "storage/files.h"
#include "train/threads.h"

namespace cale {
namespace {

TEST(Threads, AreTakenAsLongAsTheyAreAQuarterFaster) {
    EXPECT_EQ(worthwhile_threads(std::array{ThreadTime{1, 1.0}}), 1);
    EXPECT_EQ(worthwhile_threads(std::array{ThreadTime{1, 1.0}, ThreadTime{2, 0.79}}), 2);
    EXPECT_EQ(worthwhile_threads(std::array{ThreadTime{1, 1.0}, ThreadTime{2, 0.81}}), 1);
    EXPECT_EQ(worthwhile_threads(std::array{ThreadTime{1, 1.0}, ThreadTime{2, 0.55}, ThreadTime{4, 0.30},
                                            ThreadTime{6, 0.29}}),
              4);
    // What comes after a step that gains too little does not count.
    EXPECT_EQ(worthwhile_threads(std::array{ThreadTime{1, 1.0}, ThreadTime{2, 0.9}, ThreadTime{4, 0.1}}), 1);
}

TEST(Threads, AMeasurementStaysWithinWhatItIsAllowed) {
    const int before = at::get_num_threads();
    EXPECT_EQ(measured_threads(1), 1);
    EXPECT_GE(measured_threads(2), 1);
    EXPECT_LE(measured_threads(2), 2);
    at::set_num_threads(before);
}

TEST(Threads, Bf16IsMultipliedWhereTheKernelListsTheInstructions) {
    const auto processor = read_file("/proc/cpuinfo");
    EXPECT_EQ(multiplies_bf16(), processor.find(" avx512_bf16") != processor.npos);
}

}  // namespace
}  // namespace cale
