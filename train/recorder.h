// What a run leaves behind while it trains: rows, evaluations, checkpoints, and a line on the console.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "agents/agent.h"
#include "agents/time_split.h"
#include "settings/run_config.h"
#include "train/checkpoint.h"
#include "train/collector.h"
#include "train/log.h"
#include "train/training.h"
#include "train/training_world.h"

namespace cale {

/// Of several processes the first one writes; the others take part in what all must do together, and are
/// silent.
class Recorder {
  public:
    /// Opens the run's files, at the place where `resumed` stood. The arguments must outlive it.
    Recorder(Agent& agent, Collector& collector, RunState& state, const TrainingWorld& world,
             const RunSettings& settings, const TrainOptions& options, const Checkpoint* resumed);
    ~Recorder();

    /// Before the first step: the first checkpoint, and the evaluation that the last sitting owed.
    void begin();
    /// After an agent step everywhere: `before` is the run's step before it, `ended` the episodes that it
    /// ended.
    void after_step(std::int64_t before, std::vector<Episode>& ended);
    /// Returns whether the run is to end early; several processes agree on it.
    bool stop() const { return stop_; }
    /// After the last step: the last checkpoint, evaluation, row and curve.
    Outcome finish();

    TimeSplit time;  // since the newest row

  private:
    struct Files;

    bool synchronises(std::int64_t before) const;
    bool checkpoint_due(std::int64_t before) const;
    bool evaluations_decide() const;
    bool agreed_to_stop(bool together) const;
    void write_episode(const Episode& episode);
    void write_row(bool to_tensorboard);
    void write_last_row();
    std::optional<PolicySnapshot> policy_snapshot() const;
    void write_checkpoint();
    void write_scheduled_checkpoint();
    void rewrite_checkpoint_after_evaluation();
    bool run_evaluation();
    std::map<std::string, double> newest_metrics();
    std::string closing_line() const;
    void draw_curve() const;

    Agent& agent_;
    Collector& collector_;
    RunState& state_;
    const TrainingWorld& world_;
    const RunSettings& settings_;
    const TrainOptions& options_;
    const Checkpoint* resumed_;
    std::unique_ptr<Files> files_;    // of the first process
    std::int64_t written_step_ = -1;  // of the newest checkpoint of this sitting
    bool stop_ = false;
};

}  // namespace cale
