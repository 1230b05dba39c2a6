#include "settings/config.h"

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <random>
#include <string>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include "cale/env.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using test::TemporaryFolder;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

enum class Flavour { sweet, sour, bitter };
std::span<const std::string_view> names_of(Flavour) {
    static constexpr std::array<std::string_view, 3> names{"sweet", "sour", "bitter"};
    return names;
}

/// One member of every kind.
struct FruitConfig {
    std::int64_t count = 3;
    double weight = 0.5;
    std::optional<double> limit = std::nullopt;
    bool ripe = false;
    std::string label = "apple";
    Flavour flavour = Flavour::sour;
    double anything = 0;

    bool operator==(const FruitConfig&) const = default;
};

template <class Visit>
void fields(FruitConfig& config, Visit&& visit) {
    visit("count", config.count, Range{1, 1e12}, "how many there are");
    visit("weight", config.weight, Range{0, 1}, "kilograms of each");
    visit("limit", config.limit, Range{0}, "most that may be eaten");
    visit("ripe", config.ripe, "whether to eat them now");
    visit("label", config.label, "what the sticker says");
    visit("flavour", config.flavour, "what they taste of");
    visit("anything", config.anything, Range{}, "any number");
}

struct BasketConfig {
    std::int64_t handles = 1;
};

template <class Visit>
void fields(BasketConfig& config, Visit&& visit) {
    visit("handles", config.handles, Range{0, 2}, "handles to carry it by");
}

class Config : public ::testing::Test {
  protected:
    Config() {
        table_.add("fruit", fruit_);
        table_.add("basket", basket_);
    }

    /// The error of loading these contents, without the folder's name.
    std::string load_error(std::string_view yaml) {
        const auto file = folder_.write("x.yaml", yaml);
        return without_folder(test::error_of<ConfigError>([&] { table_.load(file); }));
    }
    std::string without_folder(std::string text) const {
        const auto prefix = folder_.path().string() + "/";
        for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix))
            text.erase(at, prefix.size());
        return text;
    }
    void load(std::string_view yaml) { table_.load(folder_.write("x.yaml", yaml)); }
    std::string set_error(std::string_view key, std::string_view text) {
        return test::error_of<ConfigError>([&] { table_.at(key).set(text); });
    }
    std::string override_error(std::string_view setting) {
        return test::error_of<ConfigError>([&] { table_.set_override(setting); });
    }

    FruitConfig fruit_;
    BasketConfig basket_;
    ConfigTable table_;
    TemporaryFolder folder_;
};

// ---- the table ----------------------------------------------------------------------

TEST_F(Config, EntriesDescribeTheFields) {
    ASSERT_EQ(table_.entries().size(), 8u);
    const auto& count = table_.at("fruit.count");
    EXPECT_EQ(count.type, "integer");
    EXPECT_EQ(count.default_text, "3");
    EXPECT_EQ(count.range_text, "1 to 1e12");
    EXPECT_EQ(count.help, "how many there are");
    EXPECT_EQ(table_.at("fruit.weight").type, "number");
    EXPECT_EQ(table_.at("fruit.weight").range_text, "0 to 1");
    EXPECT_EQ(table_.at("fruit.limit").type, "number or none");
    EXPECT_EQ(table_.at("fruit.limit").default_text, "none");
    EXPECT_EQ(table_.at("fruit.limit").range_text, "at least 0");
    EXPECT_EQ(table_.at("fruit.ripe").type, "true/false");
    EXPECT_EQ(table_.at("fruit.ripe").default_text, "false");
    EXPECT_EQ(table_.at("fruit.label").type, "text");
    EXPECT_EQ(table_.at("fruit.flavour").type, "one of sweet, sour, bitter");
    EXPECT_EQ(table_.at("fruit.flavour").default_text, "sour");
    EXPECT_EQ(table_.at("fruit.anything").range_text, "");
}

TEST_F(Config, DefaultIsTheValueThatTheStructCameWith) {
    FruitConfig fruit;
    fruit.count = 77;
    ConfigTable table;
    table.add("fruit", fruit);
    table.set_override("fruit.count=5");
    EXPECT_EQ(table.at("fruit.count").default_text, "77");
    EXPECT_EQ(table.at("fruit.count").get(), "5");
}

TEST_F(Config, OneSectionOfTwoStructsStaysTogether) {
    FruitConfig fruit;
    BasketConfig basket;
    BasketConfig more;
    ConfigTable table;
    table.add("one", fruit);
    table.add("two", basket);
    table.add("one", more);
    EXPECT_EQ(table.entries()[7].key, "one.handles");
    EXPECT_EQ(table.entries()[8].key, "two.handles");
}

