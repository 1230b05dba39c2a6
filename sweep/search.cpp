#include "sweep/search.h"

#include <algorithm>
#include <set>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "report/csv.h"
#include "report/learning_curve.h"
#include "report/runs.h"
#include "settings/config.h"
#include "settings/setting_texts.h"
#include "storage/files.h"
#include "sweep/config_mismatch.h"
#include "sweep/run_folder.h"
#include "sweep/settings.h"
#include "terminal/exit_code.h"
#include "train/resume.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr std::int64_t kFirstShare = 8;   // of the run, before the first halving
constexpr std::int64_t kWindowShare = 4;  // of the steps so far, behind a score

const std::vector<Setting>& settings_of(const Search& search, std::int64_t sample) {
    return search.sweep.samples[static_cast<std::size_t>(sample) - 1];
}

std::int64_t length_of(const Search& search) {
    return search.runs.front().end.total_steps;
}

bool is_set(const PlannedRun& planned, std::string_view key, std::string_view value) {
    const auto* const text = planned_value(planned, key);
    return text != nullptr && same_value(*text, std::string(value));
}

/// Returns the runs as they are trained up to agent step `steps`, where they pause.
std::vector<PlannedRun> paused_at(std::span<const PlannedRun> runs, std::int64_t steps) {
    std::vector<PlannedRun> paused(runs.begin(), runs.end());
    for (auto& planned : paused) {
        if (steps >= planned.end.total_steps) continue;
        planned.end = {.total_steps = steps, .evaluates = false};
        planned.until = steps;
    }
    return paused;
}

std::vector<SampleScore> compared(const Search& search, std::span<const PlannedRun> runs,
                                  std::int64_t steps) {
    std::map<std::int64_t, SampleScore> samples;
    for (const auto& planned : runs) {
        const auto& run = planned.run;
        auto& sample = samples[run.sample];
        sample.sample = run.sample;
        sample.steps = steps;
        const auto folder = search.folder / run.name;
        const bool arrived = newest_checkpoint_step(folder).value_or(0) >= steps;  // it may have failed
        sample.scores[run.combination] = arrived ? search_score(folder, steps) : std::nullopt;
        if (!arrived) sample.failed.insert(run.combination);
    }
    std::vector<SampleScore> result;
    result.reserve(samples.size());
    for (auto& [number, sample] : samples) result.push_back(std::move(sample));
    rank(result);
    return result;
}

/// A rung whose samples have been compared.
struct Rung {
    std::vector<SampleScore> samples{};  // the best first
    std::size_t continuing = 0;          // how many of them continue
};

Rung compare_rung(const Search& search, std::span<const PlannedRun> runs, std::int64_t steps) {
    Rung rung{.samples = compared(search, runs, steps)};
    if (steps < length_of(search)) rung.continuing = (rung.samples.size() + 1) / 2;
    return rung;
}

/// Leaves the runs of those samples that continue.
void keep_better(std::vector<PlannedRun>& runs, const Rung& rung) {
    std::set<std::int64_t> kept;
    for (const auto& sample : std::span(rung.samples).first(rung.continuing)) kept.insert(sample.sample);
    std::erase_if(runs, [&](const PlannedRun& planned) { return !kept.contains(planned.run.sample); });
}

// ---- what is left -------------------------------------------------------------------

void print(const Search& search, const Rung& rung, std::FILE* out) {
    const auto& [samples, continuing] = rung;
    const auto steps = samples.front().steps;
    if (continuing > 0) {
        fmt::print(out, "Agent step {}: the better {} of {} samples continue.\n", steps, continuing,
                   samples.size());
    } else {
        fmt::print(out, "Agent step {}, the end:\n", steps);
    }
    fmt::print(out, "{:>7}  {:>6}", "rank", "sample");
    for (const auto& setting : search.sweep.samples.front()) fmt::print(out, "  {}", setting.key);
    fmt::print(out, "\n");
    for (const auto& sample : samples) {
        fmt::print(out, "{:>7.2f}  {:>6}", sample.rank, sample.sample);
        for (const auto& [key, value] : settings_of(search, sample.sample))
            fmt::print(out, "  {:>{}}", value, key.size());
        fmt::print(out, "{}\n", sample.failed.empty() ? "" : "  failed");
    }
    if (continuing > 0 && continuing < samples.size() &&
        samples[continuing - 1].rank == samples[continuing].rank)
        fmt::print(out,
                   "Their ranks do not tell samples {} and {} apart, so the one of the smaller number "
                   "continues; with a larger first_steps in 'search:' more games end before.\n",
                   samples[continuing - 1].sample, samples[continuing].sample);
    if (continuing == 0 && samples.size() > 1 && samples[0].rank == samples[1].rank)
        fmt::print(
            out,
            "Their ranks do not tell samples {} and {} apart, so search_best.yaml is of the one of the "
            "smaller number; with more games or seeds they may.\n",
            samples[0].sample, samples[1].sample);
}

