// The tables of docs/results.md, docs/results_other.md and policies/README.md say what the CSV files beside
// them say.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/text.h"
#include "report/csv.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
const fs::path kDocs = CALE_SOURCE_DIR "/docs";
const fs::path kPolicies = CALE_SOURCE_DIR "/policies";

/// A table in Markdown behind a line "<!-- FILE.csv -->", whose columns the file has but for those of
/// kSaidOfThem. Of a table with a column "gate" each row is the file's first whose "mean" reaches the gate.
struct PrintedTable {
    fs::path csv{};
    std::vector<std::string> columns{};
    std::vector<std::vector<std::string>> rows{};
};

const std::set<std::string> kSaidOfThem{"gate", "theirs, frames", "published"};

std::vector<std::string> cells_of(std::string_view line) {
    auto cells = split(line.substr(1, line.rfind('|') - 1), '|');
    for (auto& cell : cells) {
        cell.erase(0, cell.find_first_not_of(' '));
        cell.erase(cell.find_last_not_of(' ') + 1);
    }
    return cells;
}

std::vector<PrintedTable> printed_tables(const fs::path& page) {
    std::vector<PrintedTable> tables;
    std::ifstream file(page);
    bool under_way = false;
    for (std::string line; std::getline(file, line);) {
        if (line.starts_with("<!-- ") && line.ends_with(".csv -->")) {
            tables.push_back({.csv = kDocs / line.substr(5, line.size() - 9)});
            under_way = true;
        } else if (under_way && line.starts_with('|')) {
            auto& table = tables.back();
            if (table.columns.empty()) {
                table.columns = cells_of(line);
            } else if (!line.starts_with("|-")) {
                table.rows.push_back(cells_of(line));
            }
        } else if (under_way && !line.empty()) {
            under_way = false;
        }
    }
    return tables;
}

std::optional<double> as_number(std::string text) {
    std::erase(text, ',');
    return number_in<double>(text);
}

/// Text are equal; numbers are after rounding to as many digits as were printed.
bool agree(const std::string& printed, const std::string& stored) {
    const auto a = as_number(printed), b = as_number(stored);
    if (!a || !b) return printed == stored;
    const auto point = printed.find('.');
    const auto digits = point == printed.npos ? 0.0 : static_cast<double>(printed.size() - point - 1);
    return std::abs(*a - *b) <= 0.5000001 * std::pow(10.0, -digits);
}

/// What a printed row says and the file does not; empty if it says the same.
std::string difference(const PrintedTable& table, const std::vector<std::string>& row, const CsvTable& csv) {
    if (row.size() != table.columns.size()) return "has another number of cells than its header";
    const auto gate = std::ranges::find(table.columns, "gate") - table.columns.begin();
    const bool has_gate = gate < std::ssize(table.columns);
    std::size_t checked = 0;
    for (std::size_t i = 0; i < csv.rows.size(); ++i) {
        bool same_words = true, same_numbers = true;
        checked = 0;
        for (std::size_t j = 0; j < row.size(); ++j) {
            const auto column = csv.find(table.columns[j]);
            if (!column) continue;
            ++checked;
            const bool same = agree(row[j], csv.rows[i][*column]);
            (as_number(row[j]) ? same_numbers : same_words) &= same;
        }
        if (!same_words) continue;
        if (!has_gate && same_numbers) return checked < 2 ? "has nothing to check" : "";
        if (has_gate && csv.number(i, *csv.find("mean")) >= *as_number(row[static_cast<std::size_t>(gate)]))
            return same_numbers ? "" : fmt::format("the file says: {}", fmt::join(csv.rows[i], ","));
    }
    return "no row of the file says so";
}

TEST(Results, TheTablesSayWhatTheFilesSay) {
    for (const auto* page : {"results.md", "results_other.md"}) {
        const auto tables = printed_tables(kDocs / page);
        EXPECT_THAT(tables, testing::Not(testing::IsEmpty())) << page;
        for (const auto& table : tables) {
            const auto csv = read_csv(table.csv);
            EXPECT_THAT(table.rows, testing::Not(testing::IsEmpty())) << table.csv;
            for (const auto& column : table.columns)
                EXPECT_TRUE(csv.find(column) || kSaidOfThem.contains(column)) << table.csv << ": " << column;
            for (const auto& row : table.rows)
                EXPECT_EQ(difference(table, row, csv), "")
                    << table.csv << ": " << fmt::format("{}", fmt::join(row, " | "));
        }
    }
}

/// Each row is a policy file of this folder, and <policy>.csv holds the games that it was evaluated in.
TEST(Results, ThePoliciesPlayedAsTheirTableSays) {
    const auto tables = printed_tables(kPolicies / "README.md");
    ASSERT_EQ(tables.size(), 1u);
    ASSERT_THAT(tables[0].columns, testing::ElementsAre("policy", "game", "frames", "games", "mean return"));
    std::vector<std::string> named;
    for (const auto& row : tables[0].rows) {
        const auto file = kPolicies / row[0].substr(1, row[0].size() - 2);  // `boxing_sac.safetensors`
        named.push_back(file.filename());
        const auto games = read_csv(fs::path(file).replace_extension(".csv"));
        double sum = 0;
        for (std::size_t i = 0; i < games.rows.size(); ++i) sum += games.number(i, *games.find("return"));
        const auto count = games.rows.size();
        EXPECT_TRUE(agree(row[3], std::to_string(count))) << file;
        EXPECT_TRUE(agree(row[4], std::to_string(sum / static_cast<double>(count)))) << file;
    }
    std::vector<std::string> there;
    for (const auto& item : fs::directory_iterator(kPolicies))
        if (item.path().extension() == ".safetensors") there.push_back(item.path().filename());
    EXPECT_THAT(named, testing::UnorderedElementsAreArray(there));
}

TEST(Results, WhatTheFilesDoNotSayIsFound) {
    const CsvTable csv{.columns = {"game", "step", "mean"},
                       .rows = {{"Pong", "100", "-20.96"}, {"Pong", "200", "-9.5"}, {"Pong", "300", "-3"}},
                       .lines = {2, 3, 4}};
    const PrintedTable scores{.columns = {"game", "mean", "of whom"}};
    EXPECT_EQ(difference(scores, {"Pong", "-21.0", "us"}, csv), "");
    EXPECT_NE(difference(scores, {"Pong", "-20.9", "us"}, csv), "");
    EXPECT_NE(difference(scores, {"Boxing", "-21.0", "us"}, csv), "");
    const PrintedTable gates{.columns = {"game", "gate", "step"}};
    EXPECT_EQ(difference(gates, {"Pong", "-10", "200"}, csv), "");
    EXPECT_NE(difference(gates, {"Pong", "-10", "300"}, csv), "");
    EXPECT_NE(difference(gates, {"Pong", "0", "300"}, csv), "");
}

}  // namespace
}  // namespace cale
