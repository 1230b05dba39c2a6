#include "report/runs.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <stdexcept>
#include <system_error>

#include "cale/action.h"
#include "cale/setting.h"
#include "cale/text.h"
#include "report/csv.h"
#include "report/learning_curve.h"
#include "storage/files.h"
#include "storage/manifest.h"
#include "storage/step_name.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr double kLongestIteration = 250'000;  // agent steps
constexpr double kMostSteps = 1e15;

/// The protocol of evaluations that a run made itself.
constexpr std::string_view kOwnEvaluations = "the run's own";

/// `visited`: how many nodes have been.
void flatten(const YAML::Node& node, const std::string& name, std::map<std::string, std::string>& settings,
             int& visited, int depth = 0) {
    constexpr int kDeepest = 16;   // an alias may lead back to what holds it
    constexpr int kMost = 10'000;  // aliases of aliases may stand for more than any memory holds
    if (depth > kDeepest) throw YAML::Exception(node.Mark(), fmt::format("'{}' is nested too deeply", name));
    if (++visited > kMost)
        throw YAML::Exception(node.Mark(), fmt::format("there are more than {} settings", kMost));
    if (node.IsMap()) {
        for (const auto& entry : node) {
            const auto key = entry.first.as<std::string>();
            flatten(entry.second, name.empty() ? key : fmt::format("{}.{}", name, key), settings, visited,
                    depth + 1);
        }
    } else if (node.IsScalar()) {
        settings[name] = node.Scalar();
    } else if (node.IsSequence()) {
        settings[name] = YAML::Dump(node);
    }
}

std::map<std::string, std::string> read_settings(const fs::path& path) {
    std::map<std::string, std::string> settings;
    try {
        int visited = 0;
        flatten(YAML::Load(read_file(path)), "", settings, visited);
    } catch (const YAML::Exception& error) {
        throw std::runtime_error(fmt::format("{} cannot be read: line {}, column {}: {}", path.string(),
                                             error.mark.line + 1, error.mark.column + 1, error.msg));
    }
    return settings;
}

nlohmann::ordered_json read_object(const fs::path& path) {
    auto object = nlohmann::ordered_json::parse(read_file(path), nullptr, false);
    if (!object.is_object()) throw std::runtime_error(path.string() + " is damaged: it is no JSON object");
    return object;
}

/// A run whose settings were changed on the way (--accept-changes) is like none that had the last ones from
/// the start.
void read_accepted_changes(Run& run, const nlohmann::ordered_json& metadata) {
    std::string changes;
    for (const auto& change : metadata.value("accepted_changes", std::vector<std::string>())) {
        const auto time = change.find(": ");  // "2026-11-22T10:00:00Z: agent.learning_rate ..."
        changes += (changes.empty() ? "" : "; ") + (time == change.npos ? change : change.substr(time + 2));
    }
    if (changes.empty()) return;
    run.settings["accepted_changes"] = changes;
    run.doubts.push_back(fmt::format("{}: it was resumed with other settings, as --accept-changes let it: {}",
                                     run.folder.string(), changes));
}

/// What metadata.json and the first line of episodes.csv say; the former wins. The settings must be read.
void read_identity(Run& run, const EpisodeHistory& episodes) {
    std::string env_id = episodes.env_id;
    run.agent = episodes.agent;
    const auto set = number_in<std::uint64_t>(setting_of(run, "train.seed"));
    run.seed = episodes.seed.value_or(set.value_or(0));
    const auto path = run.folder / "metadata.json";
    if (fs::exists(path)) {
        const auto metadata = read_object(path);
        try {
            env_id = metadata.value("env_id", env_id);
            run.agent = metadata.value("exp_name", run.agent);
            if (const auto seed = metadata.find("seed"); seed != metadata.end()) {
                if (!seed->is_number_unsigned())
                    throw std::runtime_error(fmt::format("{} is damaged: its seed is {}, no whole number",
                                                         path.string(), seed->dump()));
                run.seed = seed->get<std::uint64_t>();
            }
            run.finished = metadata.value("finished", false);
            run.made_with = fmt::format("cale {}, ALE {}, LibTorch {}", metadata.value("cale", "?"),
                                        metadata.value("ale", "?"), metadata.value("libtorch", "?"));
            read_accepted_changes(run, metadata);
        } catch (const nlohmann::json::exception& error) {
            throw std::runtime_error(fmt::format("{} is damaged: {}", path.string(), error.what()));
        }
    }
    if (env_id.empty()) throw std::runtime_error("neither metadata.json nor episodes.csv names its game");
    if (run.agent.empty()) run.agent = "agent";
    if (env_id.find('+') != env_id.npos) {
        throw std::runtime_error(fmt::format(
            "it is a run of several games, {}, and games are compared one by one: its episodes.csv has them",
            env_id));
    }
    run.game = &find_game(env_id);
}

