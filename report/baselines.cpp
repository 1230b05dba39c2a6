#include "report/baselines.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "cale/games.h"
#include "cale/text.h"
#include "report/ranges.h"

namespace cale {
namespace {

constexpr std::array<std::string_view, 3> kNotScores{"game", "cale60", "atari100k"};
constexpr std::array<std::string_view, 2> kBeyondTheSixty{"defender", "surround"};  // of published tables

/// The three that are most like `wanted`: those that hold it first, then those with the fewest mistakes in
/// it.
std::vector<std::string> nearest_names(std::string_view wanted, std::vector<std::string> names) {
    std::ranges::stable_sort(names, {}, [&](const std::string& name) {
        return std::pair(lower(name).find(lower(wanted)) == name.npos,
                         edit_distance(lower(wanted), lower(name)));
    });
    names.resize(std::min<std::size_t>(names.size(), 3));
    return names;
}

/// Throws std::runtime_error that names the line where it is none.
const Game& game_in(const CsvTable& table, std::size_t row, const std::string& name) {
    try {
        return find_game(name);
    } catch (const std::invalid_argument& error) {
        throw std::runtime_error(
            fmt::format("{}: line {}: {}", table.path.string(), table.lines[row], error.what()));
    }
}

}  // namespace

std::vector<Baseline> read_baselines(const CsvTable& table, const std::vector<std::string>& names) {
    const auto game_column = table.find("game");
    if (!game_column) throw std::runtime_error(fmt::format("{} has no column 'game'", table.path.string()));
    auto known = table.columns;
    std::erase_if(known,
                  [](const auto& name) { return std::ranges::find(kNotScores, name) != kNotScores.end(); });
    std::vector<Baseline> baselines;
    for (const auto& name : names) {
        const auto columns = std::ranges::count(known, name);
        if (columns == 0)
            throw std::invalid_argument(
                fmt::format("--baselines {}: {} has no such column; the nearest are {}", name,
                            table.path.string(), joined(nearest_names(name, known), ", ")));
        if (columns > 1)
            throw std::runtime_error(
                fmt::format("{}: two columns are called '{}'; rename one", table.path.string(), name));
        const auto column = *table.find(name);
        Baseline baseline{.name = name};
        for (std::size_t row = 0; row < table.rows.size(); ++row) {
            if (table.rows[row][column].empty()) continue;
            const auto& name_of_game = table.rows[row][*game_column];
            if (std::ranges::find(kBeyondTheSixty, lower(name_of_game)) != kBeyondTheSixty.end()) continue;
            const auto& game = game_in(table, row, name_of_game);
            if (!baseline.scores.emplace(game.name, table.score(row, column)).second)
                throw std::runtime_error(
                    fmt::format("{}: line {} has {} again: a table of scores has a game once",
                                table.path.string(), table.lines[row], game.name));
        }
        baselines.push_back(std::move(baseline));
    }
    return baselines;
}

}  // namespace cale
