#include "report/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "cale/action.h"
#include "cale/fields.h"
#include "cale/text.h"
#include "report/csv.h"
#include "report/ranges.h"
#include "report/recorded_runs.h"

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

/// Those that any group has played, in alphabetical order.
std::vector<const Game*> played_games(const Comparison& comparison) {
    std::vector<const Game*> played;
    for (const auto& game : all_games()) {
        const auto has_it = [&](const GroupResult& group) { return group.find(game.name) != nullptr; };
        if (std::ranges::any_of(comparison.results, has_it)) played.push_back(&game);
    }
    return played;
}

/// The scores that games are normalised with, and between them what random play scores on the joystick.
std::vector<Baseline> random_and_human(const Comparison& comparison) {
    Baseline random{.name = std::string(kPublishedRandom)}, human{.name = "human"};
    for (const auto& game : games()) {
        if (game.random_score) random.scores[std::string(game.name)] = *game.random_score;
        if (game.human_score) human.scores[std::string(game.name)] = *game.human_score;
    }
    std::vector<Baseline> references{std::move(random)};
    for (const auto& floor : comparison.random_floors)
        if (floor.name != kPublishedRandom) references.push_back(floor);
    references.push_back(std::move(human));
    return references;
}

/// The results with the highest mean; none where all groups have the same.
std::vector<const GameResult*> best_of(const Comparison& comparison, const Game& game) {
    std::vector<const GameResult*> results;
    for (const auto& group : comparison.results)
        if (const auto* result = group.find(game.name)) results.push_back(result);
    double best = -HUGE_VAL;
    for (const auto* result : results) best = std::max(best, result->mean.value);
    const auto lower = [&](const GameResult* result) { return !nearly_equal(result->mean.value, best); };
    return std::erase_if(results, lower) > 0 ? results : std::vector<const GameResult*>();
}

/// "1-5, 8"
std::string seeds_text(const std::set<std::uint64_t>& seeds) {
    std::vector<std::string> spans;
    for (auto first = seeds.begin(); first != seeds.end();) {
        auto last = first, next = std::next(first);
        while (next != seeds.end() && *next == *last + 1) last = next++;
        spans.push_back(first == last ? fmt::format("{}", *first) : fmt::format("{}-{}", *first, *last));
        first = next;
    }
    return joined(spans, ", ");
}

/// Agents follow either with lengths of games of their own, which the settings tell.
std::string protocol_text(const EnvConfig& env) {
    for (const auto& [name, protocol] : {std::pair("200M frames", protocol_200m(env.game)),
                                         std::pair("Atari 100k", protocol_atari100k(env.game))}) {
        if (env.sticky_probability == protocol.sticky_probability &&
            env.terminal_on_life_loss == protocol.terminal_on_life_loss &&
            env.frame_skip == protocol.frame_skip)
            return name;
    }
    return fmt::format("sticky actions {:g}, {}, frame skip {}", env.sticky_probability,
                       env.terminal_on_life_loss ? "episodes end with a life" : "whole games",
                       env.frame_skip);
}

std::string action_space_text(const EnvConfig& env) {
    if (env.action_space != ActionSet::continuous)
        return fmt::format("discrete, {}", name_of(env.action_space));
    const auto joystick = coordinates(env);
    const auto chosen_by = joystick == Joystick::polar ? "" : fmt::format(" {}", name_of(joystick));
    return fmt::format("joystick{}, threshold {:g}", chosen_by, env.threshold);
}

Table settings_by_group(const Comparison& comparison, const std::vector<SettingRow>& settings) {
    Table table{.header = {"setting"}};
    std::ranges::copy(labels_of(comparison), std::back_inserter(table.header));
    for (const auto& [key, values] : settings) {
        auto& row = table.rows.emplace_back(1, key);
        row.insert(row.end(), values.begin(), values.end());
    }
    return table;
}

std::string to_csv(const Table& table) {
    std::string text = csv_line(table.header);
    for (const auto& row : table.rows) text += csv_line(row);
    return text;
}

/// Without what LaTeX would take for mark-up, and with a minus before numbers instead of a hyphen.
std::string latex_text(std::string_view text) {
    std::string latex;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        const bool starts_word = i == 0 || text[i - 1] == ' ' || text[i - 1] == '[';
        const bool digit_follows = i + 1 < text.size() && text[i + 1] >= '0' && text[i + 1] <= '9';
        if (c == '[' && i == 0) {
            latex += "{[}";  // \\ and \midrule would take it for their option
        } else if (c == '-' && starts_word && digit_follows) {
            latex += "$-$";
        } else if (c == '\\') {
            latex += "\\textbackslash{}";
        } else if (c == '~' || c == '^') {
            latex += fmt::format("\\{}{{}}", c);
        } else if (c == '<' || c == '>' || c == '|') {
            latex += fmt::format("${}$", c);
        } else {
            if (std::string_view("&%$#_{}").find(c) != std::string_view::npos) latex += '\\';
            latex += c;
        }
    }
    return latex;
}