/// 0 where the run does not say.
double number_or_0(const Run& run, const std::string& key) {
    return number_of(run, key).value_or(0);
}

/// Calls read() for what a run can do without: damage to it is one of the run's doubts.
template <class Read>
void read_besides(Run& run, std::string_view what, const Read& read) {
    try {
        read();
    } catch (const std::exception& error) {
        run.doubts.push_back(
            fmt::format("{}: its {} are left out: {}", run.folder.string(), what, error.what()));
    }
}

/// Agent steps of the iteration whose games make the score.
double iteration_of(const Run& run, const EpisodeHistory& episodes) {
    const double all = std::max(episodes.steps.back(), run.total_steps);
    return std::min(all / 10, kLongestIteration);
}

void read_scores(Run& run, const EpisodeHistory& episodes) {
    const double iteration = iteration_of(run, episodes);
    auto curve = mean_returns(episodes, iteration, run.reached);
    run.steps = std::move(curve.steps);
    run.scores = std::move(curve.values);
    const auto is_newest = [&](double step) { return step > run.reached - iteration; };
    // The newest game, if none.
    run.games_in_score = std::max<std::int64_t>(std::ranges::count_if(episodes.steps, is_newest), 1);
}

/// How far a run came, and the file that says so.
struct Progress {
    double step = 0;  // agent steps
    fs::path file{};
    fs::path checkpoint{};  // the newest; empty: there is none
    CsvTable rows{};        // of progress.csv; none where there is no such file
};

/// What all files but episodes.csv say, the largest.
Progress progress_of(Run& run) {
    Progress progress;
    if (const auto checkpoints = named_by_step(run.folder / "checkpoints"); !checkpoints.empty())
        progress.checkpoint = checkpoints.back();
    const auto add = [&](double step, const fs::path& file) {
        if (step <= progress.step) return;
        progress.step = step;
        progress.file = file;
    };
    if (const auto file = run.folder / "progress.csv"; fs::exists(file) && !fs::is_empty(file)) {
        read_besides(run, "rows of progress", [&] {
            const auto& table = progress.rows = read_csv(file);
            const auto column = table.find("global_step");
            if (column && !table.rows.empty()) add(table.number(table.rows.size() - 1, *column), file);
        });
    }
    if (const auto step = step_in(progress.checkpoint)) add(static_cast<double>(*step), progress.checkpoint);
    return progress;
}

/// Agent steps of the longest game that the settings allow, over all environments; none where they do not
/// say. A step that loses a life may be of one frame.
std::optional<double> longest_game(const Run& run) {
    const double frames = number_or_0(run, "env.max_frames_per_episode");
    const bool cuts_steps = setting_of(run, "env.terminal_on_life_loss") == "true";
    const double skip = cuts_steps ? 1 : number_or_0(run, "env.frame_skip");
    if (!(frames > 0 && skip > 0)) return std::nullopt;
    return std::ceil(frames / skip) * std::max(1.0, number_or_0(run, "env.num_envs"));
}

