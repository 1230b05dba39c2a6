#include "storage/step_name.h"

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "support/temporary_folder.h"

namespace cale {
namespace {

TEST(StepName, IsReadBack) {
    for (const std::int64_t step : {0L, 1L, 250'000L, 1'234'567'890L})
        EXPECT_EQ(step_in(step_name(step)), step);
    EXPECT_EQ(step_name(250'000), "step_000250000");
    EXPECT_EQ(step_in("step_7"), 7);
    EXPECT_EQ(step_in("step_000250000.csv", ".csv"), 250'000);
}

TEST(StepName, OtherNamesHaveNoStep) {
    for (const auto* const name : {"", "step_", "step", "step_1.csv", "step_-5", "step_+5", "step_1x",
                                   "my_step_1", "step_99999999999999999999"})
        EXPECT_EQ(step_in(name), std::nullopt) << name;
    EXPECT_EQ(step_in("step_1_events.csv", ".csv"), std::nullopt);
    EXPECT_EQ(step_in("step_csv", "_csv"), std::nullopt);
}

TEST(StepName, NewestOfAFolder) {
    const test::TemporaryFolder folder;
    EXPECT_EQ(newest_step(folder.path() / "none"), std::nullopt);
    EXPECT_EQ(newest_step(folder.path()), std::nullopt);
    for (const auto* const name : {"step_9", "step_000000010", "step_11.partial"})
        std::filesystem::create_directory(folder.path() / name);
    std::ofstream(folder.path() / "step_000000012.csv");
    EXPECT_EQ(newest_step(folder.path()), 10);
    EXPECT_EQ(newest_step(folder.path(), ".csv"), 12);
    EXPECT_EQ(named_by_step(folder.path()),
              (std::vector{folder.path() / "step_9", folder.path() / "step_000000010"}));
    EXPECT_TRUE(named_by_step(folder.path() / "none").empty());
}

}  // namespace
}  // namespace cale
