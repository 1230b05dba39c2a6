// The runs of a report: agent, game, settings, and scores over time.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "cale/env.h"
#include "cale/games.h"
#include "cale/zones.h"

namespace cale {

/// training: the mean return of the games that ended in the newest iteration of training, exploration and
/// all, which is what the paper reports; an iteration is a tenth of the run, 250,000 agent steps at most, as
/// in Dopamine's protocols. evaluation: the mean return of an evaluation: of those that `cale evaluate` made
/// of a folder of runs (evaluations/*/step_*.csv), else of the run's own (eval/step_*.csv). Which, and by
/// which protocol, is its setting `evaluation`, so that runs that were evaluated in different ways differ.
enum class ScoreKind { training, evaluation };

/// A quantile of the rewards of an evaluation's agent steps.
struct RewardQuantile {
    double quantile = 0;  // [0, 1]
    double reward = 0;
};

/// Where the joystick was in the agent steps up to this one, since the row before.
struct ZoneRow {
    double step = 0;
    std::array<double, kZones.size()> shares{};  // add up to 1
};

/// A run, as its files describe it.
struct Run {
    std::filesystem::path folder{};
    std::string agent{};        // "sac"
    std::string recorded_as{};  // its group, of a run in a table (recorded_runs.h); empty: it has a folder
    const Game* game = nullptr;
    std::uint64_t seed = 0;
    std::optional<EnvConfig> env{};  // its rules; none where its config.yaml does not name them
    std::string made_with{};         // "cale 0.1.0, ALE 0.12.1, LibTorch 2.11.0"
    // "agent.encoder" -> "phi_sac": all settings but those that no result depends on, such as how
    // often to log, and the game and the seed.
    std::map<std::string, std::string> settings{};
    // The score as it stood after each of these agent steps, ascending; the last is the run's.
    std::vector<double> steps{};
    std::vector<double> scores{};
    std::int64_t games_in_score = 0;  // behind the last score
    bool finished = false;       // whether it took all the steps that it was to take, where these are known
    double reached = 0;          // agent steps that it took, or that were evaluated, as its files say
    double total_steps = 0;      // that it was to take; 0: not known
    bool in_sweep_list = false;  // see FoundRuns::missing
    // Why the score may not be what it is called: sentences that name the file.
    std::vector<std::string> doubts{};
    // "A counts, not B": which of several evaluations of the same checkpoint the score is of, by their
    // folders; empty where there is one.
    std::string chosen_evaluation{};
    // By Event, adding up to 1: of all its training or of the newest evaluation that recorded them, as the
    // score is. Empty where none was recorded.
    std::vector<double> event_shares{};
    std::vector<RewardQuantile> reward_quantiles{};  // of the newest evaluation that recorded them
    std::vector<ZoneRow> zones{};                    // of its training; empty where none were recorded

    double score() const { return scores.back(); }
    bool is_recorded() const { return !recorded_as.empty(); }
};

/// A folder that is not used, and why.
struct LeftOut {
    std::string what{};
    std::string why{};
};

/// The file in which a sweep lists its runs, each a line with the name of a subfolder.
inline constexpr std::string_view kSweepList = "sweep_runs.txt";

/// Whether the runs of a group may differ in this setting.
constexpr bool is_game_or_seed(std::string_view key) {
    return key == "env.game" || key == "train.seed";
}

/// No result depends on these settings: the groups of a report do not differ by them, and they may differ on
/// resume (train/resume.h).
inline constexpr std::array<std::string_view, 13> kWithoutEffect{"agent.replay_on_device",
                                                                 "env.rom_dir",
                                                                 "env.env_threads",
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

/// Returns how many bytes of episodes.csv were there when the checkpoint was written; 0 where it does not
/// say.
std::uintmax_t episode_bytes_at(const std::filesystem::path& checkpoint);

/// What find_runs() found.
struct FoundRuns {
    std::vector<Run> runs{};             // by folder
    std::vector<LeftOut> left_out{};     // folders that look like runs and cannot be used
    std::vector<LeftOut> repeated{};     // runs of which a longer one is there
    std::vector<std::string> missing{};  // folders that a sweep lists (kSweepList) and that hold no run
};

/// Returns the value of a setting; empty where the run has none.
std::string setting_of(const Run& run, const std::string& key);
/// The same as a number, which may be written as 50_000_000; none where it is not set or no finite number.
std::optional<double> number_of(const Run& run, const std::string& key);

/// The settings that a first update waits for: an agent has one of them.
inline constexpr std::array<const char*, 2> kWaitsForUpdate{"agent.min_replay", "agent.rollout_steps"};
/// Returns whether a run of so many agent steps certainly makes no update. `waits_for`: its setting of
/// kWaitsForUpdate, none where it has none.
bool ends_before_first_update(std::optional<double> waits_for, double total_steps);

/// Returns what Run::score() was after that many agent steps; none before the run's first score.
std::optional<double> score_at(const Run& run, double step);

/// Returns the rules that settings such as "env.action_space" name; none where they do not, or cannot be
/// read.
std::optional<EnvConfig> env_of(const std::map<std::string, std::string>& settings);

/// The runs that are these folders or lie below them: folders with an episodes.csv beside a
/// config.yaml or metadata.json. Symbolic links are followed, and a run to which several ways lead counts
/// once. Folders are named as they were given, relative ones relative to the working directory. Of two runs
/// with the same agent, settings, game and seed, which are duplicates, the longer one is kept.
///
/// A run whose episodes.csv is certainly truncated is left out: the run's newest checkpoint had more bytes of
/// it, it ends in the middle of a line although the run finished, or the run continued for longer than any
/// game takes. If it may be truncated, Run::doubts says so. Throws std::runtime_error where a path is no
/// folder; an error in a run excludes only that run.
FoundRuns find_runs(const std::vector<std::filesystem::path>& paths, ScoreKind kind);

}  // namespace cale