/// Throws where episodes.csv is certainly not all that it was; says in run.doubts where it may not be.
void check_episodes(Run& run, const EpisodeHistory& episodes, const Progress& progress) {
    const auto path = run.folder / "episodes.csv";
    if (!std::ranges::is_sorted(episodes.steps) || episodes.steps.back() > kMostSteps)
        throw std::runtime_error(fmt::format(
            "{} is damaged: its agent steps do not ascend to what a run can take", path.string()));
    const auto& checkpoint = progress.checkpoint;
    const auto bytes = fs::file_size(path), had = episode_bytes_at(checkpoint);
    if (bytes < had)
        throw std::runtime_error(fmt::format("{} is cut: it has {} bytes, and had {} when {} was written",
                                             path.string(), bytes, had, checkpoint.string()));
    const bool came_to_its_end = run.total_steps > 0 && progress.step >= run.total_steps;
    const auto end = fmt::format("the run took {:.0f} agent steps ({})", progress.step,
                                 progress.file.lexically_relative(run.folder).string());
    if (episodes.cut_line && came_to_its_end)
        throw std::runtime_error(fmt::format("{} is cut: it ends in the middle of line {}, but {}",
                                             path.string(), *episodes.cut_line, end));
    if (episodes.cut_line)
        run.doubts.push_back(fmt::format(
            "{} ends in the middle of line {}, which is not counted: the run was killed, or the file is cut",
            path.string(), *episodes.cut_line));
    const double last = episodes.steps.back();
    const auto longest = longest_game(run);
    if (longest && last + *longest < progress.step)
        throw std::runtime_error(fmt::format(
            "{} is cut: its last game ended at agent step {:.0f}, no game takes more than {:.0f}, and {}",
            path.string(), last, *longest, end));
    const auto saved = step_in(checkpoint);
    const bool is_whole = had > 0 && saved && static_cast<double>(*saved) >= progress.step;
    if (!is_whole && last <= progress.step - iteration_of(run, episodes))
        run.doubts.push_back(
            fmt::format("{}: its last game ended at agent step {:.0f}, but {}: the score is not of the "
                        "newest iteration, or the file is cut",
                        path.string(), last, end));
}

/// How evaluations were made: what their protocol.json holds.
struct Protocol {
    std::string text{kOwnEvaluations};  // "protocol fixed_episodes, games 100, epsilon 0.001, ..."
    std::int64_t games = 0;             // that were asked for; 0: there was another limit
    std::map<std::string, std::string> settings{};  // of the environment, that were changed
};

struct Evaluations {
    fs::path folder{};
    Protocol protocol{};
    std::vector<std::string> others{};  // folders of those of the same checkpoint that do not count
    bool on_another_game = false;       // whether there are such, which do not count
};

nlohmann::ordered_json read_protocol_object(const fs::path& path) {
    try {
        return read_object(path);
    } catch (const std::exception& error) {
        throw std::runtime_error(
            fmt::format("{}; move its folder away, and cale evaluate plays its games again", error.what()));
    }
}

bool is_this_game(const Game& game, const nlohmann::ordered_json& name) {
    try {
        return &find_game(name.get<std::string>()) == &game;
    } catch (const std::exception&) {
        return false;  // several, or none that this version knows
    }
}

/// None where another game than this one was played.
std::optional<Protocol> read_protocol(const fs::path& path, const Game& game) {
    auto json = read_protocol_object(path);
    Protocol protocol{.text = {}};
    if (json.contains("settings") && json["settings"].contains("env.game")) {
        if (!is_this_game(game, json["settings"]["env.game"])) return std::nullopt;
        json["settings"].erase("env.game");  // said once more
    }
    for (const auto& [name, value] : json.items()) {
        if (value.is_null() || value.empty()) continue;
        protocol.text += fmt::format("{}{} {}", protocol.text.empty() ? "" : ", ", name,
                                     value.is_string() ? value.get<std::string>() : value.dump());
        if (name == "games" && value.is_number_unsigned()) protocol.games = value.get<std::int64_t>();
        if (name != "settings") continue;
        for (const auto& [key, changed] : value.items())
            if (changed.is_string()) protocol.settings[key] = changed.get<std::string>();
    }
    return protocol;
}