/// The newest comparison of each sample, the longest first.
void write_table(const Search& search, std::span<const SampleScore> samples) {
    std::vector<std::string> columns = {"sample", "steps", "rank"};
    for (const auto& setting : search.sweep.samples.front()) columns.push_back(setting.key);
    for (const auto& [combination, score] : samples.front().scores) columns.push_back(combination);
    auto text = csv_line(columns);
    for (const auto& [sample, steps, rank, scores, failed] : samples) {
        std::vector<std::string> cells = {fmt::to_string(sample), fmt::to_string(steps),
                                          fmt::format("{:.3f}", rank)};
        for (const auto& setting : settings_of(search, sample)) cells.push_back(setting.value);
        for (const auto& [combination, score] : scores)
            cells.push_back(score ? fmt::format("{:.2f}", *score) : std::string());
        text += csv_line(cells);
    }
    write_file_atomically(search.folder / "search.csv", text);
}

/// What all runs of the search have in common but for game and seed, and then the sample's settings.
std::map<std::string, std::string> settings_for_config(const Search& search, std::int64_t sample) {
    std::map<std::string, std::string> settings;
    for (const auto& [key, value] : search.runs.front().run.settings) settings[key] = value;
    for (const auto& planned : search.runs) {
        std::erase_if(settings, [&](const auto& setting) {
            return std::ranges::find(planned.run.settings, Setting{setting.first, setting.second}) ==
                   planned.run.settings.end();
        });
    }
    std::erase_if(settings, [](const auto& setting) { return is_game_or_seed(setting.first); });
    for (const auto& [key, value] : settings_of(search, sample)) settings[key] = value;
    return settings;
}

/// Says which of these runs, which have just been trained, was none of the planned ones; whether one was.
bool other_than_planned(const Search& search, std::span<const PlannedRun> runs, std::FILE* out) {
    std::string refused;
    for (const auto& planned : runs) {
        const auto folder = search.folder / planned.run.name;
        refused += refused_line(planned, newest_checkpoint_step(folder)
                                             ? config_mismatch(planned, folder)
                                             : started_otherwise(planned, folder).value_or(""));
    }
    fmt::print(out, "{}", refused);
    return !refused.empty();
}

bool has_score(const SampleScore& sample) {
    return std::ranges::any_of(sample.scores, [](const auto& entry) { return entry.second.has_value(); });
}

/// As YAML for --config, on top of the file that all runs have, if it is one.
void write_best(const Search& search, const SampleScore& best, std::size_t compared) {
    std::set<fs::path> configs;
    for (const auto& planned : search.runs) configs.insert(planned.run.config);
    YAML::Node config;
    if (configs.size() == 1 && !configs.begin()->empty()) config["extends"] = configs.begin()->string();
    for (const auto& [key, value] : settings_for_config(search, best.sample)) {
        const auto dot = key.find('.');
        config[key.substr(0, dot)][key.substr(dot + 1)] = value;
    }
    write_file_atomically(
        search.folder / "search_best.yaml",
        fmt::format("# Sample {} of {} of {}, at agent step {}: mean rank {:.2f} among {}.\n{}\n",
                    best.sample, search.sweep.samples.size(), search.sweep.name, best.steps, best.rank,
                    compared, YAML::Dump(config)));
}

/// Whether a run that is to be resumed has checkpoints without its replay. train.save_replay may differ from
/// the planned one, as it changes no result of a run that does not stop.
bool continues_without_replay(const PlannedRun& planned, const fs::path& folder) {
    if (newest_checkpoint_step(folder).value_or(0) == 0 || is_finished(folder, planned.end)) return false;
    const auto settings = settings_in(read_file(folder / "config.yaml"));
    const auto found = settings.find("train.save_replay");
    return found != settings.end() && same_value(found->second, "false");
}

}  // namespace

std::vector<std::int64_t> rungs(SearchMethod method, const SearchSpace& space, std::int64_t total_steps) {
    std::vector<std::int64_t> steps;
    if (method == SearchMethod::halving) {
        auto next = std::max<std::int64_t>(1, space.first_steps.value_or(total_steps / kFirstShare));
        for (; next < total_steps; next *= 2) steps.push_back(next);
    }
    steps.push_back(total_steps);
    return steps;
}

