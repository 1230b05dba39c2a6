#include "report/recorded_runs.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <tuple>

#include <fmt/format.h>

#include "cale/games.h"
#include "cale/text.h"
#include "report/csv.h"

namespace cale {
namespace {

constexpr int kParts = 10;  // of a run
constexpr std::array<std::string_view, 6> kColumns{"group", "agent", "game", "seed", "step", "score"};
/// The rules of a game, and what random play is measured by.
constexpr std::array<std::string_view, 7> kRules{
    "env.obs",       "env.action_space",       "env.joystick",
    "env.threshold", "env.sticky_probability", "env.terminal_on_life_loss",
    "env.frame_skip"};

std::string setting_of(const Run& run, std::string_view key) {
    const auto found = run.settings.find(std::string(key));
    return found == run.settings.end() ? std::string() : found->second;
}

/// The last score up to this step; none before the first.
std::optional<double> score_at(const Run& run, double step) {
    const auto next = std::ranges::upper_bound(run.steps, step);
    if (next == run.steps.begin()) return std::nullopt;
    return run.scores[static_cast<std::size_t>(next - run.steps.begin()) - 1];
}

std::vector<double> recorded_steps(const Run& run) {
    const double all = run.total_steps > 0 ? run.total_steps : run.steps.back();
    const double end = run.finished ? all : run.reached;
    std::vector<double> steps;
    for (int part = 1; part <= kParts && all * part / kParts <= end; ++part)
        steps.push_back(all * part / kParts);
    if (steps.empty() || steps.back() < end) steps.push_back(end);
    return steps;
}

std::uint64_t seed_of(const CsvTable& table, std::size_t row, std::size_t column) {
    const auto& text = table.rows[row][column];
    if (const auto seed = number_in<std::uint64_t>(text)) return *seed;
    throw std::runtime_error(
        fmt::format("{}:{}: the seed '{}' is no number", table.path.string(), table.lines[row], text));
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
    std::vector<std::string> header(kColumns.begin(), kColumns.end());
    header.insert(header.end(), kRules.begin(), kRules.end());
    auto text = csv_line(header);
    for (const auto& group : comparison.results) {
        for (const auto& game : group.games) {
            for (const auto* run : game.runs) {
                for (const double step : recorded_steps(*run)) {
                    const auto score = score_at(*run, step);
                    if (!score) continue;
                    std::vector<std::string> cells{group.label,
                                                   run->agent,
                                                   std::string(game.game->name),
                                                   fmt::to_string(run->seed),
                                                   fmt::format("{:.0f}", step),
                                                   fmt::format("{}", *score)};
                    for (const auto key : kRules) cells.push_back(setting_of(*run, key));
                    text += csv_line(cells);
                }
            }
        }
    }
    return text;
}

std::vector<std::string> recorded_groups(const std::filesystem::path& csv) {
    const auto table = read_whole_csv(csv);
    const auto group = columns_of(table)[0];
    std::vector<std::string> groups;
    for (const auto& row : table.rows)
        if (std::ranges::find(groups, row[group]) == groups.end()) groups.push_back(row[group]);
    return groups;
}

std::vector<Run> read_recorded_runs(const std::filesystem::path& csv,
                                    const std::vector<std::string>& groups) {
    const auto table = read_whole_csv(csv);
    const auto [group, agent, game, seed, step, score] = columns_of(table);
    std::map<std::tuple<std::string, std::string_view, std::uint64_t>, Run> runs;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
        const auto& cells = table.rows[row];
        if (std::ranges::find(groups, cells[group]) == groups.end()) continue;
        const auto& played = find_game(cells[game]);
        auto& run = runs[{cells[group], played.name, seed_of(table, row, seed)}];
        run.recorded_as = cells[group];
        run.agent = cells[agent];
        run.game = &played;
        run.seed = seed_of(table, row, seed);
        run.steps.push_back(table.number(row, step));
        run.scores.push_back(table.score(row, score));
        if (run.steps.size() > 1 && run.steps.back() <= run.steps[run.steps.size() - 2])
            throw std::runtime_error(fmt::format("{}:{}: the steps of a run do not ascend",
                                                 table.path.string(), table.lines[row]));
        for (std::size_t i = 0; i < table.columns.size(); ++i)
            if (table.columns[i].find('.') != std::string::npos && !cells[i].empty())
                run.settings[table.columns[i]] = cells[i];
    }
    std::vector<Run> result;
    for (auto& [identity, run] : runs) {
        run.folder = csv;
        run.env = env_of(run.settings);
        if (run.env) run.env->game = run.game->name;
        run.finished = true;
        run.total_steps = run.reached = run.steps.back();
        result.push_back(std::move(run));
    }
    return result;
}

}  // namespace cale
