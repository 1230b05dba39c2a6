#include "policy/json.h"

#include <gtest/gtest.h>

namespace cale {
namespace {

bool valid(std::string_view text) {
    try {
        check_json(text);
        return true;
    } catch (const FileDamage&) {
        return false;
    }
}

TEST(Json, WhatIsAndWhatIsNot) {
    for (const auto* text : {"{}", " [1, -2.5e+3, 0.5E1, true, false, null] ", R"({"a":{"b":[{}]}})", "\"\"",
                             "0", R"("\u00e9\ud83d\ude00\/")", "\"\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80\""})
        EXPECT_TRUE(valid(text)) << text;
    for (const auto* text : {"",
                             "{",
                             "}",
                             "[1,]",
                             "{\"a\"}",
                             "{\"a\":}",
                             "{a:1}",
                             "01",
                             "1.",
                             ".5",
                             "1e",
                             "+1",
                             "nul",
                             "'a'",
                             "\"a",
                             "\"\\x\"",
                             "\"\\u12g4\"",
                             "\"\\u12\"",
                             "\"\n\"",
                             "[1 2]",
                             "1 2",
                             R"("\ud83d")",
                             R"("\ude00")",
                             R"("\ud83dx")",
                             "\"\xff\"",
                             "\"\xc0\xaf\"",
                             "\"\xe0\x80\x80\"",
                             "\"\xed\xa0\x80\"",
                             "\"\xf5\x80\x80\x80\"",
                             "\"\xc3\"",
                             "[[[[[1]]]]]",
                             "{\"a\":1,\"a\":2}"})
        EXPECT_FALSE(valid(text)) << text;
}

TEST(Json, Parts) {
    const auto members = json_members(R"({ "a" : [1, 2], "b\n":"x\ty" })");
    ASSERT_TRUE(members);
    ASSERT_EQ(members->size(), 2u);
    EXPECT_EQ((*members)[0].first, "a");
    EXPECT_EQ(json_elements((*members)[0].second)->at(1), "2");
    EXPECT_EQ((*members)[1].first, "b\n");
    EXPECT_EQ(json_text((*members)[1].second), "x\ty");
    EXPECT_FALSE(json_members("[]"));
    EXPECT_FALSE(json_elements("{}"));
    EXPECT_FALSE(json_text("1"));
    EXPECT_EQ(json_text(R"("\u00e9\u20ac\ud83d\ude00\\")"), "\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80\\");
    EXPECT_EQ(json_natural("18446744073709551615"), ~std::uint64_t{0});
    for (const auto* text : {"18446744073709551616", "-1", "1.0", "1e3", "\"1\"", "true"})
        EXPECT_FALSE(json_natural(text)) << text;
}

TEST(Json, WritesWhatItReads) {
    const std::string text = "a\"\\\b\f\n\r\t\x01\x1f\xc3\xa9";
    EXPECT_EQ(to_json("a\"\\\n\x01"), R"("a\"\\\n\u0001")");
    EXPECT_TRUE(valid(to_json(text)));
    EXPECT_EQ(json_text(to_json(text)), text);
    EXPECT_TRUE(is_utf8(text));
    EXPECT_FALSE(is_utf8("a\xff"));
}

TEST(Json, QuotesAreOneShortLine) {
    EXPECT_EQ(in_quotes("a\nb"), "'a\\nb'");
    EXPECT_EQ(in_quotes(std::string(1000, 'x')), "'" + std::string(100, 'x') + "...'");
    std::string accents(99, 'x'), cut = "'";
    accents.append("\u00e9\u00e9");
    cut.append(99, 'x').append("...'");
    EXPECT_EQ(in_quotes(accents), cut) << "no character is cut";
    EXPECT_EQ(in_quotes("a\x7f\u009b"), R"('a\x7f\xc2\x9b')");
}

TEST(Json, ListsAreShort) {
    const auto array_of = [](int size) {
        std::string text = "[0";
        for (int i = 1; i < size; ++i) text += ",0";
        return text + "]";
    };
    const auto object_of = [](int size) {
        std::string text = "{";
        for (int i = 0; i < size; ++i)
            text.append(i > 0 ? ",\"" : "\"").append(std::to_string(i)).append("\":0");
        return text + "}";
    };
    EXPECT_TRUE(valid(array_of(100'000)));
    EXPECT_FALSE(valid(array_of(100'001)));
    EXPECT_TRUE(valid(object_of(100'000)));
    EXPECT_FALSE(valid(object_of(100'001)));
}

}  // namespace
}  // namespace cale