/// Without what Markdown would take for the end of a cell or for mark-up.
std::string markdown_text(std::string_view text) {
    std::string markdown;
    for (const char c : text) {
        if (std::string_view("|*_`~<\\").find(c) != std::string_view::npos) markdown += '\\';
        markdown += c;
    }
    return markdown;
}

/// The header and the rows without mark-up of their own, bold cells between two marks.
std::vector<std::vector<std::string>> marked_up(const Table& table, std::string (*escape)(std::string_view),
                                                std::string_view begin, std::string_view end) {
    const auto plain = [&](const std::string& cell) { return escape(printable(cell)); };
    std::vector<std::vector<std::string>> rows{mapped(table.header, plain)};
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
        auto& row = rows.emplace_back(mapped(table.rows[i], plain));
        for (std::size_t column = 0; column < row.size(); ++column)
            if (table.is_bold(i, column)) row[column] = fmt::format("{}{}{}", begin, row[column], end);
    }
    return rows;
}

/// An estimate for three columns; those of its interval are empty where there is none.
struct EstimateCells {
    const Estimate& estimate;
    bool with_interval;
};

/// Collects the rows of a CSV file.
class CsvWriter {
  public:
    CsvWriter(std::string name, const std::vector<std::string>& header)
        : file_{std::move(name), csv_line(header)} {}

    template <class... Cells>
    void row(const Cells&... cells) {
        std::vector<std::string> texts;
        (add(texts, cells), ...);
        file_.text += csv_line(texts);
        ++rows_;
    }
    void add_to(std::vector<TextFile>& files) {
        if (rows_ > 0) files.push_back(std::move(file_));
    }

  private:
    template <class Cell>
    static void add(std::vector<std::string>& row, const Cell& cell) {
        row.push_back(fmt::format("{}", cell));
    }
    static void add(std::vector<std::string>& row, const EstimateCells& cells) {
        const auto& [value, low, high] = cells.estimate;
        add(row, value);
        for (const double end : {low, high}) row.push_back(cells.with_interval ? fmt::format("{}", end) : "");
    }

    TextFile file_;
    std::size_t rows_ = 0;
};

void add_scores(const Comparison& comparison, std::vector<TextFile>& files) {
    CsvWriter csv("scores.csv", {"group", "agent", "game", "seed", "step", "games_in_score", "score",
                                 "human_normalized", "folder"});
    for (const auto& group : comparison.results) {
        for (const auto& game : group.games) {
            for (const auto* run : game.runs) {
                const bool compares = game.game->human_score && !(run->env && is_variant(*run->env));
                const auto normalised =
                    compares ? fmt::format("{}", human_normalised(run->score(), *game.game)) : std::string();
                // How many games are behind a recorded score is not known.
                const auto games =
                    run->recorded_as.empty() ? fmt::format("{}", run->games_in_score) : std::string();
                csv.row(group.label, run->agent, game.game->name, run->seed, run->steps.back(), games,
                        run->score(), normalised, printable(run->folder.string()));
            }
        }
    }
    csv.add_to(files);
}

void add_aggregates(const Comparison& comparison, std::vector<TextFile>& files) {
    if (comparison.games.empty()) return;
    const auto names = names_of(Metric{});
    CsvWriter aggregates("aggregates.csv",
                         {"group", "metric", "value", "low", "high", "games", "runs_per_game"});
    CsvWriter curves("sample_efficiency.csv", {"group", "step", "metric", "value", "low", "high"});
    CsvWriter profiles("performance_profiles.csv", {"group", "tau", "fraction", "low", "high"});
    for (const auto& group : comparison.results) {
        const bool with_interval = group.has_interval();
        for (std::size_t m = 0; m < kMetricCount; ++m)
            aggregates.row(group.label, names[m], EstimateCells{group.aggregates[m], with_interval},
                           comparison.games.size(), span_text(group.least_runs, group.most_runs));
        for (std::size_t i = 0; i < group.curve.size(); ++i)
            for (std::size_t m = 0; m < kMetricCount; ++m)
                curves.row(group.label, group.curve_steps[i], names[m],
                           EstimateCells{group.curve[i][m], with_interval});
        for (std::size_t i = 0; i < group.profile.size(); ++i)
            profiles.row(group.label, comparison.thresholds[i],
                         EstimateCells{group.profile[i], with_interval});
    }
    for (const auto& [baseline, values] : comparison.baselines)
        for (std::size_t m = 0; m < kMetricCount; ++m)
            aggregates.row(baseline.name, names[m], values[m].value, "", "", comparison.games.size(), "");
    CsvWriter improvements("probability_of_improvement.csv", {"x", "y", "probability", "low", "high"});
    for (const auto& pair : comparison.improvements)
        improvements.row(comparison.results[pair.x].label, comparison.results[pair.y].label,
                         EstimateCells{pair.probability, pair.has_interval});
    for (auto* csv : {&aggregates, &profiles, &improvements, &curves}) csv->add_to(files);
}

