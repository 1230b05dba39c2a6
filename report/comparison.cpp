#include "report/comparison.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <optional>
#include <set>
#include <stdexcept>
#include <tuple>

#include "cale/random_play.h"
#include "cale/text.h"
#include "report/ranges.h"

namespace cale {
namespace {

constexpr std::size_t kCurvePoints = 51;
constexpr double kThresholdsPerHumanScore = 100;
constexpr double kLastThreshold = 8;
constexpr std::size_t kFewRuns = 5;
constexpr std::int64_t kFewGames = 5;  // behind the score of a run

/// Steps at which all runs have a score, from where the last of them has its first to where the first of
/// them ends: their own where these agree, else equally far apart.
std::vector<double> common_steps(const std::vector<const Run*>& runs) {
    double begin = 0, end = HUGE_VAL;
    for (const auto* run : runs) {
        begin = std::max(begin, run->steps.front());
        end = std::min(end, run->steps.back());
    }
    const auto between = [&](const Run* run) {
        std::vector<double> own;
        std::ranges::copy_if(run->steps, std::back_inserter(own),
                             [&](double step) { return begin <= step && step <= end; });
        return own;
    };
    auto steps = between(runs.front());
    const auto agrees = [&](const Run* run) { return between(run) == steps; };
    if (steps.size() <= kCurvePoints && std::ranges::all_of(runs, agrees)) return steps;
    steps.clear();
    for (std::size_t i = 0; begin < end && i < kCurvePoints; ++i)
        steps.push_back(begin + (end - begin) * static_cast<double>(i) / (kCurvePoints - 1));
    return steps;
}

/// Element by element, of vectors that are equally long.
std::vector<double> mean_of(const std::vector<std::vector<double>>& rows) {
    if (rows.empty()) return {};
    auto mean = rows.front();
    for (std::size_t row = 1; row < rows.size(); ++row)
        std::ranges::transform(mean, rows[row], mean.begin(), std::plus());
    for (auto& value : mean) value /= static_cast<double>(rows.size());
    return mean;
}

std::vector<double> mean_event_shares(const std::vector<const Run*>& runs) {
    auto shares = mapped(runs, &Run::event_shares);
    std::erase(shares, std::vector<double>());
    return mean_of(shares);
}

/// Quantile by quantile the mean of those runs that have the same quantiles as the first.
std::vector<RewardQuantile> mean_reward_quantiles(const std::vector<const Run*>& runs) {
    std::vector<double> quantiles;
    std::vector<std::vector<double>> rewards;
    for (const auto* run : runs) {
        const auto own = mapped(run->reward_quantiles, &RewardQuantile::quantile);
        if (quantiles.empty()) quantiles = own;
        if (!own.empty() && own == quantiles)
            rewards.push_back(mapped(run->reward_quantiles, &RewardQuantile::reward));
    }
    std::vector<RewardQuantile> mean;
    for (const double reward : mean_of(rewards)) mean.push_back({quantiles[mean.size()], reward});
    return mean;
}

std::vector<ZoneRow> mean_zones(const std::vector<const Run*>& runs) {
    constexpr double kParts = 40;
    double end = 0;
    for (const auto* run : runs)
        if (!run->zones.empty()) end = std::max(end, run->zones.back().step);
    if (end <= 0) return {};
    std::map<double, std::pair<ZoneRow, double>> parts;  // by number: sums, and of how many rows
    for (const auto* run : runs) {
        for (const auto& [step, shares] : run->zones) {
            auto& [sum, rows] = parts[std::ceil(step / end * kParts)];
            for (std::size_t zone = 0; zone < shares.size(); ++zone) sum.shares[zone] += shares[zone];
            ++rows;
        }
    }
    std::vector<ZoneRow> mean;
    for (auto& [part, sum] : parts) {
        for (auto& share : sum.first.shares) share /= sum.second;
        mean.push_back({end * part / kParts, sum.first.shares});
    }
    return mean;
}

GameResult result_on(const Game& game, std::vector<const Run*> runs, const ComparisonConfig& config) {
    std::ranges::sort(runs, {}, &Run::seed);
    GameResult result{.game = &game, .runs = runs};
    result.mean = mean_of_runs(mapped(runs, &Run::score), config.bootstrap);
    result.curve.steps = common_steps(runs);
    result.curve.values = mapped(result.curve.steps, [&](double step) {
        const auto then = [step](const Run* run) { return score_at(*run, step).value(); };
        return mean_of_runs(mapped(runs, then), config.for_bands());
    });
    result.event_shares = mean_event_shares(runs);
    result.reward_quantiles = mean_reward_quantiles(runs);
    result.zones = mean_zones(runs);
    return result;
}

GroupResult result_of(const Group& group, const ComparisonConfig& config) {
    std::map<std::string_view, std::vector<const Run*>> by_game;
    for (const auto& run : group.runs) by_game[run.game->name].push_back(&run);
    GroupResult result{.label = group.label};
    for (const auto& [name, runs] : by_game)
        result.games.push_back(result_on(*runs.front()->game, runs, config));
    return result;
}

/// "a; b; c and 9 other groups"
std::string some_of(const std::vector<std::string_view>& groups) {
    const auto named = std::min<std::size_t>(groups.size(), 3);
    const auto text = joined(std::span(groups).first(named), "; ");
    return named == groups.size() ? text : text + " and " + counted(groups.size() - named, "other group");
}

/// The labels of the groups in which a run is so.
template <class Is>
std::vector<std::string> groups_where(const Comparison& comparison, Is&& is) {
    std::vector<std::string> labels;
    for (const auto& group : comparison.groups)
        if (std::ranges::any_of(group.runs, is)) labels.push_back(group.label);
    return labels;
}

/// Fills `games` and `left_out_games`.
void choose_games(Comparison& comparison) {
    for (const auto& game : all_games()) {
        std::vector<std::string_view> without;
        for (const auto& result : comparison.results)
            if (result.find(game.name) == nullptr) without.push_back(result.label);
        if (without.size() == comparison.results.size()) continue;  // no run played it
        const auto is_variant_of_game = [&](const Run& run) {
            return run.game == &game && run.env && is_variant(*run.env);
        };
        std::string reason;
        if (!game.human_score || !game.random_score) {
            reason = "there is no human score to normalise with";
        } else if (!groups_where(comparison, is_variant_of_game).empty()) {
            reason = "env.mode or env.difficulty is set, and no human score is of that variant";
        } else if (!without.empty()) {
            reason = fmt::format("no run of {}", some_of(without));
        } else {
            comparison.games.push_back(&game);
            continue;
        }
        comparison.left_out_games.push_back({std::string(game.name), reason});
    }
}

Scores normalised_at(const std::vector<GameResult>& games, std::optional<double> step) {
    return mapped(games, [&](const GameResult& game) {
        return mapped(game.runs, [&](const Run* run) {
            return human_normalised(step ? score_at(*run, *step).value() : run->score(), *game.game);
        });
    });
}

void count_runs(GroupResult& result, const std::vector<GameResult>& games) {
    const auto [least, most] =
        std::ranges::minmax(mapped(games, [](const auto& game) { return game.runs.size(); }));
    result.least_runs = least;
    result.most_runs = most;
}

void aggregate_group(GroupResult& result, const std::vector<const Game*>& compared,
                     const ComparisonConfig& config) {
    if (compared.empty()) return count_runs(result, result.games);
    const auto games = mapped(compared, [&](const Game* game) { return *result.find(game->name); });
    count_runs(result, games);
    result.scores = normalised_at(games, std::nullopt);
    result.aggregates = aggregate(result.scores, config.bootstrap);
    std::vector<const Run*> runs;
    for (const auto& game : games) runs.insert(runs.end(), game.runs.begin(), game.runs.end());
    result.curve_steps = common_steps(runs);
    result.curve = mapped(result.curve_steps, [&](double step) {
        return aggregate(normalised_at(games, step), config.for_bands());
    });
}

/// From 0 to the best run, at least to 1 and at most to 8 human scores; close, since the profile is a
/// staircase and most runs may lie near 0.
std::vector<double> profile_thresholds(const std::vector<GroupResult>& results) {
    double best = 0;
    for (const auto& result : results)
        for (const auto& runs : result.scores)
            best = std::max(best, *std::max_element(runs.begin(), runs.end()));
    const double last = std::clamp(std::ceil(2 * best) / 2, 1.0, kLastThreshold);
    std::vector<double> thresholds;
    for (int i = 0; i <= last * kThresholdsPerHumanScore; ++i)
        thresholds.push_back(i / kThresholdsPerHumanScore);
    return thresholds;
}

void compare_groups(Comparison& comparison) {
    comparison.thresholds = profile_thresholds(comparison.results);
    for (auto& result : comparison.results)
        result.profile =
            performance_profile(result.scores, comparison.thresholds, comparison.config.for_bands());
    const bool any_own = !std::ranges::all_of(comparison.groups, &Group::is_recorded);
    for (std::size_t x = 0; x < comparison.results.size(); ++x) {
        for (std::size_t y = x + 1; y < comparison.results.size(); ++y) {
            if (any_own && comparison.groups[x].is_recorded() && comparison.groups[y].is_recorded()) continue;
            const auto &first = comparison.results[x], &second = comparison.results[y];
            const bool has_interval = first.has_interval() && second.has_interval();
            auto bootstrap = comparison.config.bootstrap;
            if (!has_interval) bootstrap.resamples = 1;  // nothing shows them
            comparison.improvements.push_back(
                {.x = x,
                 .y = y,
                 .probability = probability_of_improvement(first.scores, second.scores, bootstrap),
                 .has_interval = has_interval});
        }
    }
}

/// Where a baseline has the label of a group, that group is meant.
void give_names(std::vector<Group>& groups, std::vector<Baseline>& baselines,
                std::map<std::string, std::string> names) {
    const auto is_group = [&](const std::string& label) {
        return std::ranges::find(groups, label, &Group::label) != groups.end();
    };
    for (auto& baseline : baselines)
        if (!is_group(baseline.name))
            if (const auto name = names.extract(baseline.name)) baseline.name = name.mapped();
    rename_groups(groups, names);
    for (const auto& baseline : baselines) {
        if (std::ranges::count(baselines, baseline.name, &Baseline::name) > 1)
            throw std::invalid_argument(
                fmt::format("two baselines are called {}: name each once, or differently", baseline.name));
        if (!is_group(baseline.name)) continue;
        throw std::invalid_argument(fmt::format(
            "a group and a baseline are called {0}: give the group another name by --name '{0}=NAME'",
            baseline.name));
    }
}

void add_baseline(Comparison& comparison, const Baseline& baseline) {
    std::vector<std::string_view> missing;
    Scores scores;
    for (const auto* game : comparison.games) {
        const auto score = baseline.scores.find(game->name);
        if (score == baseline.scores.end()) {
            missing.push_back(game->name);
        } else {
            scores.push_back({human_normalised(score->second, *game)});
        }
    }
    if (!missing.empty()) {
        comparison.left_out_baselines.push_back(
            {baseline.name, "it has no score for " + joined(missing, ", ")});
        return;
    }
    const Bootstrap once{.resamples = 1};
    comparison.baselines.push_back({baseline, scores.empty() ? Aggregates{} : aggregate(scores, once)});
}

/// Its folder; of a recorded run its group, game and seed.
std::string name_of(const Run& run) {
    return run.recorded_as.empty()
               ? run.folder.string()
               : fmt::format("{}, {}, seed {}", run.recorded_as, run.game->name, run.seed);
}

/// Tables that were joined may hold a run twice, under two numbers.
void leave_out_copies(std::vector<Run>& runs, std::vector<LeftOut>& repeated) {
    std::set<
        std::tuple<std::string, std::string_view, std::uint64_t, std::vector<double>, std::vector<double>>>
        seen;
    std::erase_if(runs, [&](const Run& run) {
        if (!run.is_recorded()) return false;
        const bool is_new =
            seen.emplace(run.recorded_as, run.game->name, run.seed, run.steps, run.scores).second;
        if (!is_new)
            repeated.push_back({name_of(run), fmt::format("{} has its scores twice", run.folder.string())});
        return !is_new;
    });
}

/// Of recorded groups the games that no other group has, and whole groups that lack a game which all others
/// have: they are beside those, and must not take games from the comparison.
void leave_out_recorded(Comparison& comparison) {
    const auto name_of_game = [](const Run& run) { return run.game->name; };
    std::map<std::string_view, std::size_t> groups_with;
    std::size_t own = 0;
    for (const auto& group : comparison.groups) {
        if (group.is_recorded()) continue;
        ++own;
        const auto names = mapped(group.runs, name_of_game);
        for (const auto game : std::set(names.begin(), names.end())) ++groups_with[game];
    }
    if (own == 0) return;
    for (auto& group : comparison.groups)
        if (group.is_recorded())
            std::erase_if(group.runs, [&](const Run& run) { return !groups_with.contains(run.game->name); });
    std::erase_if(comparison.groups, [&](const Group& group) {
        if (group.runs.empty()) {
            comparison.left_out_baselines.push_back({group.label, "it has no run of these games"});
            return true;
        }
        if (!group.is_recorded()) return false;
        std::vector<std::string_view> missing;
        for (const auto& [game, groups] : groups_with)
            if (groups == own && std::ranges::find(group.runs, game, name_of_game) == group.runs.end())
                missing.push_back(game);
        if (!missing.empty())
            comparison.left_out_baselines.push_back(
                {group.label, "it has no run of " + joined(missing, ", ")});
        return !missing.empty();
    });
}

std::vector<Baseline> random_floors(const std::vector<Group>& groups) {
    std::map<std::string, Baseline> floors;
    const auto add = [&](const std::string& name, const Game& game, double score) {
        floors[name].name = name;
        floors[name].scores[std::string(game.name)] = score;
    };
    for (const auto& group : groups) {
        for (const auto& run : group.runs) {
            if (!run.env) continue;
            if (const auto play = joystick_random(*run.env)) {
                add(fmt::format("random joystick ({}{})", play->protocol,
                                play->joystick == Joystick::polar ? "" : ", cartesian"),
                    *run.game, play->mean);
            } else if (const auto score = random_floor(*run.env)) {
                add(std::string(kPublishedRandom), *run.game, *score);
            }
        }
    }
    return values_in(std::move(floors));
}

std::vector<std::string> sentences(const std::vector<LeftOut>& items) {
    return mapped(items, [](const LeftOut& item) { return fmt::format("{}: {}", item.what, item.why); });
}

/// "1000 (a; b), 2000 / 100000 (c)", in agent steps, where the runs are of different lengths; else empty.
std::string lengths_text(const std::vector<Group>& groups) {
    std::map<std::set<std::int64_t>, std::vector<std::string>> labels;
    std::set<std::int64_t> all;
    for (const auto& group : groups) {
        std::set<std::int64_t> lengths;
        double furthest = 0;
        for (const auto& run : group.runs) {
            if (run.total_steps > 0) lengths.insert(std::llround(run.total_steps));
            furthest = std::max(furthest, run.reached);
        }
        if (lengths.empty()) lengths.insert(std::llround(furthest));
        all.insert(lengths.begin(), lengths.end());
        labels[lengths].push_back(group.label);
    }
    if (all.size() < 2) return "";
    const auto part = [](const auto& entry) {
        return fmt::format("{} ({})", fmt::join(entry.first, " / "), fmt::join(entry.second, "; "));
    };
    return joined(mapped(labels, part), ", ");
}

/// Adds "The sentence: a; b." unless there is no label.
void add_labels(std::vector<Note>& notes, std::string_view sentence, const std::vector<std::string>& labels) {
    if (!labels.empty()) notes.push_back({fmt::format("{}: {}.", sentence, fmt::join(labels, "; "))});
}

/// Adds the sentence with what it is about, unless that is nothing.
void add_items(std::vector<Note>& notes, std::string sentence, std::vector<std::string> items) {
    if (!items.empty()) notes.push_back({std::move(sentence), std::move(items)});
}

void add_notes_on_settings(std::vector<Note>& notes, const Comparison& comparison) {
    if (auto lengths = lengths_text(comparison.groups); !lengths.empty())
        notes.push_back({fmt::format("Groups have runs of different lengths, in agent steps: {}.", lengths)});
    std::vector<std::string> of_many_protocols;
    for (const auto& group : comparison.groups) {
        const auto protocol = [](const Run& run) { return setting_of(run, "evaluation"); };
        if (std::ranges::count(group.runs, protocol(group.runs.front()), protocol) < std::ssize(group.runs))
            of_many_protocols.push_back(group.label);
    }
    add_labels(
        notes,
        "Groups have runs that were evaluated in different ways ('evaluation' in settings.csv; --group-by "
        "evaluation tells them apart)",
        of_many_protocols);
    add_labels(
        notes,
        "Games are cut off earlier than published ones (env.max_frames_per_episode), so that "
        "human-normalised scores are those of shorter games",
        groups_where(comparison, [](const Run& run) { return run.env && cuts_games_short(*run.env); }));
    add_labels(notes, fmt::format("Scores of runs that are the mean of fewer than {} games", kFewGames),
               groups_where(comparison, [](const Run& run) {
                   return !run.is_recorded() && run.games_in_score < kFewGames;
               }));
    const auto is_untrained = [](const Run& run) {
        return run.total_steps > 0 && std::ranges::any_of(kWaitsForUpdate, [&](const char* key) {
                   return ends_before_first_update(number_of(run, key), run.total_steps);
               });
    };
    add_labels(notes,
               "Runs end before the first update (agent.min_replay, agent.rollout_steps), so that nothing "
               "was learned",
               groups_where(comparison, is_untrained));
}

void add_notes_on_runs(std::vector<Note>& notes, const Comparison& comparison) {
    std::vector<std::string> unfinished, doubts;
    std::map<std::string, std::size_t> choices;  // how many runs have it
    for (const auto& group : comparison.groups) {
        for (const auto& run : group.runs) {
            if (!run.finished)
                unfinished.push_back(fmt::format(
                    "{} {}: {:.0f} of {:.0f} agent steps", name_of(run),
                    run.settings.contains("evaluation") ? "was evaluated too early" : "is unfinished",
                    run.reached, run.total_steps));
            doubts.insert(doubts.end(), run.doubts.begin(), run.doubts.end());
            if (!run.chosen_evaluation.empty()) ++choices[run.chosen_evaluation];
        }
    }
    const auto runs_are = [](std::size_t count) {
        return counted(count, "run") + (count == 1 ? " is" : " are");
    };
    add_items(notes, fmt::format("{} missing:", runs_are(comparison.missing_runs.size())),
              comparison.missing_runs);
    add_items(notes,
              fmt::format("{} left out, as what is in the folder cannot be used:",
                          runs_are(comparison.left_out_runs.size())),
              sentences(comparison.left_out_runs));
    add_items(notes, "Runs that count as far as they got:", std::move(unfinished));
    add_items(notes,
              "Runs that have several evaluations of their newest checkpoint, of which the one with the most "
              "games counts (to choose another, move the others' folders out of evaluations/):",
              mapped(choices, [](const auto& choice) {
                  return fmt::format("{} ({})", choice.first, counted(choice.second, "run"));
              }));
    add_items(notes,
              "Scores that may be of an earlier time than the others, or lack something:", std::move(doubts));
    if (comparison.config.group_by.empty())
        add_items(notes,
                  "Settings that only some runs of an agent have, which are groups of their own (runs of "
                  "another version lack them; --group-by names the settings that are to tell groups apart):",
                  partial_settings(comparison.groups));
    add_items(notes, "Runs that are there twice, of which the longer one counts:",
              sentences(comparison.repeated_runs));
}

/// The first `count` texts and, where there are others, how many.
std::vector<std::string> first_ones(std::vector<std::string> texts, std::size_t count) {
    if (texts.size() <= count) return texts;
    texts[count] = fmt::format("{} more", texts.size() - count);
    texts.resize(count + 1);
    return texts;
}

/// Groups that count several runs of a game and a seed, with the settings in which these differ.
std::vector<std::string> pooled_groups(const Comparison& comparison) {
    std::vector<std::string> pooled;
    for (const auto& group : comparison.groups) {
        if (group.is_recorded()) continue;
        std::map<std::pair<std::string_view, std::uint64_t>, std::vector<const Run*>> alike;
        for (const auto& run : group.runs) alike[{run.game->name, run.seed}].push_back(&run);
        std::set<std::string> keys;
        for (const auto& [identity, runs] : alike) {
            const auto differing = differing_keys(runs);
            keys.insert(differing.begin(), differing.end());
        }
        if (keys.empty()) continue;
        const auto named = first_ones({keys.begin(), keys.end()}, 5);
        pooled.push_back(fmt::format("{} ({})", group.label, fmt::join(named, ", ")));
    }
    return pooled;
}

std::vector<Note> notes_on(const Comparison& comparison) {
    std::vector<std::string> single, few, uneven;
    for (const auto& result : comparison.results) {
        const auto [least, most] = std::pair(result.least_runs, result.most_runs);
        const auto counts = least == most ? fmt::to_string(least) : fmt::format("{} to {}", least, most);
        const auto counted = fmt::format("{} ({})", result.label, counts);
        if (!result.has_interval()) {
            single.push_back(result.label);
        } else if (least < kFewRuns) {
            few.push_back(counted);
        }
        if (least != most) uneven.push_back(counted);
    }
    std::vector<Note> notes;
    add_notes_on_runs(notes, comparison);
    add_notes_on_settings(notes, comparison);
    if (comparison.games.empty())
        notes.push_back(
            {"There is no game with a human score that every group has played: nothing is aggregated over "
             "games. Fewer groups may have games in common."});
    add_items(notes, "Games that are not in the aggregates:", sentences(comparison.left_out_games));
    add_items(notes, "What is left out beside the runs:", sentences(comparison.left_out_baselines));
    add_labels(
        notes,
        "Groups with a single run in a game, which says nothing of its spread, so that there is no interval",
        single);
    add_labels(notes,
               fmt::format("Fewer than {} runs per game, from which bootstrap intervals come out too narrow",
                           kFewRuns),
               few);
    add_labels(
        notes,
        "Groups hold runs of the same game and seed that differ in settings, and count them as if they "
        "were of several seeds",
        pooled_groups(comparison));
    add_labels(notes,
               "Groups with unequal numbers of runs; where scores are pooled, games with more count more",
               uneven);
    return notes;
}

}  // namespace

void require_runs(const FoundRuns& found) {
    if (!found.runs.empty()) return;
    if (found.left_out.empty())
        throw std::runtime_error(
            "there is no run: a run is a folder with an episodes.csv beside a config.yaml or metadata.json");
    const auto count = found.left_out.size();
    throw std::runtime_error(fmt::format(
        "{}{}",
        count > 1 ? fmt::format("none of the {} runs can be used; ", count) : "the run cannot be used; ",
        fmt::join(first_ones(sentences(found.left_out), 3), "; ")));
}

bool Comparison::is_complete() const {
    const auto finished = [](const Group& group) {
        return group.is_recorded() || std::ranges::all_of(group.runs, &Run::finished);
    };
    return missing_runs.empty() && left_out_runs.empty() && std::ranges::all_of(groups, finished);
}

const GameResult* GroupResult::find(std::string_view game) const {
    const auto found = std::ranges::find(games, game, [](const GameResult& own) { return own.game->name; });
    return found == games.end() ? nullptr : &*found;
}

bool Comparison::has_interval_of_a_game() const {
    return std::ranges::any_of(results, [](const GroupResult& result) {
        return std::ranges::any_of(result.games, &GameResult::has_interval);
    });
}

std::vector<std::string> labels_of(const Comparison& comparison) {
    return mapped(comparison.results, &GroupResult::label);
}

Comparison compare(FoundRuns found, std::vector<Baseline> baselines, const ComparisonConfig& config) {
    require_runs(found);
    Comparison comparison;
    comparison.config = config;
    comparison.left_out_runs = std::move(found.left_out);
    comparison.repeated_runs = std::move(found.repeated);
    comparison.missing_runs = std::move(found.missing);
    leave_out_copies(found.runs, comparison.repeated_runs);
    comparison.groups = group_runs(std::move(found.runs), config.group_by);
    give_names(comparison.groups, baselines, config.names);
    std::ranges::move(missing_runs(comparison.groups), std::back_inserter(comparison.missing_runs));
    leave_out_recorded(comparison);
    for (const auto& group : comparison.groups) comparison.results.push_back(result_of(group, config));
    choose_games(comparison);
    for (auto& result : comparison.results) aggregate_group(result, comparison.games, config);
    if (!comparison.games.empty()) compare_groups(comparison);
    for (const auto& baseline : baselines) add_baseline(comparison, baseline);
    comparison.random_floors = random_floors(comparison.groups);
    comparison.notes = notes_on(comparison);
    return comparison;
}

}  // namespace cale
