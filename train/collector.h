// The environments of a training run, their observations and episode statistics.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <torch/types.h>

#include "agents/agent.h"
#include "cale/frames.h"
#include "parallel/process_group.h"
#include "train/checkpoint.h"
#include "train/log.h"
#include "world/world.h"

namespace cale {

/// With several processes each has a share of the environments, and the first one keeps the statistics of
/// all. Below, N is the number of this process's environments.
class Collector {
  public:
    /// Starts an episode in every environment. `num_envs`: of all processes. `seed`: the run's. Throws as
    /// `make_world` does, and std::invalid_argument where the environments cannot be shared equally.
    Collector(const MakeWorld& make_world, std::int64_t num_envs, std::uint64_t seed,
              ProcessGroup processes = {});

    /// Returns [N, stack, ...] uint8; a view that the next record() changes.
    torch::Tensor observations() const;

    /// Makes one agent step in every environment. The observations do not change until record().
    void step(const torch::Tensor& actions);

    /// Passes the outcome of the actions to the agent and counts the steps. In a single process it also
    /// counts the frames and appends the episodes that ended to `ended`.
    void record(const torch::Tensor& actions, Agent& agent, RunState& state, std::vector<Episode>& ended);
    /// Must be called by all processes together: the first one then counts the steps of all since the last
    /// call, as a single process would have.
    void synchronise(RunState& state, std::vector<Episode>& ended);

    /// See World.
    void announce(const torch::Tensor& actions);
    /// Stops a world in real time as long as it lives.
    class Pause {
      public:
        explicit Pause(Collector& collector) : world_(*collector.world_) { world_.pause(true); }
        ~Pause() { world_.pause(false); }
        Pause(const Pause&) = delete;
        Pause& operator=(const Pause&) = delete;

      private:
        World& world_;
    };
    /// Returns World::metrics().
    std::map<std::string, double> metrics() const { return world_->metrics(); }

    /// Returns everything, between record() and step(): frames, stack, episode_returns, episode_lengths, and
    /// of each environment game.<i>.NAME (see EpisodeRecord). Must be called by all processes together, after
    /// synchronise(); the first one receives the state of all.
    TensorMap state() const;
    /// Restores exactly what state() returned, for environments of the same configuration. Atari games are
    /// replayed from their start, which takes seconds. Throws std::runtime_error for a state that is
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
