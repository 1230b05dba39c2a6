// The outputs of a run: log rows, evaluations, checkpoints, and console lines.
#pragma once

#include <cstdint>
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

/// With several processes only the first one writes; the others take part in the collective operations.
class Recorder {
  public:
    /// Opens the run's files, at the position of `resumed`. The arguments must outlive it.
    Recorder(Agent& agent, Collector& collector, RunState& state, const TrainingWorld& world,
             const RunSettings& settings, const TrainOptions& options, const Checkpoint* resumed);
    ~Recorder();

    /// Must be called before the first step: writes the first checkpoint and makes an evaluation that was
    /// interrupted.
    void begin();
    /// Must be called after each update of the agent.
    void after_update();
    /// Must be called after an agent step of all environments: `before` is the run's step before it, `ended`
    /// the episodes that ended in it; it is empty afterwards.
    void after_step(std::int64_t before, std::vector<Episode>& ended);
    /// Returns whether the run must end early; the same in all processes.
    bool stop() const { return stop_; }
    /// Must be called after the last step: writes the last checkpoint, evaluation, row and curve.
    Outcome finish();

    TimeSplit time;  // since the newest row

  private:
    struct Files;

    bool synchronises(std::int64_t before) const;
    bool checkpoint_due(std::int64_t before) const;
    bool evaluations_decide() const;
    bool reached_pause() const;
    bool agreed_to_stop(bool together) const;
    void write_episode(const Episode& episode);
    void write_row(bool to_tensorboard);
    void write_last_row();
    std::optional<PolicySnapshot> policy_snapshot() const;
    void write_checkpoint();
    void write_scheduled_checkpoint();
    bool run_evaluation();
    bool last_evaluation_due() const;
    bool has_its_last_evaluation() const;
    bool run_last_evaluation(bool replays_evaluation);
    void update_metrics();
    std::string closing_line() const;
    void draw_curve() const;

    Agent& agent_;
    Collector& collector_;
    RunState& state_;
    const TrainingWorld& world_;
    const RunSettings& settings_;
    const TrainOptions& options_;
    const Checkpoint* resumed_;
    std::unique_ptr<Files> files_;      // of the first process
    std::int64_t written_step_ = -1;    // of the newest checkpoint of this session
    std::int64_t evaluated_step_ = -1;  // of its newest evaluation
    std::int64_t uncounted_rows_ = 0;   // at the end of the table, which checkpoints do not count
    bool stop_ = false;
};

}  // namespace cale
