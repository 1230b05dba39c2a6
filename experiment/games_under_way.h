// N games of a training run: what the agent sees of them, how they have gone, and how to go on with them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <torch/types.h>

#include "agents/agent.h"
#include "cale/frames.h"
#include "cale/vector_env.h"
#include "experiment/checkpoint.h"
#include "experiment/log.h"

namespace cale {

class GamesUnderWay {
  public:
    static constexpr std::size_t kStack = 4;  // frames of an observation

    /// Starts a game in every environment. `seed`: the run's. Throws as VectorEnv does.
    GamesUnderWay(const EnvConfig& config, std::uint64_t seed);

    /// [N, 4, 84, 84] uint8; a view that the next take_in() changes.
    torch::Tensor observations() const;

    /// One agent step everywhere. The observations stay what they were until take_in().
    void step(const torch::Tensor& chosen);

    /// Tells the agent what its actions led to, and counts. Appends the episodes that ended to `ended`.
    void take_in(const torch::Tensor& actions, Agent& agent, RunState& state, std::vector<Episode>& ended);

    /// All of it, between take_in() and step(): frames, stack, episode_returns, episode_lengths, and of each
    /// game game.<i>.{start, events, strengths} (see GameRecord).
    TensorMap state() const;
    /// Goes on exactly where state() was, with an environment of the same configuration. Plays the games
    /// under way again, which takes seconds. Throws std::runtime_error for a state that is incomplete or
    /// damaged.
    void restore(const TensorMap& state);

  private:
    VectorEnv env_;
    std::vector<StepResult> results_;
    std::vector<Episode> episodes_;
    FrameStack stack_;
    std::vector<std::uint8_t> frames_;  // that the next actions are chosen on
    std::vector<std::uint8_t> next_frames_;
    std::vector<std::uint8_t> final_frames_;
};

}  // namespace cale
