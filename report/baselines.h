// Scores of the literature, for comparison.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "report/csv.h"

namespace cale {

/// A published result: mean scores of some games, without the individual runs.
struct Baseline {
    std::string name{};
    std::map<std::string, double, std::less<>> scores{};  // by Game::name
};

/// The columns called `names` of a table with a row per game, whose column `game` names it. Empty cells are
/// passed over, and Defender and Surround, which published tables have beside the sixty.
/// Throws std::invalid_argument for a name that is no column, naming the nearest, and
/// std::runtime_error for a table without the column `game`, with a game or a named column twice, with a game
/// that is none, or where a score is no number.
std::vector<Baseline> read_baselines(const CsvTable& table, const std::vector<std::string>& names);

}  // namespace cale
