#include "cale/text.h"

#include <cstdint>
#include <optional>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cale {
namespace {

TEST(Text, ANumberIsAllOfIt) {
    EXPECT_EQ(number_in<int>("42"), 42);
    EXPECT_EQ(number_in<int>("-42"), -42);
    EXPECT_EQ(number_in<double>("2.5e1"), 25);
    for (const std::string_view text : {"", " 1", "1 ", "1x", "1.5", "+1", "0x10", "2147483648"})
        EXPECT_EQ(number_in<int>(text), std::nullopt) << "'" << text << "'";
    EXPECT_EQ(number_in<std::uint64_t>("-1"), std::nullopt);
    EXPECT_EQ(number_in<double>("1e999"), std::nullopt);
}

TEST(Text, PartsBetweenSeparatorsMayBeEmpty) {
    using testing::ElementsAre;
    EXPECT_THAT(split("a,,b,", ','), ElementsAre("a", "", "b", ""));
    EXPECT_THAT(split("", ','), ElementsAre(""));
}

TEST(Text, LettersThatChangedPlacesAreOneMistake) {
    EXPECT_EQ(edit_distance("pong", "pong"), 0u);
    EXPECT_EQ(edit_distance("pnog", "pong"), 1u);
    EXPECT_EQ(edit_distance("png", "pong"), 1u);
    EXPECT_EQ(edit_distance("pongs", "pong"), 1u);
    EXPECT_EQ(edit_distance("", "pong"), 4u);
}

}  // namespace
}  // namespace cale
