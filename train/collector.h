// The environments of a training run: what the agent sees of them, and how their episodes go.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <torch/types.h>

#include "agents/agent.h"
#include "cale/frames.h"
#include "parallel/process_group.h"
#include "train/checkpoint.h"
#include "train/log.h"
#include "world/world.h"

namespace cale {

/// Where several processes train together each has its share of the environments, and the first one counts
/// all. Below, N is the number of this process's environments.
class Collector {
  public:
    /// Starts an episode in every environment. `num_envs`: of all processes. `seed`: the run's. Throws as
    /// `make_world` does, and std::invalid_argument where the environments cannot be shared equally.
    Collector(const MakeWorld& make_world, std::int64_t num_envs, std::uint64_t seed,
              ProcessGroup processes = {});

    /// Returns [N, stack, ...] uint8; a view that the next record() changes.
    torch::Tensor observations() const;

    /// One agent step everywhere. The observations stay what they were until record().
    void step(const torch::Tensor& actions);

    /// Shows the agent what its actions led to, and counts the steps. In a single process, the frames too,
    /// and the episodes that ended, which it appends to `ended`.
    void record(const torch::Tensor& actions, Agent& agent, RunState& state, std::vector<Episode>& ended);
    /// All processes together: the first one counts what happened everywhere since the last time, as a
    /// single process would have.
    void synchronise(RunState& state, std::vector<Episode>& ended);

    const ProcessGroup& processes() const { return processes_; }

    /// Returns everything, between record() and step(): frames, stack, episode_returns, episode_lengths, and
    /// of each environment game.<i>.NAME (see EpisodeRecord). All processes call it together, after
    /// synchronise(); the first one gets everybody's.
    TensorMap state() const;
    /// Continues exactly where state() was, with environments of the same configuration. Atari games are
    /// played again from their beginning, which takes seconds. Throws std::runtime_error for a state that is
    /// incomplete or damaged.
    void restore(const TensorMap& state);

  private:
    /// Of all environments, after the run's agent step number `step`.
    void count_step(std::span<const StepResult> results, std::int64_t step, RunState& state,
                    std::vector<Episode>& ended);
    TensorMap own_state() const;
    std::span<const std::uint8_t> frame(std::size_t i) const {
        return std::span(frames_).subspan(i * frame_size_, frame_size_);
    }

    ProcessGroup processes_;
    std::int64_t all_, first_;  // environments of all processes; the number of this one's first
    std::unique_ptr<World> world_;
    ObservationSpace observation_space_;
    std::size_t frame_size_;  // bytes
    std::vector<StepResult> results_;
    std::vector<StepResult> uncounted_;  // since synchronise(): steps x N
    std::vector<Episode> episodes_;      // under way; of all environments, where they are counted
    FrameStack stack_;
    std::vector<std::uint8_t> frames_;  // that the next actions are chosen on
    std::vector<std::uint8_t> next_frames_;
    std::vector<std::uint8_t> final_frames_;
};

}  // namespace cale
