// N games of a training run: what the agent sees of them, how they have gone, and how to go on with them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <torch/types.h>

#include "agents/agent.h"
#include "agents/process_group.h"
#include "cale/frames.h"
#include "cale/vector_env.h"
#include "experiment/checkpoint.h"
#include "experiment/log.h"

namespace cale {

/// Where several processes train together each has its share of the games, and the first one counts all.
/// Below, N is the number of this process's games.
class GamesUnderWay {
  public:
    static constexpr std::size_t kStack = 4;  // frames of an observation

    /// Starts a game in every environment. `seed`: the run's. Throws as VectorEnv does, and
    /// std::invalid_argument where the environments cannot be shared equally.
    GamesUnderWay(const EnvConfig& config, std::uint64_t seed, ProcessGroup processes = {});

    /// [N, 4, 84, 84] uint8; a view that the next take_in() changes.
    torch::Tensor observations() const;

    /// One agent step everywhere. The observations stay what they were until take_in().
    void step(const torch::Tensor& chosen);

    /// Tells the agent what its actions led to, and counts the steps. In a process alone, the frames too, and
    /// the episodes that ended, which it appends to `ended`.
    void take_in(const torch::Tensor& actions, Agent& agent, RunState& state, std::vector<Episode>& ended);
    /// All processes together: the first one counts what happened everywhere since the last time, as a
    /// process alone would have.
    void meet(RunState& state, std::vector<Episode>& ended);

    const ProcessGroup& processes() const { return processes_; }

    /// All of it, between take_in() and step(): frames, stack, episode_returns, episode_lengths, and of each
    /// game game.<i>.{start, events, strengths} (see GameRecord). All processes call it together, after
    /// meet(); what the first one gets is that of all.
    TensorMap state() const;
    /// Goes on exactly where state() was, with an environment of the same configuration. Plays the games
    /// under way again, which takes seconds. Throws std::runtime_error for a state that is incomplete or
    /// damaged.
    void restore(const TensorMap& state);

  private:
    /// Of all games, after the run's agent step number `step`.
    void count_step(std::span<const StepResult> results, std::int64_t step, RunState& state,
                    std::vector<Episode>& ended);
    TensorMap own_state() const;

    ProcessGroup processes_;
    std::int64_t all_, first_;  // games of all processes; the number of this one's first
    VectorEnv env_;
    std::vector<StepResult> results_;
    std::vector<StepResult> uncounted_;  // since meet(): steps x N
    std::vector<Episode> episodes_;      // under way; of all games, where they are counted
    FrameStack stack_;
    std::vector<std::uint8_t> frames_;  // that the next actions are chosen on
    std::vector<std::uint8_t> next_frames_;
    std::vector<std::uint8_t> final_frames_;
};

}  // namespace cale
