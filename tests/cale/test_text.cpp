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

TEST(Text, ANounFollowsItsNumber) {
    EXPECT_EQ(counted(0, "run"), "0 runs");
    EXPECT_EQ(counted(1, "run"), "1 run");
    EXPECT_EQ(counted(std::size_t{2}, "game"), "2 games");
}

TEST(Text, NumbersInWordsAreComparedAsNumbers) {
    EXPECT_TRUE(natural_less("n=3", "n=10"));
    EXPECT_FALSE(natural_less("n=10", "n=3"));
    EXPECT_TRUE(natural_less("tau=0.25", "tau=0.3"));
    EXPECT_TRUE(natural_less("n=3", "n=3, der"));
    EXPECT_FALSE(natural_less("n=3", "n=3"));
}

TEST(Text, LettersThatChangedPlacesAreOneMistake) {
    EXPECT_EQ(edit_distance("pong", "pong"), 0u);
    EXPECT_EQ(edit_distance("pnog", "pong"), 1u);
    EXPECT_EQ(edit_distance("png", "pong"), 1u);
    EXPECT_EQ(edit_distance("pongs", "pong"), 1u);
    EXPECT_EQ(edit_distance("", "pong"), 4u);
}

TEST(Text, WhatATerminalWouldObeyIsWrittenOut) {
    EXPECT_EQ(printable("Müller's 100 % \\ ok"), "Müller's 100 % \\ ok");
    EXPECT_EQ(printable("\x1b[2J\r\n\t\x7f"), "\\x1b[2J\\x0d\\x0a\\x09\\x7f");
    EXPECT_EQ(printable(std::string_view("\0", 1)), "\\x00");
    EXPECT_EQ(printable("\xc2\x9b[2J"), "\\xc2\\x9b[2J") << "the same in one character";
    EXPECT_EQ(printable("m\xfcller\xe2\x82"), "m\\xfcller\\xe2\\x82") << "not UTF-8";
    EXPECT_EQ(printable("\xc0\xaf\xed\xa0\x80"), "\\xc0\\xaf\\xed\\xa0\\x80") << "overlong, half a character";
    EXPECT_EQ(printable("\xe2\x82\xac\xf0\x9f\x8e\xae"), "\xe2\x82\xac\xf0\x9f\x8e\xae");
}

}  // namespace
}  // namespace cale
