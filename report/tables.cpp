#include "report/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "cale/action.h"
#include "cale/text.h"
#include "report/csv.h"

namespace cale {
namespace {

/// A score as a game counts it.
std::string score_text(double score) {
    return std::abs(score) < 100 ? fmt::format("{:.1f}", score) : fmt::format("{:.0f}", score);
}

template <class Text>
std::string estimate_text(const Estimate& estimate, bool with_interval, Text&& text) {
    if (!with_interval) return text(estimate.value);
    return fmt::format("{} [{}, {}]", text(estimate.value), text(estimate.low), text(estimate.high));
}

std::string number_text(double value) {
    return fmt::format("{:.3f}", value);
}

std::string span_text(std::size_t least, std::size_t most) {
    return least == most ? fmt::format("{}", least) : fmt::format("{}-{}", least, most);
}

const GameResult* result_on(const GroupResult& group, const Game& game) {
    const auto found = std::find_if(group.games.begin(), group.games.end(),
                                    [&](const auto& own) { return own.game == &game; });
    return found == group.games.end() ? nullptr : &*found;
}

/// Collects the rows of a CSV file.
class CsvWriter {
  public:
    CsvWriter(std::string name, const std::vector<std::string>& header)
        : file_{std::move(name), csv_line(header)} {}

    template <class... Cells>
    void row(const Cells&... cells) {
        file_.text += csv_line({fmt::format("{}", cells)...});
        ++rows_;
    }
    void add_to(std::vector<CsvFile>& files) {
        if (rows_ > 0) files.push_back(std::move(file_));
    }

