#include "report/recorded_runs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "cale/games.h"
#include "cale/text.h"

namespace cale {
namespace {

constexpr int kParts = 10;  // of a run
constexpr std::array<std::string_view, 8> kColumns{"group", "run",  "agent", "game",
                                                   "seed",  "step", "score", "total_steps"};
/// The settings that say by which rules a game is played.
constexpr std::string_view kRules = "env.";

std::set<std::string> rules_of(const Comparison& comparison) {
    std::set<std::string> keys;
    for (const auto& group : comparison.groups)
        for (const auto& run : group.runs)
            for (const auto& [key, value] : run.settings)
                if (key.starts_with(kRules)) keys.insert(key);
    return keys;
}

std::vector<double> recorded_steps(const Run& run) {
    const double all = run.total_steps > 0 ? run.total_steps : run.steps.back();
    const double end = run.finished ? std::max(all, run.reached) : run.reached;
    std::vector<double> steps;
    for (int part = 1; part <= kParts && all * part / kParts <= end; ++part)
        steps.push_back(all * part / kParts);
    if (steps.empty() || steps.back() < end) steps.push_back(end);
    // As they are written; of a run of a few steps some are the same.
    for (auto& step : steps) step = std::round(step);
    steps.erase(std::unique(steps.begin(), steps.end()), steps.end());
    return steps;
}

/// That something is wrong with a row.
std::runtime_error row_error(const CsvTable& table, std::size_t row, std::string_view what) {
    return std::runtime_error(fmt::format("{}:{}: {}", table.path.string(), table.lines[row], what));
}

std::uint64_t natural(const CsvTable& table, std::size_t row, std::size_t column) {
    const auto& text = table.rows[row][column];
    if (const auto number = number_in<std::uint64_t>(text)) return *number;
    throw row_error(table, row, fmt::format("the {} '{}' is no number", table.columns[column], text));
}

const Game& game_in(const CsvTable& table, std::size_t row, std::size_t column) {
    try {
        return find_game(table.rows[row][column]);
    } catch (const std::invalid_argument& error) {
        throw row_error(table, row, error.what());
    }
}

std::array<std::size_t, kColumns.size()> columns_of(const CsvTable& table) {
    std::array<std::size_t, kColumns.size()> columns{};
    for (std::size_t i = 0; i < kColumns.size(); ++i) {
        const auto found = table.find(kColumns[i]);
        if (!found)
            throw std::runtime_error(fmt::format("{} has no column '{}', so it is no table of recorded runs",
                                                 table.path.string(), kColumns[i]));
        columns[i] = *found;
    }
    return columns;
}

}  // namespace

std::string recorded_runs_csv(const Comparison& comparison) {
    if (comparison.config.score != ScoreKind::training) return "";
    const auto rules = rules_of(comparison);
    std::vector<std::string> header(kColumns.begin(), kColumns.end());
    header.insert(header.end(), rules.begin(), rules.end());
    auto text = csv_line(header);
    for (const auto& group : comparison.results) {
        int number = 0;
        for (const auto& game : group.games) {
            for (const auto* run : game.runs) {
                ++number;
                for (const double step : recorded_steps(*run)) {
                    const auto score = score_at(*run, step);
                    if (!score) continue;
                    std::vector<std::string> cells{group.label,
                                                   fmt::to_string(number),
                                                   run->agent,
                                                   std::string(game.game->name),
                                                   fmt::to_string(run->seed),
                                                   fmt::format("{:.0f}", step),
                                                   fmt::format("{}", *score),
                                                   fmt::format("{:.0f}", run->total_steps)};
                    for (const auto& key : rules) cells.push_back(setting_of(*run, key));
                    text += csv_line(cells);
                }
            }
        }
    }
    return text;
}

std::vector<std::string> recorded_groups(const CsvTable& table) {
    require_whole(table);
    const auto group = columns_of(table)[0];
    std::vector<std::string> groups;
    for (const auto& row : table.rows)
        if (std::ranges::find(groups, row[group]) == groups.end()) groups.push_back(row[group]);
    return groups;
}

std::vector<Run> read_recorded_runs(const CsvTable& table, const std::vector<std::string>& groups) {
    require_whole(table);
    const auto [group, number, agent, game, seed, step, score, total] = columns_of(table);
    std::map<std::pair<std::string, std::uint64_t>, Run> runs;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
        const auto& cells = table.rows[row];
        if (std::ranges::find(groups, cells[group]) == groups.end()) continue;
        auto& run = runs[{cells[group], natural(table, row, number)}];
        const auto& played = game_in(table, row, game);
        const auto its_seed = natural(table, row, seed);
        if (run.game != nullptr && (run.game != &played || run.agent != cells[agent] || run.seed != its_seed))
            throw row_error(table, row, "the agent, the game and the seed of a run change");
        run.folder = table.path;
        run.recorded_as = cells[group];
        run.agent = cells[agent];
        run.game = &played;
        run.seed = its_seed;
        run.total_steps = table.number(row, total);
        if (!run.steps.empty() && table.number(row, step) <= run.steps.back())
            throw row_error(table, row, "the steps of a run do not ascend");
        run.steps.push_back(table.number(row, step));
        run.scores.push_back(table.score(row, score));
        for (std::size_t i = 0; i < table.columns.size(); ++i)
            if (table.columns[i].starts_with(kRules) && !cells[i].empty())
                run.settings[table.columns[i]] = cells[i];
    }
    std::vector<Run> result;
    for (auto& [identity, run] : runs) {
        run.env = env_of(run.settings);
        if (run.env) run.env->game = run.game->name;
        run.reached = run.steps.back();
        run.finished = run.reached >= run.total_steps;
        result.push_back(std::move(run));
    }
    return result;
}

}  // namespace cale