void add_games(const Comparison& comparison, std::vector<TextFile>& files) {
    CsvWriter scores("game_scores.csv", {"group", "game", "runs", "mean", "low", "high"});
    CsvWriter curves("game_curves.csv", {"group", "game", "step", "mean", "low", "high"});
    CsvWriter events("events.csv", {"group", "game", "event", "share"});
    CsvWriter zones("zones.csv", {"group", "game", "step", "zone", "share"});
    CsvWriter rewards("rewards.csv", {"group", "game", "quantile", "reward"});
    for (const auto& group : comparison.results) {
        for (const auto& game : group.games) {
            const auto name = game.game->name;
            const bool with_interval = game.has_interval();
            scores.row(group.label, name, game.runs.size(), EstimateCells{game.mean, with_interval});
            for (std::size_t i = 0; i < game.curve.steps.size(); ++i)
                curves.row(group.label, name, game.curve.steps[i],
                           EstimateCells{game.curve.values[i], with_interval});
            for (std::size_t i = 0; i < game.event_shares.size(); ++i)
                events.row(group.label, name, event_name(static_cast<Event>(i)), game.event_shares[i]);
            for (const auto& [step, shares] : game.zones)
                for (std::size_t i = 0; i < shares.size(); ++i)
                    zones.row(group.label, name, step, kZones[i], shares[i]);
            for (const auto& [quantile, reward] : game.reward_quantiles)
                rewards.row(group.label, name, quantile, reward);
        }
    }
    for (const auto& references : {random_and_human(comparison), published(comparison)})
        for (const auto& [name, of_games] : references)
            for (const auto* game : played_games(comparison))
                if (const auto score = of_games.find(game->name); score != of_games.end())
                    scores.row(name, game->name, "", score->second, "", "");
    for (auto* csv : {&scores, &curves, &events, &zones, &rewards}) csv->add_to(files);
}

}  // namespace

std::vector<Baseline> published(const Comparison& comparison) {
    return mapped(comparison.baselines, &BaselineResult::baseline);
}

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
    for (const auto& pair : comparison.improvements)
        table.rows.push_back({comparison.results[pair.x].label, comparison.results[pair.y].label,
                              estimate_text(pair.probability, pair.has_interval, number_text)});
    return table;
}

Table game_table(const Comparison& comparison) {
    const auto before = random_and_human(comparison), after = published(comparison);
    Table table{.header = {"game"}};
    for (const auto& names :
         {mapped(before, &Baseline::name), labels_of(comparison), mapped(after, &Baseline::name)})
        table.header.insert(table.header.end(), names.begin(), names.end());
    for (const auto* game : played_games(comparison)) {
        std::vector<std::string> row{std::string(game->name)};
        std::vector<bool> bold(table.header.size(), false);
        const auto add = [&](const std::vector<Baseline>& references) {
            for (const auto& [name, scores] : references) {
                const auto score = scores.find(game->name);
                row.push_back(score == scores.end() ? "" : score_text(score->second));
            }
        };
        add(before);
        const auto best = best_of(comparison, *game);
        for (const auto& group : comparison.results) {
            const auto* result = group.find(game->name);
            bold[row.size()] = std::ranges::find(best, result) != best.end();
            row.push_back(
                result == nullptr ? "" : estimate_text(result->mean, result->has_interval(), score_text));
        }
        add(after);
        table.best.push_back(std::move(bold));
        table.rows.push_back(std::move(row));
    }
    return table;
}

