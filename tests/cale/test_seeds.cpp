// What a seed derives may never change: every run depends on it.
#include "cale/seeds.h"

#include <cstdint>
#include <limits>

#include <gtest/gtest.h>

namespace cale {
namespace {

TEST(Seeds, AreThoseOfFnvAndSplitmix) {
    EXPECT_EQ(derive_seed(0, "", 0), 285029586U);
    EXPECT_EQ(derive_seed(1, "environment", 0), 831222590U);
    EXPECT_EQ(derive_seed(1, "environment", 3), 1315756550U);
    EXPECT_EQ(derive_seed(std::numeric_limits<std::uint64_t>::max(), "evaluation at", -1), 16454172U);
}

}  // namespace
}  // namespace cale
