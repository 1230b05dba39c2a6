// Checkpoints: everything that is needed to resume a run, in one folder
//
//     <run>/checkpoints/step_000250000/
//         agent.safetensors.zst   networks, optimisers, random generators, counters, a rollout under way;
//                                 see agent_file.h
//         policy.safetensors      the policy file (docs/policy_file.md), of agents and worlds that have one
//         games.safetensors       the games under way
//         replay.zst, frames-*.zst, transitions-*.zst   the replay (train.save_replay); see replay_snapshot.h
//         state.json              the run's progress
//         config.yaml             the settings that it was trained with
//         manifest.json           size and checksum of each of these
//     <run>/checkpoints/best      a symbolic link to the best one, with train.keep_best
//     <run>/checkpoints/step_000250000.damaged   one that a resume has passed over, until the next is written
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

/// The score of a checkpoint, by which train.keep_best compares them.
struct Score {
    bool evaluated = false;  // an evaluation's mean return; else that of the newest training episodes
    double mean_return = 0;
    // An evaluated score ranks above any other.
    // NOLINTNEXTLINE(modernize-use-nullptr): which takes the comparison with 0 in it for a pointer's.
    auto operator<=>(const Score&) const = default;
};

/// Which checkpoints are kept.
struct Retention {
    std::int64_t newest = 2;     // how many of the newest
    std::int64_t every = 0;      // for good: the first one at or after each multiple of this; 0: none
    std::int64_t step_size = 1;  // agent steps that are made at once, one per environment
    bool best = false;           // the one with the largest score, of equal ones the first
};

/// The progress of a run.
struct RunState {
    std::int64_t step = 0;   // agent steps, over all environments
    std::int64_t frame = 0;  // emulated frames, over all environments
    std::int64_t episodes = 0;
    EventCounts joystick_events{};            // in training, over all environments
    EventCounts reported_events{};            // of those, up to the newest row of progress.csv
    double seconds = 0;                       // spent training, over all sessions
    std::vector<double> recent_returns{};     // of the last 100 episodes, oldest first
    std::int64_t episodes_offset = 0;         // bytes of episodes.csv that belong to the run so far
    std::int64_t progress_rows = 0;           // of progress.csv that belong to the run so far
    bool evaluation_due = false;              // one was interrupted: it is played on resume
    std::optional<Score> score{};             // at this step; none where none was due
    std::map<std::string, double> metrics{};  // newest of the agent and the world
};

/// A snapshot of a run: copies of everything except the replay; see ReplaySnapshot.
struct RunSnapshot {
    RunState state;
    TensorMap agent;
    TensorMap games;  // Collector::state()
    std::optional<PolicySnapshot> policy{};
    std::optional<ReplaySnapshot> replay{};  // none: without train.save_replay, or no replay
    std::string config{};                    // all settings as YAML
};

/// A checkpoint that has been written, or verified.
struct StoredCheckpoint {
    std::filesystem::path folder;
    Manifest manifest;
};

/// A checkpoint that has been read.
struct Checkpoint {
    RunState state;
    StoredCheckpoint stored;
    std::vector<std::string> passed_over{};  // for each newer checkpoint why it cannot be read
};

/// A run that cannot be resumed: no checkpoint, a damaged one, another configuration.
struct ResumeError : std::runtime_error {
    using std::runtime_error::runtime_error;
};
/// The checkpoint is whole, and does not fit the agent or the games.
struct DoesNotFit : ResumeError {
    DoesNotFit(const std::string& sentence, const std::string& way_out)
        : ResumeError(sentence + "; " + way_out), without_way_out(sentence) {}
    std::string without_way_out;
};

/// The checkpoint could not be read for lack of memory or because of a system error: the same command may
/// succeed later.
struct UnreadableNow : ResumeError {
    using ResumeError::ResumeError;
};

/// Writes a checkpoint. Full chunks of the replay are not written again: those in `before_last` are linked,
/// others in `last` are copied, each after its checksum has been verified. Two consecutive checkpoints
/// therefore share no file, and one damaged file costs one checkpoint. Also updates the run's
/// joystick_events.csv. Throws std::runtime_error, naming the file, if writing fails; all other checkpoints
/// are then unchanged.
StoredCheckpoint write_checkpoint(const std::filesystem::path& run_dir, RunSnapshot snapshot,
                                  const StoredCheckpoint* last, const StoredCheckpoint* before_last);

/// Deletes the checkpoints up to `newest` that are not kept, those after it, damaged ones that were set
/// aside, and unfinished ones of killed runs. The decision depends only on what is on disk. With
/// `retention.best` the link "best" is set to the best one.
void delete_other_checkpoints(const std::filesystem::path& run_dir, const std::filesystem::path& newest,
                              const Retention& retention);

/// Returns the complete checkpoints of a run, oldest first.
std::vector<std::filesystem::path> list_checkpoints(const std::filesystem::path& run_dir);

/// The same; throws ResumeError, which says what the folder is instead, where there are none.
std::vector<std::filesystem::path> require_checkpoints(const std::filesystem::path& run_dir);

/// Returns whether the folder holds a run's checkpoint (the first is written before the first step), a row of
/// episodes.csv, or a progress.csv that is not empty.
bool has_begun(const std::filesystem::path& run_dir);

/// Returns the newest checkpoint that is whole, which is the one that load_newest_checkpoint() takes,
/// unless it refuses a newer one for its format; none where none is. Throws UnreadableNow.
std::optional<StoredCheckpoint> newest_whole_checkpoint(const std::filesystem::path& run_dir);

/// Renames the checkpoints after `resumed`, which are damaged, to step_N.damaged: neither the run's tables,
/// which are cut back to `resumed`, nor its settings are compared with them any more.
void set_aside_damaged(const std::filesystem::path& run_dir, const std::filesystem::path& resumed);

/// Restores the agent, its replay (where the checkpoint holds it) and the games from the run's newest
/// checkpoint that is whole. Every file is verified against the manifest before any is used. `restore_games`
/// receives the result of Collector::state(), and throws if it cannot restore it. Throws ResumeError where
/// none is whole, and where the newest whole one does not fit or is of another format; UnreadableNow where it
/// cannot be read now.
Checkpoint load_newest_checkpoint(const std::filesystem::path& run_dir, Agent& agent,
                                  const std::function<void(const TensorMap&)>& restore_games);

}  // namespace cale