Table setup_table(const Comparison& comparison) {
    Table table{
        .name_columns = 4,
        .header = {"group", "agent", "protocol", "action space", "agent steps", "games", "seeds", "runs"}};
    for (const auto& group : comparison.groups) {
        std::set<std::string> agents, games, steps, protocols, actions;
        std::set<std::uint64_t> seeds;
        for (const auto& run : group.runs) {
            agents.insert(run.agent);
            games.emplace(run.game->name);
            seeds.insert(run.seed);
            steps.insert(run.total_steps > 0 ? fmt::format("{:.0f}", run.total_steps) : "unknown");
            protocols.insert(run.env ? protocol_text(*run.env) : "unknown");
            actions.insert(run.env ? action_space_text(*run.env) : "unknown");
        }
        table.rows.push_back({group.label, joined(agents, " / "), joined(protocols, " / "),
                              joined(actions, " / "), joined(steps, " / "), fmt::format("{}", games.size()),
                              seeds_text(seeds), fmt::format("{}", group.runs.size())});
    }
    return table;
}

Table setting_table(const Comparison& comparison) {
    return settings_by_group(comparison, differing_settings(comparison.groups));
}

Table shared_setting_table(const Comparison& comparison) {
    Table table{.name_columns = 2, .header = {"setting", "value"}};
    for (const auto& [key, values] : shared_settings(comparison.groups))
        table.rows.push_back({key, values.front()});
    return table;
}

std::string runs_text(const std::set<std::size_t>& counts) {
    if (counts.empty()) return "no runs";
    const auto least = *counts.begin(), most = *counts.rbegin();
    return fmt::format("{} run{} per game", span_text(least, most), most == 1 ? "" : "s");
}

std::string runs_text(const Comparison& comparison) {
    std::set<std::size_t> counts;
    for (const auto& result : comparison.results) counts.insert({result.least_runs, result.most_runs});
    return runs_text(counts);
}

std::string runs_text_of_all_games(const Comparison& comparison) {
    std::set<std::size_t> counts;
    for (const auto& group : comparison.results)
        for (const auto& game : group.games) counts.insert(game.runs.size());
    return runs_text(counts);
}

std::string to_text(const Table& table) {
    auto rows = table.rows;
    rows.insert(rows.begin(), table.header);
    std::vector<std::size_t> widths(table.header.size(), 0);
    for (auto& row : rows) {
        for (std::size_t i = 0; i < row.size(); ++i) {
            row[i] = printable(row[i]);
            widths[i] = std::max(widths[i], row[i].size());
        }
    }
    std::string text;
    for (const auto& row : rows) {
        std::string line;
        for (std::size_t i = 0; i < row.size(); ++i) line += fmt::format("{:<{}}  ", row[i], widths[i]);
        text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
    }
    return text;
}

std::string to_latex(const Table& table) {
    const auto values = table.header.size() - table.name_columns;
    std::string latex = fmt::format("% \\usepackage{{booktabs}}\n\\begin{{tabular}}{{{}{}}}\n\\toprule\n",
                                    std::string(table.name_columns, 'l'), std::string(values, 'r'));
    const auto rows = marked_up(table, latex_text, "\\textbf{", "}");
    for (std::size_t i = 0; i < rows.size(); ++i) {
        latex += joined(rows[i], " & ") + " \\\\\n";
        if (i == 0) latex += "\\midrule\n";
    }
    return latex + "\\bottomrule\n\\end{tabular}\n";
}

std::string to_markdown(const Table& table) {
    std::string below_header;
    for (std::size_t column = 0; column < table.header.size(); ++column)
        below_header += column < table.name_columns ? "|---" : "|---:";
    std::string text;
    const auto rows = marked_up(table, markdown_text, "**", "**");
    for (std::size_t i = 0; i < rows.size(); ++i) {
        text += "| " + joined(rows[i], " | ") + " |\n";
        if (i == 0) text += below_header + "|\n";
    }
    return text;
}

std::vector<TextFile> csv_files(const Comparison& comparison) {
    std::vector<TextFile> files;
    add_scores(comparison, files);
    if (auto recorded = recorded_runs_csv(comparison); !recorded.empty())
        files.push_back({"run_curves.csv", std::move(recorded)});
    files.push_back({"setup.csv", to_csv(setup_table(comparison))});
    files.push_back({"settings.csv", to_csv(settings_by_group(comparison, all_settings(comparison.groups)))});
    add_aggregates(comparison, files);
    add_games(comparison, files);
    return files;
}

std::vector<TextFile> table_files(const Comparison& comparison) {
    std::vector<TextFile> files;
    const auto add = [&](const std::string& name, const Table& table) {
        if (table.rows.empty()) return;
        files.push_back({name + ".tex", to_latex(table)});
        files.push_back({name + ".md", to_markdown(table)});
    };
    add("setup", setup_table(comparison));
    add("settings", settings_by_group(comparison, all_settings(comparison.groups)));
    add("aggregates", aggregate_table(comparison));
    add("probability_of_improvement", improvement_table(comparison));
    add("game_scores", game_table(comparison));
    return files;
}

}  // namespace cale
