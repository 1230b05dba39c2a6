#include "report/runs.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>
#include <string_view>

#include "cale/action.h"
#include "report/csv.h"
#include "report/learning_curve.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr double kLongestIteration = 250'000;  // agent steps

/// No result depends on these, or a report tells them apart anyway.
constexpr std::array<std::string_view, 14> kWithoutEffect{"env.game",
                                                          "env.rom_dir",
                                                          "env.env_threads",
                                                          "train.seed",
                                                          "train.checkpoint_every",
                                                          "train.keep_checkpoints",
                                                          "train.keep_every",
                                                          "train.keep_best",
                                                          "train.save_replay",
                                                          "eval.every",
                                                          "eval.episodes",
                                                          "eval.video",
                                                          "log.every",
                                                          "log.tensorboard"};

void flatten(const YAML::Node& node, const std::string& name, std::map<std::string, std::string>& settings) {
    if (node.IsMap()) {
        for (const auto& entry : node) {
            const auto key = entry.first.as<std::string>();
            flatten(entry.second, name.empty() ? key : fmt::format("{}.{}", name, key), settings);
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
        flatten(YAML::LoadFile(path.string()), "", settings);
    } catch (const YAML::Exception& error) {
        throw std::runtime_error(fmt::format("{} cannot be read: {}", path.string(), error.what()));
    }
    return settings;
}

/// What metadata.json and the first line of episodes.csv say; the former wins.
void read_identity(Run& run, const EpisodeHistory& episodes) {
    std::string env_id = episodes.env_id;
    run.agent = episodes.agent;
    run.seed = episodes.seed.value_or(0);
    const auto path = run.folder / "metadata.json";
    if (fs::exists(path)) {
        std::ifstream file(path);
        const auto metadata = nlohmann::json::parse(file, nullptr, false);
        if (!metadata.is_object())
            throw std::runtime_error(path.string() + " is damaged: it is no JSON object");
        try {
            env_id = metadata.value("env_id", env_id);
            run.agent = metadata.value("exp_name", run.agent);
            run.seed = metadata.value("seed", run.seed);
            run.made_with = fmt::format("cale {}, ALE {}, LibTorch {}", metadata.value("cale", "?"),
                                        metadata.value("ale", "?"), metadata.value("libtorch", "?"));
        } catch (const nlohmann::json::exception& error) {
            throw std::runtime_error(fmt::format("{} is damaged: {}", path.string(), error.what()));
        }
    }
    if (env_id.empty()) throw std::runtime_error("neither metadata.json nor episodes.csv names its game");
    if (run.agent.empty()) run.agent = "agent";
    run.game = &find_game(env_id);
}

/// 0 where it is not set. May be written as 50_000_000.
double number_of(const std::map<std::string, std::string>& settings, const char* key) {
    const auto found = settings.find(key);
    if (found == settings.end()) return 0;
    auto digits = found->second;
    std::erase(digits, '_');
    return std::strtod(digits.c_str(), nullptr);
}

void read_training(Run& run, const EpisodeHistory& episodes) {
    if (episodes.steps.empty()) throw std::runtime_error("no game of its training has ended");
    run.steps = episodes.steps;
    const double last = episodes.steps.back();
    const double all = std::max(last, number_of(run.settings, "train.total_steps"));
    const double iteration = std::min(all / 10, kLongestIteration);
    run.scores = mean_returns(episodes, iteration);
    run.games_in_score = std::ranges::count_if(
        episodes.steps, [&](double step) { return step == last || step > last - iteration; });
}

/// The files eval/step_*SUFFIX, oldest first.
std::vector<fs::path> evaluation_files(const fs::path& folder, std::string_view suffix) {
    std::vector<fs::path> files;
    if (!fs::is_directory(folder / "eval")) return files;
    for (const auto& entry : fs::directory_iterator(folder / "eval")) {
        const auto name = entry.path().filename().string();
        if (!name.starts_with("step_") || !name.ends_with(suffix)) continue;
        const auto digits = std::string_view(name).substr(5, name.size() - 5 - suffix.size());
        if (!digits.empty() && digits.find_first_not_of("0123456789") == digits.npos)
            files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
        const auto x = a.filename().string(), y = b.filename().string();
        return std::pair(x.size(), x) < std::pair(y.size(), y);  // also where the digits are not padded
    });
    return files;
}

