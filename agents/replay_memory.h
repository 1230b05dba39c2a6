// What the agents that learn from a replay share: how they fill it, and the rhythm of their updates.
#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <string>

#include <c10/core/Event.h>
#include <torch/types.h>

#include "agents/agent.h"
#include "agents/exploration.h"
#include "agents/state.h"
#include "agents/time_split.h"
#include "cale/fields.h"
#include "replay/replay_buffer.h"

namespace cale {

/// The defaults are those of 200 million frames.
struct ReplaySettings {
    double gamma = 0.99;
    std::int64_t update_horizon = 1;
    std::int64_t min_replay = 20'000;
    std::int64_t update_period = 4;
    std::int64_t replay_capacity = 1'000'000;
    std::int64_t batch_size = 32;
    std::optional<double> reward_clip = std::nullopt;
    double reward_scale = 1;
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;
    bool replay_on_device = false;
};

template <class Visit>
void fields(ReplaySettings& settings, Visit&& visit) {
    visit("gamma", settings.gamma, Range{0, 1}, "discount per agent step");
    visit("update_horizon", settings.update_horizon, Range{1, 1000}, "n of the n-step return");
    visit("min_replay", settings.min_replay, Range{0, 1e12}, "transitions stored before the first update");
    visit("update_period", settings.update_period, Range{1, 1e9}, "agent steps per update");
    visit("replay_capacity", settings.replay_capacity, Range{1, 1e9}, "transitions kept in the replay");
    visit("batch_size", settings.batch_size, Range{1, 65'536}, "transitions per update");
    visit("reward_clip", settings.reward_clip, Range{0, 1e9},
          "rewards are clipped to plus or minus this when stored; none: off");
    visit("reward_scale", settings.reward_scale, Range{0, 1e9},
          "factor of the n-step return in the values' target");
    visit("replay_terminal", settings.replay_terminal,
          "corrected: every transition once; dopamine: the reference's accumulator");
    visit("replay_on_device", settings.replay_on_device,
          "keep the frames in the memory of --device too, and put batches together there; 7 GB per million");
}

/// Consecutive decisions, numbered from 0 over a run: first, ..., end - 1.
struct Decisions {
    std::int64_t first = 0, end = 0;  // the first, and the one after the last
    /// How many of them are multiples of `period`.
    std::int64_t multiples_of(std::int64_t period) const;
};

/// Throws as ReplayMemory does where so many bytes are too few for it.
void check_memory(const ReplaySettings& settings, const AgentSpec& spec, bool prioritised,
                  std::int64_t available);

/// A replay, and the count of decisions that tells when to learn from it.
class ReplayMemory {
  public:
    /// Throws as ReplayBuffer does.
    ReplayMemory(const ReplaySettings& settings, const AgentSpec& spec, bool prioritised, std::uint64_t seed);

    /// Stores one step of every environment. Throws std::invalid_argument for other counts and
    /// for a reward that is no number.
    void store(const Experiences& seen);

    /// Counts the next decision of each environment.
    Decisions next_decisions();
    /// Decisions counted so far.
    std::int64_t decisions() const { return decisions_; }

    /// Whether more than min_replay transitions have been stored.
    bool warm() const;
    /// Epsilon of the next decision: 1 during the warm-up, then as `settings` say.
    double epsilon(const EpsilonSettings& settings) const;

    /// What store() and sample() took so far.
    const TimeSplit& time() const { return time_; }

    /// A batch on the agent's device, in the same memory every time. `index` stays on the CPU.
    Batch sample();
    /// For the batch sampled last, before anything else is stored: see ReplayBuffer.
    void set_priorities(const Batch& batch, const torch::Tensor& priorities);

    /// Adds the generator and the counters; the contents are replay()'s.
    void add_state(StateParts& parts);
    /// The contents.
    ReplayBuffer& replay() { return replay_; }

  private:
    ReplaySettings settings_;
    AgentSpec spec_;
    ReplayBuffer replay_;
    Batch sampled_;    // filled anew by every sample()
    Batch on_device_;  // and copied there, unless that is the CPU
    c10::Event copied_;
    std::mt19937_64 random_;
    std::int64_t decisions_ = 0;
    TimeSplit time_;
};

}  // namespace cale