/// Those that `cale evaluate` made of a folder of runs: the ones of the newest checkpoint, of several the
/// ones that asked for the most games, of equals the first by name, which are the same of all runs. Else
/// those that the run made itself.
Evaluations evaluations_of(const Run& run) {
    Evaluations own{.folder = run.folder / "eval"};
    if (!fs::is_directory(run.folder / "evaluations")) return own;
    const fs::directory_iterator entries(run.folder / "evaluations");
    const std::set<fs::path> folders(begin(entries), end(entries));
    std::vector<Evaluations> newest;  // those of the newest checkpoint, by name
    std::optional<std::int64_t> newest_step;
    for (const auto& folder : folders) {
        const auto files = named_by_step(folder, ".csv");
        if (files.empty()) continue;
        const auto step = step_in(files.back(), ".csv");
        if (step < newest_step) continue;
        const auto protocol = read_protocol(folder / "protocol.json", *run.game);
        if (!protocol) {
            own.on_another_game = true;
            continue;
        }
        if (step > newest_step) newest.clear();
        newest_step = step;
        newest.push_back({.folder = folder, .protocol = *protocol});
    }
    if (newest.empty()) return own;
    const auto best = std::ranges::max_element(
        newest, {}, [](const Evaluations& evaluations) { return evaluations.protocol.games; });
    auto chosen = *best;
    for (const auto& other : newest)
        if (&other != &*best) chosen.others.push_back(other.folder.filename().string());
    return chosen;
}

/// Throws where the report that `cale evaluate` wrote beside the table of its games says that there were
/// more.
void require_all_games(const CsvTable& games) {
    auto file = games.path;
    file.replace_extension(".json");
    if (!fs::exists(file)) return;
    const auto report = read_object(file);
    const auto played = report.find("games");
    if (played == report.end() || !played->is_number_unsigned()) return;
    if (games.rows.size() < played->get<std::size_t>())
        throw std::runtime_error(
            fmt::format("{} is cut: it has {} games, and {} were played ({}); cale evaluate plays them again",
                        games.path.string(), games.rows.size(), played->dump(), file.filename().string()));
}

void read_evaluations(Run& run, const Evaluations& evaluations) {
    const auto files = named_by_step(evaluations.folder, ".csv");
    if (files.empty() && evaluations.on_another_game)
        throw std::runtime_error("it has no evaluation on its own game, only on another one");
    if (files.empty())
        throw std::runtime_error(
            "it has no evaluation: neither eval/step_*.csv nor one by cale evaluate and the folder of the "
            "runs, such as cale evaluate runs");
    run.settings["evaluation"] = evaluations.protocol.text;
    if (!evaluations.others.empty())
        run.chosen_evaluation = fmt::format("{} counts, not {}", evaluations.folder.filename().string(),
                                            fmt::join(evaluations.others, ", "));
    for (const auto& path : files) {
        const auto table = read_whole_csv(path);
        const auto column = table.find("return");
        if (!column || table.rows.empty())
            throw std::runtime_error(path.string() + " is damaged: it has no column 'return' or no row");
        require_all_games(table);
        double sum = 0;
        for (std::size_t row = 0; row < table.rows.size(); ++row) sum += table.score(row, *column);
        run.steps.push_back(static_cast<double>(*step_in(path, ".csv")));
        run.scores.push_back(sum / static_cast<double>(table.rows.size()));
        run.games_in_score = static_cast<std::int64_t>(table.rows.size());
    }
}

/// The two named columns of a table.
std::pair<std::size_t, std::size_t> columns_of(const CsvTable& table, std::string_view a,
                                               std::string_view b) {
    const auto first = table.find(a), second = table.find(b);
    if (!first || !second)
        throw std::runtime_error(
            fmt::format("{} is damaged: it has no columns '{}' and '{}'", table.path.string(), a, b));
    return {*first, *second};
}

