#include "sweep/grid.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "cale/games.h"
#include "cale/text.h"
#include "settings/config.h"
#include "sweep/settings.h"

namespace cale {
namespace {

/// The games whose curves the paper shows for SAC and DQN, 200 million frames.
constexpr std::array<std::string_view, 10> kPaperTen = {"Asterix", "Asteroids",    "BankHeist", "Bowling",
                                                        "Boxing",  "Breakout",     "Centipede", "MsPacman",
                                                        "Pong",    "SpaceInvaders"};

/// The games that a word stands for; empty if it names no group.
std::vector<std::string> games_of_group(std::string_view word) {
    std::vector<std::string> roms;
    for (const auto& game : games()) {
        const bool in_ten = std::ranges::find(kPaperTen, game.name) != kPaperTen.end();
        if (word == "all" || (word == "atari100k" && game.in_atari100k) || (word == "paper_ten" && in_ten))
            roms.emplace_back(game.rom);
    }
    return roms;
}

/// 1000, or 1_000.
std::optional<std::int64_t> natural(std::string_view text) {
    if (text.starts_with('_') || text.ends_with('_')) return std::nullopt;
    std::string digits(text);
    std::erase(digits, '_');
    const auto value = number_in<std::int64_t>(digits);
    return value && *value >= 0 ? value : std::nullopt;
}

std::vector<std::string> expand_one(std::string_view key, const std::string& text) {
    if (key == "env.game") {
        auto group = games_of_group(text);
        if (!group.empty()) return group;
        if (text.find(',') != text.npos)
            throw ConfigError(fmt::format(
                "'{0}' is several games, and a run of a sweep is of one; env.game={0} of a training "
                "program trains one policy for them",
                text));
        try {
            return {std::string(find_game(text).rom)};
        } catch (const std::invalid_argument& error) {
            throw ConfigError(
                fmt::format("{} (groups of games are atari100k, paper_ten and all)", error.what()));
        }
    }
    const auto dots = text.find("..");
    if (dots == std::string::npos) return {text};
    const auto low = std::string_view(text).substr(0, dots), high = std::string_view(text).substr(dots + 2);
    const auto first = natural(low), last = natural(high);
    if (!first || !last) {
        if (!number_in<double>(low) || !number_in<double>(high)) return {text};
        throw ConfigError(fmt::format(
            "the range {} cannot be counted: only whole numbers from 0 on are, written like 1..3 or "
            "1_000..1_003; list the values",
            text));
    }
    if (*last < *first)
        throw ConfigError(fmt::format("the range {} is empty: the lower end comes first", text));
    if (*last - *first >= static_cast<std::int64_t>(kMostRuns))
        throw ConfigError(fmt::format("the range {} has more than {} values", text, kMostRuns));
    std::vector<std::string> values;
    for (std::int64_t i = 0; i <= *last - *first; ++i) values.push_back(std::to_string(*first + i));
    return values;
}

[[noreturn]] void too_many() {
    throw ConfigError(fmt::format("more than {} runs", kMostRuns));
}

}  // namespace

std::vector<std::string> expand(std::string_view key, const std::vector<std::string>& texts) {
    std::vector<std::string> values;
    std::set<std::string> seen;
    for (const auto& text : texts) {
        for (auto& value : expand_one(key, text)) {
            if (seen.insert(printed_value(value)).second) values.push_back(std::move(value));
        }
    }
    return values;
}

std::vector<std::vector<Setting>> combinations(const Grid& grid) {
    std::vector<std::vector<Setting>> result(1);
    for (const auto& axis : grid) {
        if (result.size() * axis.values.size() > kMostRuns) too_many();
        std::vector<std::vector<Setting>> longer;
        for (const auto& start : result) {
            for (const auto& value : axis.values) {
                longer.push_back(start);
                longer.back().push_back({axis.key, value});
            }
        }
        result = std::move(longer);
    }
    return result;
}

std::vector<std::vector<Setting>> combinations(const Grid& grid, const std::vector<Grid>& variants) {
    auto starts = combinations(grid);
    if (variants.empty()) return starts;
    std::vector<std::vector<Setting>> ends;
    for (const auto& variant : variants) {
        auto more = combinations(variant);
        std::move(more.begin(), more.end(), std::back_inserter(ends));
    }
    if (starts.size() * ends.size() > kMostRuns) too_many();
    std::vector<std::vector<Setting>> result;
    for (const auto& start : starts) {
        for (const auto& end : ends) {
            result.push_back(start);
            result.back().insert(result.back().end(), end.begin(), end.end());
        }
    }
    return result;
}

Axis* find(Grid& grid, std::string_view key) {
    const auto found = std::ranges::find(grid, key, &Axis::key);
    return found == grid.end() ? nullptr : &*found;
}

}  // namespace cale