  private:
    CsvFile file_;
    std::size_t rows_ = 0;
};

void add_scores(const Comparison& comparison, std::vector<CsvFile>& files) {
    CsvWriter csv("scores.csv", {"group", "agent", "game", "seed", "step", "games_in_score", "score",
                                 "human_normalized", "folder"});
    for (const auto& group : comparison.results) {
        for (const auto& game : group.games) {
            for (const auto* run : game.runs) {
                const auto normalised = game.game->human_score
                                            ? fmt::format("{}", human_normalised(run->score(), *game.game))
                                            : std::string();
                csv.row(group.label, run->agent, game.game->name, run->seed, run->steps.back(),
                        run->games_in_score, run->score(), normalised, run->folder.string());
            }
        }
    }
    csv.add_to(files);
}

void add_aggregates(const Comparison& comparison, std::vector<CsvFile>& files) {
    if (comparison.games.empty()) return;
    const auto names = names_of(Metric{});
    CsvWriter aggregates("aggregates.csv",
                         {"group", "metric", "value", "low", "high", "games", "runs_per_game"});
    CsvWriter curves("sample_efficiency.csv", {"group", "step", "metric", "value", "low", "high"});
    CsvWriter profiles("performance_profiles.csv", {"group", "tau", "fraction", "low", "high"});
    for (const auto& group : comparison.results) {
        for (std::size_t m = 0; m < kMetricCount; ++m) {
            const auto& [value, low, high] = group.aggregates[m];
            aggregates.row(group.label, names[m], value, low, high, comparison.games.size(),
                           span_text(group.least_runs, group.most_runs));
        }
        for (std::size_t i = 0; i < group.curve.size(); ++i) {
            for (std::size_t m = 0; m < kMetricCount; ++m) {
                const auto& [value, low, high] = group.curve[i][m];
                curves.row(group.label, group.curve_steps[i], names[m], value, low, high);
            }
        }
        for (std::size_t i = 0; i < group.profile.size(); ++i) {
            const auto& [value, low, high] = group.profile[i];
            profiles.row(group.label, comparison.thresholds[i], value, low, high);
        }
    }
    for (const auto& [baseline, values] : comparison.baselines)
        for (std::size_t m = 0; m < kMetricCount; ++m)
            aggregates.row(baseline.name, names[m], values[m].value, "", "", comparison.games.size(), "");
    CsvWriter improvements("probability_of_improvement.csv", {"x", "y", "probability", "low", "high"});
    for (const auto& [x, y, probability] : comparison.improvements)
        improvements.row(comparison.results[x].label, comparison.results[y].label, probability.value,
                         probability.low, probability.high);
    aggregates.add_to(files);
    profiles.add_to(files);
    improvements.add_to(files);
    curves.add_to(files);
}

void add_games(const Comparison& comparison, std::vector<CsvFile>& files) {
    CsvWriter scores("game_scores.csv", {"group", "game", "runs", "mean", "low", "high"});
    CsvWriter curves("game_curves.csv", {"group", "game", "step", "mean", "low", "high"});
    CsvWriter events("events.csv", {"group", "game", "event", "share"});
    CsvWriter rewards("reward_quantiles.csv", {"group", "game", "quantile", "reward"});
    for (const auto& group : comparison.results) {
        for (const auto& game : group.games) {
            const auto name = game.game->name;
            scores.row(group.label, name, game.runs.size(), game.mean.value, game.mean.low, game.mean.high);
            for (std::size_t i = 0; i < game.curve.steps.size(); ++i) {
                const auto& [value, low, high] = game.curve.values[i];
                curves.row(group.label, name, game.curve.steps[i], value, low, high);
            }
            for (std::size_t i = 0; i < game.event_shares.size(); ++i)
                events.row(group.label, name, event_name(static_cast<Event>(i)), game.event_shares[i]);
            for (const auto& [quantile, reward] : game.reward_quantiles)
                rewards.row(group.label, name, quantile, reward);
        }
    }
    scores.add_to(files);
    curves.add_to(files);
    events.add_to(files);
    rewards.add_to(files);
}

}  // namespace

Table aggregate_table(const Comparison& comparison) {
    Table table{.header = {"", "IQM", "median", "mean", "optimality gap", "games", "runs/game"}};
    if (comparison.games.empty()) return table;
    const auto games = fmt::format("{}", comparison.games.size());
    for (const auto& group : comparison.results) {
        auto& row = table.rows.emplace_back(1, group.label);
        for (const auto& estimate : group.aggregates)
            row.push_back(estimate_text(estimate, group.has_interval(), number_text));
        row.push_back(games);
        row.push_back(span_text(group.least_runs, group.most_runs));
    }
    for (const auto& [baseline, aggregates] : comparison.baselines) {
        auto& row = table.rows.emplace_back(1, baseline.name);
        for (const auto& estimate : aggregates) row.push_back(number_text(estimate.value));
        row.push_back(games);
        row.push_back("literature");
    }
    return table;
}

Table improvement_table(const Comparison& comparison) {
    Table table{.name_columns = 2, .header = {"X", "Y", "P(X > Y)"}};
    for (const auto& [x, y, probability] : comparison.improvements) {
        const auto &first = comparison.results[x], &second = comparison.results[y];
        table.rows.push_back(
            {first.label, second.label,
             estimate_text(probability, first.has_interval() || second.has_interval(), number_text)});
    }
    return table;
}

Table game_table(const Comparison& comparison) {
    Table table{.header = {"game", "random", "human"}};
    for (const auto& group : comparison.results) table.header.push_back(group.label);
    for (const auto& [baseline, aggregates] : comparison.baselines) table.header.push_back(baseline.name);
    for (const auto& game : games()) {
        std::vector<std::string> row{std::string(game.name),
                                     game.random_score ? score_text(*game.random_score) : "",
                                     game.human_score ? score_text(*game.human_score) : ""};
        std::size_t best = 0;
        double highest = -HUGE_VAL;
        for (const auto& group : comparison.results) {
            const auto* result = result_on(group, game);
            if (result != nullptr && result->mean.value > highest) {
                highest = result->mean.value;
                best = row.size();
            }
            row.push_back(
                result == nullptr ? "" : estimate_text(result->mean, result->runs.size() > 1, score_text));
        }
        if (best == 0) continue;  // nobody played it
        for (const auto& [baseline, aggregates] : comparison.baselines) {
            const auto score = baseline.scores.find(game.name);
            row.push_back(score == baseline.scores.end() ? "" : score_text(score->second));
        }
        std::vector<bool> bold(row.size(), false);
        bold[best] = comparison.results.size() > 1;
        table.best.push_back(std::move(bold));
        table.rows.push_back(std::move(row));
    }
    return table;
}

Table setting_table(const Comparison& comparison) {
    Table table{.header = {"setting"}};
    for (const auto& group : comparison.groups) table.header.push_back(group.label);
    for (const auto& setting : differing_settings(comparison.groups)) {
        auto& row = table.rows.emplace_back(1, setting.key);
        row.insert(row.end(), setting.values.begin(), setting.values.end());
    }
    return table;
}

std::string runs_text(const Comparison& comparison) {
    std::size_t least = comparison.results.front().least_runs, most = 0;
    for (const auto& result : comparison.results) {
        least = std::min(least, result.least_runs);
        most = std::max(most, result.most_runs);
    }
    return fmt::format("{} run{} per game", span_text(least, most), most == 1 ? "" : "s");
}

std::string to_text(const Table& table) {
    std::vector<std::size_t> widths(table.header.size(), 0);
    const auto measure = [&](const std::vector<std::string>& row) {
        for (std::size_t i = 0; i < row.size(); ++i)
            widths[i] = std::max(widths[i], printable(row[i]).size());
    };
    measure(table.header);
    for (const auto& row : table.rows) measure(row);
    std::string text;
    const auto write = [&](const std::vector<std::string>& row) {
        std::string line;
        for (std::size_t i = 0; i < row.size(); ++i)
            line += fmt::format("{:<{}}  ", printable(row[i]), widths[i]);
        text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
    };
    write(table.header);
    for (const auto& row : table.rows) write(row);
    return text;
}

std::vector<CsvFile> csv_files(const Comparison& comparison) {
    std::vector<CsvFile> files;
    add_scores(comparison, files);
    add_aggregates(comparison, files);
    add_games(comparison, files);
    return files;
}

}  // namespace cale
