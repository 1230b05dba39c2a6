// Checkpoints: everything that a run needs to go on, in one folder
//
//     <run>/checkpoints/step_000250000/
//         agent.safetensors.zst   networks, optimisers, random generators, counters, a rollout under way;
//                                 see agent_file.h
//         policy.safetensors      the policy file (docs/policy_file.md), of agents and worlds that have one
//         games.safetensors       the games under way
//         replay.zst, frames-*.zst, transitions-*.zst   the replay (train.save_replay); see replay_snapshot.h
//         state.json              where the run stood
//         config.yaml             the settings that it was trained with
//         manifest.json           size and checksum of each of these
//     <run>/checkpoints/best      a symbolic link to the best one, with train.keep_best
//
// A folder appears under its name only when it is complete and on the disk.
#pragma once

#include <compare>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "agents/agent.h"
#include "evaluate/event_counts.h"
#include "replay/replay_snapshot.h"
#include "storage/manifest.h"
#include "train/policy_snapshot.h"

namespace cale {

/// How good a checkpoint's agent is, as train.keep_best compares them.
struct Score {
    bool evaluated = false;  // an evaluation's mean return; else that of the newest training episodes
    double mean_return = 0;
    auto operator<=>(const Score&) const = default;  // whatever was evaluated is better than what was not
};

/// Which checkpoints stay.
struct Retention {
    std::int64_t newest = 2;     // so many of the newest
    std::int64_t every = 0;      // for good: the first one at or after each multiple of this; 0: none
    std::int64_t step_size = 1;  // agent steps that are made at once, one per environment
    bool best = false;           // the one with the largest score, of equal ones the first
};

/// Where a run stands.
struct RunState {
    std::int64_t step = 0;   // agent steps, over all environments
    std::int64_t frame = 0;  // emulated frames, over all environments
    std::int64_t episodes = 0;
    EventCounts joystick_events{};            // asked for in training, over all environments
    double seconds = 0;                       // spent training, over all sittings
    std::vector<double> recent_returns{};     // of the last 100 episodes, oldest first
    std::int64_t episodes_offset = 0;         // bytes of episodes.csv that belong to the run so far
    std::int64_t progress_rows = 0;           // reports in progress.csv
    bool evaluation_due = false;              // one was cut off: it is played when the run goes on
    std::optional<Score> score{};             // at this step; none where none was due
    std::map<std::string, double> metrics{};  // of the agent's newest update
};

/// A run at one moment, in memory of its own but for the replay, which see.
struct RunSnapshot {
    RunState state;
    TensorMap agent;
    TensorMap games;  // Collector::state()
    std::optional<PolicySnapshot> policy{};
    std::optional<ReplaySnapshot> replay{};  // none: without train.save_replay, or no replay
    std::string config{};                    // all settings as YAML
};

/// A checkpoint that has been written, or found good.
struct StoredCheckpoint {
    std::filesystem::path folder;
    Manifest manifest;
};

/// A checkpoint that has been read.
struct Checkpoint {
    RunState state;
    StoredCheckpoint stored;
    std::vector<std::string> passed_over{};  // a sentence for each newer checkpoint that cannot be read
};

/// A run that cannot be resumed: no checkpoint, a damaged one, another configuration.
struct ResumeError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// The name of the policy file in the folder of a checkpoint.
inline constexpr const char* kPolicyFile = "policy.safetensors";

/// Writes a checkpoint. Full chunks of the replay are not written again: those that `before_last` has are
/// linked, others that `last` has are copied, each after its checksum was found good. So two checkpoints in a
/// row share no file, and one damaged file costs one checkpoint.
/// The run's joystick_events.csv is brought up to date, too.
/// Throws std::runtime_error, naming the file, where the disk refuses; all other checkpoints are untouched
/// then.
StoredCheckpoint write_checkpoint(const std::filesystem::path& run_dir, RunSnapshot snapshot,
                                  const StoredCheckpoint* last, const StoredCheckpoint* before_last);

/// Deletes the checkpoints up to `newest` that do not stay, those after it (a damaged one's run has come
/// to another end), and what killed runs left unfinished. What stays follows from what is on the disk. With
/// `retention.best` the link "best" is made to point to that one.
void delete_other_checkpoints(const std::filesystem::path& run_dir, const std::filesystem::path& newest,
                              const Retention& retention);

/// The complete checkpoints of a run, oldest first.
std::vector<std::filesystem::path> list_checkpoints(const std::filesystem::path& run_dir);

/// The same; throws ResumeError, which says what the folder is instead, where there are none.
std::vector<std::filesystem::path> require_checkpoints(const std::filesystem::path& run_dir);

/// Whether a run in this folder has come to its first checkpoint, which is written before its first step, or
/// has left anything else that a new run would destroy.
bool has_begun(const std::filesystem::path& run_dir);

/// Brings the agent, its replay (if `with_replay`) and the games to the newest checkpoint of the run that can
/// be read. Every file is compared with the manifest before any is used. `restore_games` takes what
/// Collector::state() gave, and throws where it cannot. Throws ResumeError where no checkpoint can be
/// read.
Checkpoint load_newest_checkpoint(const std::filesystem::path& run_dir, Agent& agent, bool with_replay,
                                  const std::function<void(const TensorMap&)>& restore_games);

}  // namespace cale