std::vector<ZoneRow> zones_in(const CsvTable& table) {
    const auto step = table.find("global_step");
    std::array<std::size_t, kZones.size()> columns{};
    for (std::size_t zone = 0; zone < kZones.size(); ++zone) {
        const auto column = table.find(fmt::format("zones/{}", kZones[zone]));
        if (!column || !step) return {};
        columns[zone] = *column;
    }
    std::vector<ZoneRow> zones;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
        if (table.rows[row][columns[0]].empty()) continue;
        zones.push_back({.step = table.number(row, *step)});
        for (std::size_t zone = 0; zone < kZones.size(); ++zone)
            zones.back().shares[zone] = table.number(row, columns[zone]);
    }
    return zones;
}

std::vector<double> read_event_shares(const fs::path& path) {
    const auto table = read_whole_csv(path);
    const auto [name, count] = columns_of(table, "event", "count");
    std::vector<double> shares(kEventCount, 0.0);
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
        std::size_t event = 0;
        while (event < shares.size() && event_name(static_cast<Event>(event)) != table.rows[row][name])
            ++event;
        if (event == shares.size())
            throw std::runtime_error(fmt::format("{} is damaged: line {} names no joystick event",
                                                 path.string(), table.lines[row]));
        shares[event] += table.number(row, count);
    }
    const double total = std::accumulate(shares.begin(), shares.end(), 0.0);
    if (!(total > 0)) return {};
    for (auto& share : shares) share /= total;
    return shares;
}

std::vector<RewardQuantile> read_reward_quantiles(const fs::path& path) {
    const auto table = read_whole_csv(path);
    const auto [quantile, reward] = columns_of(table, "quantile", "reward");
    std::vector<RewardQuantile> quantiles;
    for (std::size_t row = 0; row < table.rows.size(); ++row)
        quantiles.push_back({table.number(row, quantile), table.score(row, reward)});
    return quantiles;
}

/// Those of the newest evaluation in the folder, if it has any.
void read_rewards(Run& run, const fs::path& evaluated) {
    if (const auto files = named_by_step(evaluated, "_rewards.csv"); !files.empty())
        run.reward_quantiles = read_reward_quantiles(files.back());
}

void set_rules(Run& run, const std::map<std::string, std::string>& settings) {
    run.env = env_of(settings);
    if (run.env) run.env->game = run.game->name;
}

/// Sets what is known of the training: its score, events and rewards.
void read_training_run(Run& run, const EpisodeHistory& episodes, const Progress& progress) {
    if (episodes.steps.empty())
        throw std::runtime_error(episodes.cut_line
                                     ? (run.folder / "episodes.csv").string() + " is cut: it has no whole row"
                                     : "no game of its training has ended");
    check_episodes(run, episodes, progress);
    read_scores(run, episodes);
    run.settings.erase("eval.noop_max");
    if (const auto file = run.folder / "joystick_events.csv"; fs::exists(file))
        read_besides(run, "joystick events", [&] { run.event_shares = read_event_shares(file); });
    read_besides(run, "rewards", [&] { read_rewards(run, evaluations_of(run).folder); });
}

/// Says in run.doubts where the newest evaluation, which `cale evaluate` made, is of another policy than the
/// checkpoint of its step holds: the run was made again.
void check_evaluated_policy(Run& run, const fs::path& folder) {
    const auto report = named_by_step(folder, ".json");
    if (report.empty()) return;
    const auto checkpoint = run.folder / "checkpoints" / report.back().stem();
    if (!fs::exists(checkpoint / "manifest.json")) return;
    const auto played = read_object(report.back()).value("policy_crc32c", "");
    const auto policy = policy_checksum(checkpoint);
    if (played.empty() || !policy || played == *policy) return;
    run.doubts.push_back(fmt::format("{} is of another policy than {}: cale evaluate plays it again",
                                     report.back().string(), checkpoint.string()));
}

