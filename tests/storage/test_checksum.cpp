#include "storage/checksum.h"

#include <string>

#include <gtest/gtest.h>

namespace cale {
namespace {

TEST(Crc32c, AgreesWithRfc3720) {
    EXPECT_EQ(crc32c("123456789"), 0xE3069283u);
    EXPECT_EQ(crc32c(std::string(32, '\0')), 0x8A9136AAu);
    EXPECT_EQ(crc32c(std::string(32, '\xFF')), 0x62A8AB43u);
    EXPECT_EQ(crc32c(""), 0u);
}

}  // namespace
}  // namespace cale