void read_evaluations(Run& run) {
    const auto files = evaluation_files(run.folder, ".csv");
    if (files.empty()) throw std::runtime_error("it has no evaluation (eval/step_*.csv)");
    for (const auto& path : files) {
        const auto table = read_csv(path);
        const auto column = table.find("return");
        if (!column || table.rows.empty())
            throw std::runtime_error(path.string() + " is damaged: it has no column 'return' or no row");
        double sum = 0;
        for (std::size_t row = 0; row < table.rows.size(); ++row) sum += table.number(row, *column);
        run.steps.push_back(std::stod(path.stem().string().substr(5)));
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

std::vector<double> read_event_shares(const fs::path& path) {
    const auto table = read_csv(path);
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
    const auto table = read_csv(path);
    const auto [quantile, reward] = columns_of(table, "quantile", "reward");
    std::vector<RewardQuantile> quantiles;
    for (std::size_t row = 0; row < table.rows.size(); ++row)
        quantiles.push_back({table.number(row, quantile), table.number(row, reward)});
    return quantiles;
}

/// Whether progress.csv or the episodes come as near to the end as the log's rhythm allows.
bool reached_end(const fs::path& folder, double last_episode,
                 const std::map<std::string, std::string>& settings) {
    double reached = last_episode;
    if (fs::exists(folder / "progress.csv")) {
        const auto table = read_csv(folder / "progress.csv");
        const auto column = table.find("global_step");
        if (column && !table.rows.empty())
            reached = std::max(reached, table.number(table.rows.size() - 1, *column));
    }
    return reached + number_of(settings, "log.every") >= number_of(settings, "train.total_steps");
}

Run read_run(const fs::path& folder, ScoreKind kind) {
    Run run{.folder = folder};
    const auto episodes = read_episodes(folder / "episodes.csv");
    if (fs::exists(folder / "config.yaml")) run.settings = read_settings(folder / "config.yaml");
    read_identity(run, episodes);
    if (kind == ScoreKind::training) {
        read_training(run, episodes);
    } else {
        read_evaluations(run);
    }
    run.finished = reached_end(folder, episodes.steps.empty() ? 0 : episodes.steps.back(), run.settings);
    for (const auto name : kWithoutEffect) run.settings.erase(std::string(name));

    if (kind == ScoreKind::training) {
        if (const auto file = folder / "joystick_events.csv"; fs::exists(file))
            run.event_shares = read_event_shares(file);
    } else if (const auto files = evaluation_files(folder, "_events.csv"); !files.empty()) {
        run.event_shares = read_event_shares(files.back());
    }
    if (const auto files = evaluation_files(folder, "_rewards.csv"); !files.empty())
        run.reward_quantiles = read_reward_quantiles(files.back());
    return run;
}

bool looks_like_a_run(const fs::path& folder) {
    return fs::exists(folder / "episodes.csv") &&
           (fs::exists(folder / "config.yaml") || fs::exists(folder / "metadata.json"));
}

/// Runs do not lie inside runs.
void collect_folders(const fs::path& folder, std::set<fs::path>& folders) {
    if (looks_like_a_run(folder)) {
        folders.insert(folder);
        return;
    }
    for (const auto& entry : fs::directory_iterator(folder, fs::directory_options::skip_permission_denied))
        if (!entry.is_symlink() && entry.is_directory()) collect_folders(entry.path(), folders);
}

/// Of each kind the longest; the others are left out.
std::vector<Run> without_repetitions(std::vector<Run> runs, std::vector<LeftOut>& left_out) {
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
        left_out.push_back({run.folder.string(), fmt::format("the same agent, settings, game and seed as {}",
                                                             same->folder.string())});
    }
    return kept;
}

}  // namespace

FoundRuns find_runs(const std::vector<fs::path>& paths, ScoreKind kind) {
    std::set<fs::path> folders;
    for (const auto& path : paths) {
        if (!fs::is_directory(path))
            throw std::runtime_error(
                fmt::format("{} is no folder: name runs, or folders that hold runs", path.string()));
        collect_folders(fs::canonical(path), folders);
    }
    FoundRuns found;
    std::vector<Run> runs;
    for (const auto& folder : folders) {
        try {
            runs.push_back(read_run(folder, kind));
        } catch (const std::exception& error) {
            found.left_out.push_back({folder.string(), error.what()});
        }
    }
    found.runs = without_repetitions(std::move(runs), found.left_out);
    return found;
}

}  // namespace cale