std::optional<double> search_score(const fs::path& folder, std::int64_t steps) {
    const auto file = folder / "episodes.csv";
    if (!fs::exists(file)) return std::nullopt;
    const auto window = steps / kWindowShare;
    const auto curve =
        mean_returns(read_episodes(file), static_cast<double>(window), static_cast<double>(steps));
    return curve.values.empty() ? std::nullopt : std::optional(curve.values.back());
}

void rank(std::vector<SampleScore>& samples) {
    // No score is less than any, and a failure less than none.
    const auto result = [](const SampleScore& sample, const std::string& combination) {
        return std::pair(!sample.failed.contains(combination), sample.scores.at(combination));
    };
    for (auto& sample : samples) {
        double places = 0;  // a sum of halves, which is exact
        for (const auto& [combination, score] : sample.scores) {
            places += 0.5;
            // Half a place for each of those with an equal result, of which the sample itself is one.
            const auto own = result(sample, combination);
            for (const auto& other : samples) {
                const auto theirs = result(other, combination);
                places += theirs > own ? 1 : theirs < own ? 0 : 0.5;
            }
        }
        sample.rank = places / static_cast<double>(sample.scores.size());
    }
    std::ranges::stable_sort(samples, {},
                             [](const auto& sample) { return std::pair(sample.rank, sample.sample); });
}

void check_search(const Search& search) {
    const auto first = search.sweep.search->first_steps;
    if (search.method == SearchMethod::halving && first && *first >= length_of(search))
        throw ConfigError(
            fmt::format("{}: first_steps of 'search:' is {}, and train.total_steps {}, so that nothing would "
                        "be halved: make first_steps less, or say --search random",
                        search.sweep.name, *first, length_of(search)));
    for (const auto& planned : search.runs) {
        if (planned.end.total_steps != length_of(search))
            throw ConfigError(
                fmt::format("{}: a search compares runs of the same length, and train.total_steps is {} and "
                            "{}: set it below 'set:'",
                            search.sweep.name, length_of(search), planned.end.total_steps));
        if (search.method != SearchMethod::halving) continue;
        for (const auto& [key, value] :
             {std::pair("train.save_replay", "false"), {"train.realtime", "true"}}) {
            if (is_set(planned, key, value))
                throw ConfigError(
                    fmt::format("{}: with {}={} a run that pauses does not continue as if it had not: change "
                                "that, or say --search random",
                                search.sweep.name, key, value));
        }
    }
}

bool refuse_others(const Search& search, std::FILE* out) {
    auto refused = refused_lines(search.runs, search.folder);
    if (search.method == SearchMethod::halving && refused.empty()) {
        for (const auto& planned : search.runs)
            if (continues_without_replay(planned, search.folder / planned.run.name))
                refused += refused_line(
                    planned,
                    "it stopped with train.save_replay=false, so that it would not continue as if it had "
                    "not stopped; move its folder away, give the sweep another --dir, or say --search "
                    "random");
    }
    fmt::print(out, "{}", refused);
    return !refused.empty();
}

std::vector<PlannedRun> next_runs(const Search& search) {
    std::vector<PlannedRun> left(search.runs.begin(), search.runs.end());
    for (const auto steps : rungs(search.method, *search.sweep.search, length_of(search))) {
        auto runs = paused_at(left, steps);
        if (!std::ranges::all_of(runs, [&](const PlannedRun& planned) {
                return is_finished(search.folder / planned.run.name, planned.end);
            }))
            return runs;
        keep_better(left, compare_rung(search, runs, steps));
    }
    return {};
}

int run_search(const Search& search, std::FILE* out) {
    check_search(search);
    if (refuse_others(search, out)) return kFailed;
    fs::remove(search.folder / "search_best.yaml");  // of an earlier search, perhaps of fewer samples
    std::vector<PlannedRun> left(search.runs.begin(), search.runs.end());
    std::vector<SampleScore> dropped;
    int exit_code = kDone;
    for (const auto steps : rungs(search.method, *search.sweep.search, length_of(search))) {
        const auto runs = paused_at(left, steps);
        const int code = search.train(runs);
        if (code == kInterrupted) return code;
        if (code != kDone && other_than_planned(search, runs, out)) return code;
        exit_code = std::max(exit_code, code);

        auto rung = compare_rung(search, runs, steps);
        print(search, rung, out);
        std::fflush(out);  // the next takes hours
        keep_better(left, rung);
        const auto compared_last = rung.samples.size();
        rung.samples.insert(rung.samples.end(), dropped.begin(), dropped.end());
        write_table(search, rung.samples);
        if (left.empty() && has_score(rung.samples.front()))
            write_best(search, rung.samples.front(), compared_last);
        dropped.assign(rung.samples.begin() + static_cast<std::ptrdiff_t>(rung.continuing),
                       rung.samples.end());
    }
    return exit_code;
}

}  // namespace cale