/// Sets what is known of the evaluations: their score, events and rewards.
void read_evaluated_run(Run& run) {
    const auto evaluations = evaluations_of(run);
    read_evaluations(run, evaluations);
    read_besides(run, "policy's checksum", [&] { check_evaluated_policy(run, evaluations.folder); });
    if (evaluations.protocol.text != kOwnEvaluations) run.settings.erase("eval.noop_max");
    // The rules are those that were played by.
    auto settings = evaluations.protocol.settings;
    settings.insert(run.settings.begin(), run.settings.end());
    set_rules(run, settings);
    run.reached = run.steps.back();
    run.finished = run.finished && run.reached >= run.total_steps;
    if (const auto files = named_by_step(evaluations.folder, "_events.csv"); !files.empty())
        run.event_shares = read_event_shares(files.back());
    read_rewards(run, evaluations.folder);
}

Run read_run(const fs::path& folder, ScoreKind kind) {
    Run run{.folder = folder};
    const auto episodes = read_episodes(folder / "episodes.csv");
    if (fs::exists(folder / "config.yaml")) run.settings = read_settings(folder / "config.yaml");
    read_identity(run, episodes);
    set_rules(run, run.settings);
    run.total_steps = number_or_0(run, "train.total_steps");
    auto progress = progress_of(run);
    if (const auto copy = progress.checkpoint / "config.yaml"; run.settings.empty() && fs::exists(copy))
        throw std::runtime_error(fmt::format("{} is missing or empty; copy {} there",
                                             (folder / "config.yaml").string(), copy.string()));
    if (run.finished && progress.step < run.total_steps) {
        progress.step = run.total_steps;
        progress.file = folder / "metadata.json";
    }
    run.reached = std::max(progress.step, episodes.steps.empty() ? 0 : episodes.steps.back());
    // Of a folder without metadata.json and checkpoints only the log says how far it came.
    const bool logged_only = progress.checkpoint.empty() && !fs::exists(folder / "metadata.json");
    const double log_every = logged_only ? number_or_0(run, "log.every") : 0;
    run.finished = run.reached + log_every >= run.total_steps;
    kind == ScoreKind::training ? read_training_run(run, episodes, progress) : read_evaluated_run(run);
    for (const auto name : kWithoutEffect) run.settings.erase(std::string(name));
    std::erase_if(run.settings,
                  [](const auto& setting) { return is_game_or_seed(setting.first); });  // Run has them
    read_besides(run, "zones", [&] { run.zones = zones_in(progress.rows); });
    return run;
}

bool looks_like_a_run(const fs::path& folder) {
    const bool settings = fs::exists(folder / "config.yaml"), metadata = fs::exists(folder / "metadata.json");
    return fs::exists(folder / "episodes.csv") ? settings || metadata : settings && metadata;
}

/// The runs below some folders.
struct Search {
    std::map<fs::path, fs::path> runs{};  // the real folder -> as the user would name it
    std::vector<fs::path> sweeps{};       // folders with a list of their runs
    std::vector<LeftOut> left_out{};
    std::set<fs::path> seen{};  // real folders: links may lead in circles
};

/// Runs do not lie inside runs.
void search(const fs::path& folder, Search& result) {
    const auto real = fs::canonical(folder);
    if (!result.seen.insert(real).second) return;
    if (looks_like_a_run(folder)) {
        result.runs.emplace(real, folder);
        return;
    }
    if (fs::exists(folder / kSweepList)) result.sweeps.push_back(folder);
    const fs::directory_iterator entries(folder);
    for (const auto& entry : std::set<fs::path>(begin(entries), end(entries))) {
        const auto path = entry.lexically_normal();
        try {
            if (fs::is_directory(path)) {
                search(path, result);
            } else if (fs::is_symlink(path) && !fs::exists(path)) {
                result.left_out.push_back({path.string(), "it is a symbolic link to nothing"});
            }
        } catch (const fs::filesystem_error& error) {
            result.left_out.push_back({path.string(), "it cannot be read: " + error.code().message()});
        }
    }
}

/// The folders that the sweep in `folder` lists.
std::vector<fs::path> listed_runs(const fs::path& folder) {
    std::vector<fs::path> runs;
    std::ifstream file(folder / kSweepList);
    for (std::string name; std::getline(file, name);)
        if (!name.empty()) runs.push_back((folder / name).lexically_normal());
    return runs;
}