TEST_F(Config, TwoFieldsOfOneNameAreAMistakeOfTheProgram) {
    BasketConfig again;
    EXPECT_EQ(test::error_of<std::logic_error>([&] { table_.add("basket", again); }),
              "two fields are called 'basket.handles'");
}

// ---- values -------------------------------------------------------------------------

TEST_F(Config, IntegersInEverySpelling) {
    for (const char* text : {"1000000", "1_000_000", "1e6", "+1000000", "1.0e6", "1000000.0", "10_00e3"}) {
        table_.at("fruit.count").set("1");
        table_.at("fruit.count").set(text);
        EXPECT_EQ(fruit_.count, 1'000'000) << text;
    }
    table_.at("fruit.count").set("999999999999");
    EXPECT_EQ(fruit_.count, 999'999'999'999);
}

TEST_F(Config, WhatIsNoInteger) {
    for (const char* text :
         {"", "1.5", "abc", "1e", "0x10", "1 ", "1__0", "_1", "1_", "+-1", "nan", "inf", "1e400", "5e-324"}) {
        EXPECT_EQ(set_error("fruit.count", text),
                  std::string("fruit.count must be an integer, not '") + text + "'");
    }
    EXPECT_EQ(fruit_.count, 3);
}

TEST_F(Config, Numbers) {
    const std::pair<const char*, double> cases[] = {{"1e-4", 1e-4}, {".25", .25},      {"+1", 1},
                                                    {"0", 0},       {"0.000_1", 1e-4}, {"1E-2", 1e-2}};
    for (const auto& [text, value] : cases) {
        table_.at("fruit.weight").set(text);
        EXPECT_EQ(fruit_.weight, value) << text;
    }
    for (const char* text : {"", "abc", "nan", "inf", "-inf", "1e999", "1.2.3", "0x1p3"}) {
        EXPECT_EQ(set_error("fruit.anything", text),
                  std::string("fruit.anything must be a number, not '") + text + "'");
    }
}

TEST_F(Config, OptionalNumbers) {
    table_.at("fruit.limit").set("2.5");
    EXPECT_EQ(fruit_.limit, 2.5);
    EXPECT_EQ(table_.at("fruit.limit").get(), "2.5");
    for (const char* text : {"none", "null", "None", "~"}) {
        fruit_.limit = 1;
        table_.at("fruit.limit").set(text);
        EXPECT_FALSE(fruit_.limit.has_value()) << text;
    }
    EXPECT_EQ(set_error("fruit.limit", "no"), "fruit.limit must be a number or none, not 'no'");
    EXPECT_EQ(set_error("fruit.limit", "-1"), "fruit.limit must be at least 0, not '-1'");
}

TEST_F(Config, TruthValues) {
    for (const char* text : {"true", "True", "yes", "on", "ON"}) {
        fruit_.ripe = false;
        table_.at("fruit.ripe").set(text);
        EXPECT_TRUE(fruit_.ripe) << text;
    }
    for (const char* text : {"false", "FALSE", "no", "off"}) {
        fruit_.ripe = true;
        table_.at("fruit.ripe").set(text);
        EXPECT_FALSE(fruit_.ripe) << text;
    }
    EXPECT_EQ(set_error("fruit.ripe", "1"), "fruit.ripe must be true or false, not '1'");
}

TEST_F(Config, Enumerations) {
    table_.at("fruit.flavour").set("bitter");
    EXPECT_EQ(fruit_.flavour, Flavour::bitter);
    EXPECT_EQ(table_.at("fruit.flavour").get(), "bitter");
    EXPECT_EQ(set_error("fruit.flavour", "biter"),
              "fruit.flavour must be one of sweet, sour, bitter, not 'biter'; did you mean 'bitter'?");
    EXPECT_EQ(set_error("fruit.flavour", "umami"),
              "fruit.flavour must be one of sweet, sour, bitter, not 'umami'");
}

TEST_F(Config, NamesInCapitalsAreMisspelled) {
    EXPECT_EQ(set_error("fruit.flavour", "BITTER"),
              "fruit.flavour must be one of sweet, sour, bitter, not 'BITTER'; did you mean 'bitter'?");
    EXPECT_EQ(set_error("fruit.flavour", "Sowr"),
              "fruit.flavour must be one of sweet, sour, bitter, not 'Sowr'; did you mean 'sour'?");
    EXPECT_EQ(override_error("FRUIT.Weight=1"),
              "--set FRUIT.Weight=1: unknown key 'FRUIT.Weight'; did you mean 'fruit.weight'?");
}

TEST_F(Config, LargeNumbersAreIntegersOutOfRange) {
    for (const std::string number :
         {"12345678901234567890", "-12345678901234567890", "1e30", "1_000_000_000_000_000_000_000"})
        EXPECT_EQ(set_error("fruit.count", number), "fruit.count must be 1 to 1e12, not '" + number + "'");
    EXPECT_EQ(set_error("fruit.count", "1.5"), "fruit.count must be an integer, not '1.5'");
    EXPECT_EQ(set_error("fruit.count", "12345678901234567890x"),
              "fruit.count must be an integer, not '12345678901234567890x'");
}

TEST_F(Config, ListsAreForSweeps) {
    table_.check("fruit.label", [](const std::string& text) {
        if (text != "apple" && text != "pear")
            throw std::invalid_argument("there is no fruit '" + text + "'");
    });
    const std::string way_out = "'; `cale sweep` trains a run for each value of a list";
    EXPECT_EQ(set_error("fruit.label", "apple,pear"),
              "fruit.label takes one value, not 'apple,pear" + way_out);
    EXPECT_EQ(set_error("fruit.count", "1..3"), "fruit.count takes one value, not '1..3" + way_out);
    EXPECT_EQ(set_error("fruit.flavour", "sweet,sour"),
              "fruit.flavour takes one value, not 'sweet,sour" + way_out);
    EXPECT_EQ(set_error("fruit.weight", "0.1..0.5"),
              "fruit.weight takes one value, not '0.1..0.5'; a sweep counts whole numbers only (1..3), so "
              "list them there");
    EXPECT_EQ(fruit_, FruitConfig{});
    EXPECT_EQ(set_error("fruit.label", "apple,stone"), "fruit.label: there is no fruit 'apple,stone'");
    EXPECT_EQ(
        load_error("fruit:\n  label: [apple, pear]\n"),
        "x.yaml:2:10: fruit.label must be a single value (text); `cale sweep` trains a run for each value of "
        "a list");
}

TEST_F(Config, AListIsTakenWhereItMeansSomething) {
    table_.take_list("fruit.label");
    table_.check("fruit.label", [](const std::string& text) {
        if (text.find("stone") != text.npos) throw std::invalid_argument("a stone is no fruit");
    });
    load("fruit:\n  label: [apple, pear]\n");
    EXPECT_EQ(fruit_.label, "apple,pear");
    EXPECT_EQ(load_error("fruit:\n  label: [apple, stone]\n"),
              "x.yaml:2:10: fruit.label: a stone is no fruit");
    EXPECT_EQ(load_error("fruit:\n  label: [apple, [pear]]\n"),
              "x.yaml:2:18: fruit.label takes a list of texts");
    load("fruit:\n  label: []\n");
    EXPECT_EQ(fruit_.label, "");
}

TEST_F(Config, RangesIncludeTheirEnds) {
    table_.at("fruit.weight").set("0");
    table_.at("fruit.weight").set("1");
    EXPECT_EQ(set_error("fruit.weight", "1.0000001"), "fruit.weight must be 0 to 1, not '1.0000001'");
    EXPECT_EQ(set_error("fruit.weight", "-1e-9"), "fruit.weight must be 0 to 1, not '-1e-9'");
    EXPECT_EQ(set_error("fruit.count", "0"), "fruit.count must be 1 to 1e12, not '0'");
    EXPECT_EQ(set_error("basket.handles", "3"), "basket.handles must be 0 to 2, not '3'");
    EXPECT_EQ(fruit_.weight, 1);
}

// ---- files --------------------------------------------------------------------------

TEST_F(Config, ReadsAFile) {
    load(
        "basket:\n  handles: 2\n"
        "fruit:\n  count: 1e6\n  weight: 1e-3  # a comment\n  limit: 7\n  ripe: yes\n"
        "  label: \"a: b # c\"\n  flavour: sweet\n  anything: !!float -3\n");
    EXPECT_EQ(basket_.handles, 2);
    EXPECT_EQ(fruit_, (FruitConfig{1'000'000, 1e-3, 7, true, "a: b # c", Flavour::sweet, -3}));
}

TEST_F(Config, NotNamedMeansUnchanged) {
    load("fruit:\n  count: 9\n");
    EXPECT_EQ(fruit_, (FruitConfig{.count = 9}));
}

TEST_F(Config, EmptyFilesAndSectionsChangeNothing) {
    for (const char* yaml :
         {"", "\n\n", "# nothing\n", "---\n", "fruit:\n", "fruit:\n  # count: 5\nbasket: {}\n"}) {
        load(yaml);
        EXPECT_EQ(fruit_, FruitConfig{}) << yaml;
    }
}

TEST_F(Config, AbsentValues) {
    fruit_.limit = 1;
    load("fruit:\n  limit:\n  label:\n");
    EXPECT_FALSE(fruit_.limit.has_value());
    EXPECT_EQ(fruit_.label, "");
    fruit_.limit = 1;
    load("fruit: {limit: null}\n");
    EXPECT_FALSE(fruit_.limit.has_value());
    EXPECT_EQ(load_error("fruit:\n  ripe: yes\n  count:\n"),
              "x.yaml:3:3: fruit.count has no value (integer)");
}

TEST_F(Config, UnknownKeysNameTheNearest) {
    EXPECT_EQ(load_error("fruit:\n  count: 5\n  wieght: 0.5\n"),
              "x.yaml:3:3: unknown key 'fruit.wieght'; did you mean 'fruit.weight'?");
    EXPECT_EQ(load_error("fruit:\n    handles: 1\n"),
              "x.yaml:2:5: unknown key 'fruit.handles'; did you mean 'basket.handles'?");
    EXPECT_EQ(load_error("fruit:\n  zzzzzzzz: 1\n"),
              "x.yaml:2:3: unknown key 'fruit.zzzzzzzz'; --help lists every key");
    EXPECT_EQ(load_error("weight: 1\n"), "x.yaml:1:1: unknown key 'weight'; did you mean 'fruit.weight'?");
    EXPECT_EQ(load_error("fruit.weight: 1\n"),
              "x.yaml:1:1: 'fruit.weight' must be written as 'weight' below 'fruit:'");
}

TEST_F(Config, UnknownSections) {
    EXPECT_EQ(load_error("friut:\n  count: 5\n"),
              "x.yaml:1:1: unknown section 'friut'; did you mean 'fruit'?");
    EXPECT_EQ(load_error("vegetable:\n  count: 5\n"),
              "x.yaml:1:1: unknown section 'vegetable'; there are fruit, basket");
}

TEST_F(Config, WrongValuesNameTheirPlace) {
    EXPECT_EQ(load_error("fruit:\n  count: many\n"),
              "x.yaml:2:10: fruit.count must be an integer, not 'many'");
    EXPECT_EQ(load_error("fruit:\n  weight: 1.5\n"), "x.yaml:2:11: fruit.weight must be 0 to 1, not '1.5'");
    EXPECT_EQ(load_error("fruit:\n  label:\n    a: b\n"),
              "x.yaml:3:5: fruit.label must be a single value (text)");
    EXPECT_EQ(load_error("fruit: 5\n"),
              "x.yaml:1:8: 'fruit' is a section: its settings go below it, one per line");
    EXPECT_EQ(load_error("- fruit\n"), "x.yaml:1:1: expected sections such as 'env:' with settings below");
    EXPECT_EQ(load_error("hello\n"), "x.yaml:1:1: expected sections such as 'env:' with settings below");
    EXPECT_EQ(load_error("fruit:\n  ? [a]\n  : 5\n"), "x.yaml:2:5: a key must be a word");
}

TEST_F(Config, TextsMayBeChecked) {
    table_.check("fruit.label", [](const std::string& text) {
        if (text != "apple") throw std::invalid_argument("there is no fruit '" + text + "'");
    });
    EXPECT_EQ(load_error("fruit:\n  label: aple\n"), "x.yaml:2:10: fruit.label: there is no fruit 'aple'");
    EXPECT_EQ(override_error("fruit.label=aple"),
              "--set fruit.label=aple: fruit.label: there is no fruit 'aple'");
    table_.set_override("fruit.label=apple");
    EXPECT_EQ(fruit_.label, "apple");
    EXPECT_THROW(table_.check("fruit.colour", {}), std::logic_error);
}

TEST_F(Config, ErrorsStayOnOneLineWhateverTheyQuote) {
    EXPECT_EQ(load_error("fruit:\n  count: \"a\\nb\\e\"\n"),
              "x.yaml:2:10: fruit.count must be an integer, not 'a\\x0ab\\x1b'");
}

TEST_F(Config, DuplicatesAreRefused) {
    EXPECT_EQ(load_error("fruit:\n  count: 5\n  ripe: no\n  count: 6\n"),
              "x.yaml:4:3: 'fruit.count' is set a second time; line 2 has the first");
    EXPECT_EQ(load_error("fruit:\n  count: 5\nfruit:\n  ripe: no\n"),
              "x.yaml:3:1: 'fruit' is set a second time; line 1 has the first");
    EXPECT_EQ(load_error("fruit:\n  count: 5\n---\nfruit:\n  ripe: no\n"),
              "x.yaml:3:1: a second YAML document ('---'); a file may hold one only");
}

TEST_F(Config, ASweepFileIsNamed) {
    EXPECT_EQ(load_error("agent: sac\ngrid:\n  train.seed: 1\n"),
              "x.yaml:2:1: 'grid' is of a sweep file: cale sweep x.yaml");
    FruitConfig cells;
    table_.add("grid", cells);  // a section of a world of one's own
    load("grid:\n  count: 6\n");
    EXPECT_EQ(cells.count, 6);
}

TEST_F(Config, SyntaxErrorsNameTheirPlace) {
    EXPECT_EQ(load_error("fruit:\n  label: \"a, b\n  count: 1\n"),
              "x.yaml:2:10: not valid YAML: a quote is opened here and not closed");
    EXPECT_NO_THROW(load("fruit:\n  label: 'a'\n  # it's one\n...\n"));
    EXPECT_EQ(load_error("fruit:\n  label: [a, b\n  count: 1\n"),
              "x.yaml:3:8: not valid YAML: end of sequence flow not found");
    EXPECT_THAT(load_error("fruit:\n\tcount: 1\n"),
                testing::AllOf(testing::StartsWith("x.yaml:2:7: not valid YAML: "),
                               testing::EndsWith("; a tab indents line 2: YAML wants spaces")));
    EXPECT_THAT(load_error("fruit:\n  label: *nothing\n"), StartsWith("x.yaml:2:10: not valid YAML: "));
    EXPECT_THAT(load_error(std::string(100'000, '[')), HasSubstr(": not valid YAML: "));
}

TEST_F(Config, OfManyFilesAFewAreListed) {
    for (int i = 10; i < 41; ++i) folder_.write("many/" + std::to_string(i) + ".yaml", "");
    const auto error = [&](const char* name) {
        return without_folder(test::error_of<ConfigError>([&] { table_.load(folder_ / name); }));
    };
    const std::string few = "10.yaml, 11.yaml, 12.yaml, 13.yaml, 14.yaml, 15.yaml, ... (31 in all)";
    EXPECT_EQ(error("many"), "cannot read 'many': Is a directory; give a file in it: " + few);
    EXPECT_EQ(error("many/nothing_like_it.yaml"),
              "cannot read 'many/nothing_like_it.yaml': No such file or directory; 'many' has " + few);
}

TEST_F(Config, FilesThatCannotBeRead) {
    folder_.write("configs/breakout.yaml", "");
    folder_.write("configs/pong.yaml", "");
    folder_.write("configs/notes.txt", "");
    const auto error = [&](std::string_view name) {
        return without_folder(test::error_of<ConfigError>([&] { table_.load(folder_ / name); }));
    };
    EXPECT_EQ(error("configs/brekout.yaml"),
              "cannot read 'configs/brekout.yaml': No such file or directory; did you mean "
              "'configs/breakout.yaml'?");
    EXPECT_EQ(error("configs/freeway.yaml"),
              "cannot read 'configs/freeway.yaml': No such file or directory; 'configs' has breakout.yaml, "
              "pong.yaml");
    EXPECT_EQ(error("nowhere/pong.yaml"), "cannot read 'nowhere/pong.yaml': No such file or directory");
    EXPECT_EQ(error("configs"),
              "cannot read 'configs': Is a directory; give a file in it: breakout.yaml, pong.yaml");
}

// ---- extends ------------------------------------------------------------------------

TEST_F(Config, ExtendsReadsTheBaseFirst) {
    folder_.write("base/root.yaml", "fruit:\n  count: 1\n  label: root\n  ripe: yes\n");
    folder_.write("base/middle.yaml", "extends: root.yaml\nfruit:\n  count: 2\n  weight: 0.25\n");
    // Last in the file, and still read first.
    const auto file = folder_.write("leaf.yaml", "fruit:\n  count: 3\nextends: base/middle.yaml\n");
    table_.load(file);
    EXPECT_EQ(fruit_.count, 3);
    EXPECT_EQ(fruit_.weight, 0.25);
    EXPECT_EQ(fruit_.label, "root");
    EXPECT_TRUE(fruit_.ripe);
}

TEST_F(Config, ExtendsReadsAListInItsOrder) {
    folder_.write("root.yaml", "fruit:\n  count: 1\n  label: root\n");
    folder_.write("left.yaml", "extends: root.yaml\nfruit:\n  count: 2\n  weight: 0.25\n");
    folder_.write("right.yaml", "extends: root.yaml\nfruit:\n  weight: 0.75\n  ripe: yes\n");
    load("extends: [left.yaml, right.yaml]\nfruit:\n  label: leaf\n");
    EXPECT_EQ(fruit_.count, 1);  // the root again, by way of the second
    EXPECT_EQ(fruit_.weight, 0.75);
    EXPECT_EQ(fruit_.label, "leaf");
    EXPECT_TRUE(fruit_.ripe);
}

TEST_F(Config, ExtendsErrorsNameTheFileThatIsWrong) {
    folder_.write("base.yaml", "fruit:\n  cuont: 1\n");
    EXPECT_EQ(load_error("extends: base.yaml\n"),
              "base.yaml:2:3: unknown key 'fruit.cuont'; did you mean 'fruit.count'?");
    EXPECT_EQ(load_error("fruit:\n  count: 3\nextends: bases.yaml\n"),
              "x.yaml:3:10: cannot read 'bases.yaml': No such file or directory; did you mean 'base.yaml'?");
    const auto wanted = "'extends' must name another file, or a list of files";
    EXPECT_EQ(load_error("extends: {base: base.yaml}\n"), fmt::format("x.yaml:1:10: {}", wanted));
    EXPECT_EQ(load_error("extends: [[base.yaml]]\n"), fmt::format("x.yaml:1:11: {}", wanted));
    EXPECT_EQ(load_error("extends:\n"), fmt::format("x.yaml:1:1: {}", wanted));
    folder_.write("good.yaml", "fruit:\n  count: 4\n");
    EXPECT_EQ(load_error("extends: good.yaml\nextends: good.yaml\n"),
              "x.yaml:2:1: 'extends' is set a second time; line 1 has the first");
}

TEST_F(Config, ExtendsInACircle) {
    EXPECT_EQ(load_error("extends: ./x.yaml\n"),
              "x.yaml:1:10: './x.yaml' extends itself; a base must not lead back to a file that extends it");
    folder_.write("y.yaml", "extends: x.yaml\n");
    EXPECT_EQ(load_error("extends: y.yaml\n"),
              "y.yaml:1:10: 'x.yaml' extends itself; a base must not lead back to a file that extends it");
}

// ---- ranges and absent integers ------------------------------------------------------

struct NutConfig {
    IntegerRange size{2, 2};
    std::optional<std::int64_t> mode;
};

template <class Visit>
void fields(NutConfig& config, Visit&& visit) {
    visit("size", config.size, Range{0, 20}, "millimetres");
    visit("mode", config.mode, Range{0, 9}, "of cracking it");
}

TEST(ConfigNut, RangesOfIntegersAreOneNumberOrTwo) {
    NutConfig nut;
    ConfigTable table;
    table.add("nut", nut);
    const auto& size = table.at("nut.size");
    EXPECT_EQ(size.type, "integer, or two such as 0-8");
    EXPECT_EQ(size.default_text, "2");
    size.set("3-8");
    EXPECT_EQ(nut.size, (IntegerRange{3, 8}));
    EXPECT_EQ(size.get(), "3-8");
    size.set("5");
    EXPECT_EQ(nut.size, (IntegerRange{5, 5}));
    for (const auto* text : {"8-3", "3-", "-8", "many", "3-8-9"}) {
        EXPECT_THAT(test::error_of<ConfigError>([&] { size.set(text); }),
                    AnyOf(HasSubstr("nut.size must be an integer, or two such as 0-8, not '"),
                          HasSubstr("nut.size must be 0 to 20, not '")))
            << text;
    }
    EXPECT_EQ(test::error_of<ConfigError>([&] { size.set("3-30"); }), "nut.size must be 0 to 20, not '3-30'");
    EXPECT_EQ(nut.size, (IntegerRange{5, 5}));
}

TEST(ConfigNut, IntegersMayBeAbsent) {
    NutConfig nut;
    ConfigTable table;
    table.add("nut", nut);
    const auto& mode = table.at("nut.mode");
    EXPECT_EQ(mode.type, "integer or none");
    EXPECT_EQ(mode.default_text, "none");
    mode.set("4");
    EXPECT_EQ(nut.mode, 4);
    EXPECT_EQ(mode.get(), "4");
    EXPECT_EQ(test::error_of<ConfigError>([&] { mode.set("4.5"); }),
              "nut.mode must be an integer or none, not '4.5'");
    mode.set("none");
    EXPECT_FALSE(nut.mode);
    // Both come back from what is written of them.
    table.at("nut.size").set("0-8");
    mode.set("7");
    const auto yaml = table.to_yaml();
    table.reset();
    TemporaryFolder folder;
    table.load(folder.write("nut.yaml", yaml));
    EXPECT_EQ(nut.size, (IntegerRange{0, 8}));
    EXPECT_EQ(nut.mode, 7);
}

// ---- overrides ----------------------------------------------------------------------

TEST_F(Config, OverridesSetOneKey) {
    table_.set_override("fruit.count=5");
    table_.set_override("fruit.label=a=b");
    EXPECT_EQ(fruit_, (FruitConfig{.count = 5, .label = "a=b"}));
    table_.set_override("fruit.label=");
    EXPECT_EQ(fruit_.label, "");
}

TEST_F(Config, OverrideErrorsNameTheOverride) {
    EXPECT_EQ(override_error("fruit.cuont=5"),
              "--set fruit.cuont=5: unknown key 'fruit.cuont'; did you mean 'fruit.count'?");
    EXPECT_EQ(override_error("count=5"), "--set count=5: unknown key 'count'; did you mean 'fruit.count'?");
    EXPECT_EQ(override_error("fruit.count=0"), "--set fruit.count=0: fruit.count must be 1 to 1e12, not '0'");
    EXPECT_EQ(override_error("fruit.count"),
              "--set fruit.count: expected KEY=VALUE, such as env.game=breakout");
    EXPECT_EQ(override_error("=5"), "--set =5: expected KEY=VALUE, such as env.game=breakout");
    EXPECT_EQ(override_error(""), "--set : expected KEY=VALUE, such as env.game=breakout");
}

// ---- printing -----------------------------------------------------------------------

TEST_F(Config, PrintsEveryKeyWithItsSentence) {
    EXPECT_EQ(table_.to_yaml(),
              "fruit:\n"
              "  # how many there are\n  count: 3\n"
              "  # kilograms of each\n  weight: 0.5\n"
              "  # most that may be eaten\n  limit: none\n"
              "  # whether to eat them now\n  ripe: false\n"
              "  # what the sticker says\n  label: apple\n"
              "  # what they taste of\n  flavour: sour\n"
              "  # any number\n  anything: 0\n"
              "\n"
              "basket:\n"
              "  # handles to carry it by\n  handles: 1\n");
}

TEST_F(Config, WhatIsPrintedReadsBackToTheSame) {
    const std::string labels[] = {"",          "null",
                                  "none",      "true",
                                  "No",        "~",
                                  "y",         "5",
                                  "1e3",       "0x10",
                                  "-",         "- a",
                                  "a: b",      "a #b",
                                  "#",         "[a]",
                                  "{a}",       "*a",
                                  "&a",        "!a",
                                  "|",         ">",
                                  "%",         "@",
                                  "`",         "'",
                                  "\"",        "\\",
                                  "a\nb",      "a\tb",
                                  " a ",       "ALE/Pong-v5",
                                  "/roms/a b", "\xc3\xa9t\xc3\xa9",
                                  "...",       "---",
                                  ".inf",      "2001-01-01",
                                  "=",         "<<",
                                  "\x01"};
    const double numbers[] = {
        0.1, 1.0 / 3, 1e-300, -1e300, 5e-324, std::numeric_limits<double>::max(), -0.0, 123456789.123456789,
        1e22};
    std::size_t i = 0;
    for (const auto& label : labels) {
        const FruitConfig written{static_cast<std::int64_t>(i + 1) * 123'456'789,
                                  1.0 / static_cast<double>(i + 3),
                                  i % 2 ? std::optional(1e-7 * static_cast<double>(i)) : std::nullopt,
                                  i % 3 == 0,
                                  label,
                                  static_cast<Flavour>(i % 3),
                                  numbers[i % std::size(numbers)]};
        fruit_ = written;
        const auto yaml = table_.to_yaml();
        fruit_ = FruitConfig{.count = 1, .limit = 5, .label = "other"};
        load(yaml);
        EXPECT_EQ(fruit_, written) << yaml;
        // Any other YAML reader must see a text, too.
        EXPECT_EQ(YAML::Load(yaml)["fruit"]["label"].as<std::string>(), label);
        ++i;
    }
}

TEST_F(Config, TextThatOthersWouldMisreadIsQuoted) {
    for (const char* label : {"null", "true", "5", "n", ""}) {
        fruit_.label = label;
        EXPECT_THAT(table_.to_yaml(), HasSubstr(std::string("label: \"") + label + "\"\n"));
    }
}

TEST_F(Config, TextThatYamlCannotHoldIsRefused) {
    // A byte that is not UTF-8, and a character that Unicode will never have.
    for (const auto& [label, shown] :
         {std::pair<std::string, std::string>("m\xfcller", "m\\xfcller"), {"\xef\xbf\xbf", "\xef\xbf\xbf"}}) {
        EXPECT_EQ(override_error("fruit.label=" + label),
                  "--set fruit.label=" + shown +
                      ": fruit.label must be text that a YAML file can hold, which is UTF-8, not '" + shown +
                      "'");
        EXPECT_EQ(fruit_.label, "apple");
    }
}

// ---- differences --------------------------------------------------------------------

TEST_F(Config, DifferencesAreWhatAFileWouldChange) {
    fruit_.count = 10;
    const auto file = folder_.write("run/config.yaml", table_.to_yaml());
    EXPECT_TRUE(table_.differences(file).empty());
    fruit_.count = 20;
    fruit_.limit = 1;
    const auto before = fruit_;
    const auto differences = table_.differences(file);
    ASSERT_EQ(differences.size(), 2u);
    EXPECT_EQ(differences[0].key, "fruit.count");
    EXPECT_EQ(differences[0].here, "20");
    EXPECT_EQ(differences[0].there, "10");
    EXPECT_EQ(differences[1].key, "fruit.limit");
    EXPECT_EQ(differences[1].there, "none");
    EXPECT_EQ(fruit_, before);
}

TEST_F(Config, DifferencesWithABadFileLeaveTheTableAlone) {
    const auto file = folder_.write("bad.yaml", "fruit:\n  count: 10\n  weight: 7\n");
    EXPECT_THROW(table_.differences(file), ConfigError);
    EXPECT_EQ(fruit_, FruitConfig{});
}

// ---- nearest ------------------------------------------------------------------------

TEST(Nearest, FindsMisspellingsOnly) {
    const std::string words[] = {"threshold", "game", "gamma"};
    EXPECT_EQ(nearest("tresholdd", words), "threshold");
    EXPECT_EQ(nearest("gaem", words), "game");  // two swapped letters are one mistake
    EXPECT_EQ(nearest("gama", words), "game");  // the first of equals
    EXPECT_EQ(nearest("game", words), "game");
    EXPECT_EQ(nearest("xyzxyz", words), "");
    EXPECT_EQ(nearest("loss", std::vector<std::string>{"obs"}), "") << "half of a word is no mistake";
    EXPECT_EQ(nearest("", words), "");
    EXPECT_EQ(nearest("ab", std::vector<std::string>{"cd"}), "");
    EXPECT_EQ(nearest("a", std::vector<std::string>{}), "");
}

// ---- the real thing -----------------------------------------------------------------

TEST(ConfigOfTheEnvironment, DefaultsAreAllowedAndSurviveAFile) {
    EnvConfig env;
    ConfigTable table;
    table.add("env", env);
    ASSERT_GT(table.entries().size(), 10u);
    for (const auto& entry : table.entries()) {
        entry.set(entry.default_text);
        EXPECT_EQ(entry.get(), entry.default_text) << entry.key;
        EXPECT_FALSE(entry.help.empty()) << entry.key;
    }
    TemporaryFolder folder;
    EXPECT_TRUE(table.differences(folder.write("config.yaml", table.to_yaml())).empty());
}

TEST(ConfigOfTheEnvironment, EverySettingReachesTheStruct) {
    EnvConfig env;
    ConfigTable table;
    table.add("env", env);
    table.set_override("env.threshold=0.25");
    table.set_override("env.action_space=minimal");
    table.set_override("env.max_frames_per_episode=1_000");
    EXPECT_EQ(env.threshold, 0.25);
    EXPECT_EQ(env.action_space, ActionSet::minimal);
    EXPECT_EQ(env.max_frames_per_episode, 1000);
}

// ---- rubbish ------------------------------------------------------------------------

TEST_F(Config, RubbishIsAnErrorOrLoadsButNothingElse) {
    const std::string good =
        "extends: none.yaml\nfruit: {count: 1e3, label: \"a\\x41\", limit: ~}\nbasket:\n  handles: 2 # x\n";
    folder_.write("none.yaml", "fruit:\n  ripe: on\n");
    std::mt19937 random(7);
    const auto file = folder_ / "x.yaml";
    const auto attempt = [&](const std::string& yaml) {
        folder_.write("x.yaml", yaml);
        try {
            table_.load(file);
        } catch (const ConfigError& error) {
            EXPECT_THAT(error.what(), ::testing::Not(HasSubstr("\n"))) << yaml;
        }
        EXPECT_GE(fruit_.count, 1);
        EXPECT_LE(basket_.handles, 2);
    };
    for (std::size_t length = 0; length <= good.size(); ++length) attempt(good.substr(0, length));
    for (int i = 0; i < 500; ++i) {
        auto yaml = good;
        for (int change = 0; change < 3; ++change)
            yaml[random() % yaml.size()] = static_cast<char>(random() % 256);
        attempt(yaml);
    }
}

}  // namespace
}  // namespace cale
