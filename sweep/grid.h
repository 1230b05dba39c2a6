// The grids of a sweep file: keys and their values.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "sweep/search_space.h"

namespace cale {

/// More runs, or values of one key, than this are a misprint: the paper's largest comparison has 1,500.
inline constexpr std::size_t kMostRuns = 100'000;

/// A key and its list of values.
struct Axis {
    std::string key;
    std::vector<std::string> values;
    std::string place{};  // "mine.yaml:9:3": where a file has it; empty: it is of a command line
};
using Grid = std::vector<Axis>;

/// Returns the values that the texts of a file stand for, without repetition: 1..3 is 1, 2 and 3; for
/// env.game a game by any of its names, or a group of games. Throws ConfigError for an unknown game and an
/// empty or huge range.
std::vector<std::string> expand(std::string_view key, const std::vector<std::string>& texts);

/// Every combination of the values, the last axis varying fastest. Throws ConfigError for too many.
std::vector<std::vector<Setting>> combinations(const Grid& grid);

/// Every combination of the grid with any of the variants, the variants varying fastest; of the grid alone
/// where there are no variants. Throws ConfigError for too many.
std::vector<std::vector<Setting>> combinations(const Grid& grid, const std::vector<Grid>& variants);

/// The axis of this key; nullptr where there is none.
Axis* find(Grid& grid, std::string_view key);

}  // namespace cale