/// Of each kind the longest.
std::vector<Run> without_repetitions(std::vector<Run> runs, std::vector<LeftOut>& repeated) {
    std::vector<Run> kept;
    for (auto& run : runs) {
        const auto same = std::find_if(kept.begin(), kept.end(), [&](const Run& other) {
            return other.agent == run.agent && other.game == run.game && other.seed == run.seed &&
                   other.settings == run.settings;
        });
        if (same == kept.end()) {
            kept.push_back(std::move(run));
            continue;
        }
        if (run.steps.back() > same->steps.back()) std::swap(run, *same);
        repeated.push_back({run.folder.string(), fmt::format("the same agent, settings, game and seed as {}",
                                                             same->folder.string())});
    }
    return kept;
}

}  // namespace

std::uintmax_t episode_bytes_at(const fs::path& checkpoint) {
    const auto file = checkpoint / "state.json";
    if (checkpoint.empty() || !fs::exists(file)) return 0;
    const auto state = nlohmann::json::parse(read_file(file), nullptr, false);
    if (!state.is_object() || !state.contains("episodes_offset")) return 0;
    const auto& bytes = state["episodes_offset"];
    return bytes.is_number_unsigned() ? bytes.get<std::uintmax_t>() : 0;
}

std::string setting_of(const Run& run, const std::string& key) {
    const auto found = run.settings.find(key);
    return found == run.settings.end() ? std::string() : found->second;
}

std::optional<double> number_of(const Run& run, const std::string& key) {
    auto digits = setting_of(run, key);
    std::erase(digits, '_');
    const auto number = number_in<double>(digits);
    return number && std::isfinite(*number) ? number : std::nullopt;
}

bool ends_before_first_update(std::optional<double> waits_for, double total_steps) {
    return waits_for && total_steps <= *waits_for;
}

std::optional<double> score_at(const Run& run, double step) {
    const auto next = std::ranges::upper_bound(run.steps, step);
    if (next == run.steps.begin()) return std::nullopt;
    return run.scores[static_cast<std::size_t>(next - run.steps.begin()) - 1];
}

std::optional<EnvConfig> env_of(const std::map<std::string, std::string>& settings) {
    if (!settings.contains("env.action_space")) return std::nullopt;
    EnvConfig env;
    try {
        for (const auto& field : setting_fields(env)) {
            const auto found = settings.find("env." + field.name);
            if (found != settings.end()) read_setting(found->first, field.range, found->second, field.member);
        }
    } catch (const std::invalid_argument&) {
        return std::nullopt;
    }
    return env;
}

FoundRuns find_runs(const std::vector<fs::path>& paths, ScoreKind kind) {
    Search result;
    for (const auto& path : paths) {
        if (!fs::is_directory(path))
            throw std::runtime_error(
                fmt::format("{} is no folder: name runs, or folders that hold runs", path.string()));
        search(without_slash(path), result);
    }
    FoundRuns found{.left_out = std::move(result.left_out)};
    std::map<fs::path, bool> folders;  // as they are named -> whether a sweep lists them
    for (const auto& [real, folder] : result.runs) folders[folder] = false;
    for (const auto& sweep : result.sweeps) {
        for (const auto& folder : listed_runs(sweep)) {
            std::error_code error;
            const auto run = result.runs.find(fs::canonical(folder, error));
            if (!error && run != result.runs.end()) {
                folders[run->second] = true;
            } else {
                found.missing.push_back(folder.string());
            }
        }
    }
    std::vector<Run> runs;
    for (const auto& [folder, in_sweep_list] : folders) {
        try {
            runs.push_back(read_run(folder, kind));
            runs.back().in_sweep_list = in_sweep_list;
        } catch (const std::exception& error) {
            found.left_out.push_back({folder.string(), error.what()});
        }
    }
    found.runs = without_repetitions(std::move(runs), found.repeated);
    return found;
}

}  // namespace cale
