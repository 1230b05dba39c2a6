// Checkpoints: everything that a run needs to go on, in one folder
//
//     <run>/checkpoints/step_000250000/
//         agent.safetensors   networks, optimisers, random generators, counters, a rollout under way
//         games.safetensors   the games under way
//         replay.zst          the replay's contents (train.save_replay)
//         state.json          where the run stood
//
// A folder appears under its name only when it is complete and on the disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "agents/agent.h"

namespace cale {

/// Where a run stands.
struct RunState {
    std::int64_t step = 0;   // agent steps, over all environments
    std::int64_t frame = 0;  // emulated frames, over all environments
    std::int64_t episodes = 0;
    double seconds = 0;                     // spent training, over all sittings
    std::vector<double> recent_returns;     // of the last 100 episodes, oldest first
    std::int64_t episodes_offset = 0;       // bytes of episodes.csv that belong to the run so far
    std::int64_t progress_rows = 0;         // reports in progress.csv
    std::map<std::string, double> metrics;  // of the agent's newest update
};

struct Checkpoint {
    RunState state;
    TensorMap games{};                       // GamesUnderWay::state()
    std::vector<std::string> passed_over{};  // a sentence for each newer checkpoint that cannot be read
};

/// A run that cannot be resumed: no checkpoint, a damaged one, another configuration.
struct ResumeError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Writes a checkpoint and deletes all but the newest `keep`. Returns its folder.
/// Throws std::runtime_error, naming the file, where the disk refuses; the checkpoints
/// before are untouched then.
std::filesystem::path save_checkpoint(const std::filesystem::path& run_dir, Agent& agent,
                                      const TensorMap& games, const RunState& state, bool save_replay,
                                      std::int64_t keep);

/// The complete checkpoints of a run, oldest first.
std::vector<std::filesystem::path> list_checkpoints(const std::filesystem::path& run_dir);

/// Brings the agent to the newest checkpoint of the run that can be read. Throws ResumeError where none can.
Checkpoint load_newest_checkpoint(const std::filesystem::path& run_dir, Agent& agent, bool load_replay);

}  // namespace cale
