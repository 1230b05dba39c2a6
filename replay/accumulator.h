// How the steps of one environment become n-step transitions (Sutton 1988), under the
// two rules of ReplayTerminal. Knows frames by their number only.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "replay/types.h"

namespace cale {

/// The number of a frame: 0, 1, 2, ... in the order they were stored.
using FrameId = std::int64_t;
/// Stands for a frame of zeros, before an episode's first.
inline constexpr FrameId kBlankFrame = -1;

/// One agent step: the frame the action was chosen on, and the reward that followed.
struct StoredStep {
    FrameId frame = 0;  // that the action was chosen on
    double reward = 0;  // of the step
};

/// How a step ended its episode.
enum class EpisodeEnd { none, terminal, truncated };

/// An n-step transition, valid during the call that passes it.
struct Transition {
    std::span<const FrameId> observation;       // stack of frames, newest last
    std::span<const FrameId> next_observation;  // n steps later, or at the episode's end
    double n_step_return = 0;                   // of the rewards in between
    double discount = 0;                        // of the value of next_observation
};

/// sum_k gamma^k r_k over these steps.
double n_step_return(std::span<const StoredStep> steps, double gamma);

/// Turns the steps of one environment into transitions. Keeps the last
/// update_horizon + stack steps of the current episode.
class Accumulator {
  public:
    /// Takes a transition.
    using Emit = std::function<void(const Transition&)>;

    /// The configuration's stack, update_horizon, gamma and rule.
    explicit Accumulator(const ReplayConfig& config);

    /// Takes the next step and hands every transition that it completes to `emit`, in
    /// order of time. `final_frame` is the frame that followed a truncation; the
    /// corrected rule bootstraps from it, the dopamine rule ignores it.
    void add(const StoredStep& step, EpisodeEnd ending, FrameId final_frame, const Emit& emit);

    /// The steps that later transitions may need, oldest first: to be saved and restored.
    std::vector<StoredStep>& steps() { return steps_; }
    const std::vector<StoredStep>& steps() const { return steps_; }  // the same
    std::int64_t max_steps() const { return horizon_ + stack_; }     // how many these can be

  private:
    void add_corrected(EpisodeEnd ending, FrameId final_frame, const Emit& emit);
    void add_dopamine(EpisodeEnd ending, const Emit& emit);
    void push(const StoredStep& step);
    void emit_window(std::int64_t start, std::int64_t rewards, std::int64_t last, double discount,
                     const Emit& emit);

    ReplayTerminal rule_;
    std::int64_t stack_;
    std::int64_t horizon_;
    double gamma_;
    std::vector<StoredStep> steps_;
    std::vector<FrameId> observation_, next_observation_;  // what emit_window hands out
};

}  // namespace cale
