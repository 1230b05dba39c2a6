// The training loop: environments, one agent, and a recorder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "agents/agent.h"
#include "parallel/process_group.h"
#include "settings/run_config.h"

namespace cale {

struct TrainingWorld;

/// The loop's inputs besides the configuration.
struct TrainOptions {
    std::filesystem::path run_dir;  // exists, and holds config.yaml and metadata.json
    bool resume = false;            // from the run's newest checkpoint
    /// Called once the run's state has been loaded, with the seconds of training so far.
    std::function<void(double)> resumed = {};
    std::function<void()> checkpointed = {};  // called whenever a checkpoint is started
    std::int64_t until = 0;                   // agent step at which to pause; 0: none
    bool changed = false;                     // with resume: settings differ from the checkpoint's
    bool finished = false;                    // with resume: its last session had finished
    bool evaluates_otherwise = false;         // with resume: eval.* differ from the checkpoint's
    bool progress_bar = true;                 // a line on the terminal that is kept up to date
    bool learns_beside = false;               // see TrainingProgram
    ProcessGroup processes{};                 // that train together; the first one writes the files
    std::string agent_name;                   // "sac", for episodes.csv
    std::string config;                       // all settings as YAML, for the checkpoints
    std::vector<std::pair<std::string, std::string>> hyperparameters;  // key and value, for TensorBoard
};

/// paused: at TrainOptions::until.
enum class Outcome { finished, paused, interrupted };

/// Trains `agent` for train.total_steps agent steps and leaves in the run's folder
/// progress.csv, episodes.csv, joystick_events.csv, TensorBoard events, checkpoints/, learning_curve.svg
/// and .png and, if evaluations are enabled, eval/ and videos/.
///
/// Pauses at TrainOptions::until after a checkpoint, as if it had been interrupted there.
/// SIGINT, SIGTERM and SIGHUP end it early, after a checkpoint (terminal/stop_signals.h). Throws
/// std::runtime_error if the disk fails, Diverged if a logged value or what an agent computes is not finite
/// (earlier checkpoints are intact), std::invalid_argument for a reward that is not, ResumeError, and what
/// the world throws.
Outcome train(Agent& agent, const TrainingWorld& world, const RunSettings& settings,
              const TrainOptions& options);

}  // namespace cale
