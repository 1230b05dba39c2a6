#include "replay/accumulator.h"

#include <algorithm>
#include <cmath>

namespace cale {
namespace {

// The frames of steps[last - stack + 1 .. last], blank where there is no such step.
void stack_frames(std::span<const StoredStep> steps, std::int64_t last, std::span<FrameId> frames) {
    const auto stack = static_cast<std::int64_t>(frames.size());
    for (std::int64_t i = 0; i < stack; ++i) {
        const std::int64_t step = last - stack + 1 + i;
        frames[static_cast<std::size_t>(i)] =
            step < 0 ? kBlankFrame : steps[static_cast<std::size_t>(step)].frame;
    }
}

}  // namespace

double n_step_return(std::span<const StoredStep> steps, double gamma) {
    double sum = 0;
    for (std::size_t k = steps.size(); k-- > 0;) sum = steps[k].reward + gamma * sum;
    return sum;
}

Accumulator::Accumulator(const ReplayConfig& config)
    : rule_(config.replay_terminal),
      stack_(config.observation.stack),
      horizon_(config.update_horizon),
      gamma_(config.gamma),
      observation_(static_cast<std::size_t>(config.observation.stack)),
      next_observation_(static_cast<std::size_t>(config.observation.stack)) {
    steps_.reserve(static_cast<std::size_t>(max_steps() + 1));
}

void Accumulator::add(const StoredStep& step, EpisodeEnd ending, FrameId final_frame, const Emit& emit) {
    push(step);
    if (rule_ == ReplayTerminal::corrected)
        add_corrected(ending, final_frame, emit);
    else
        add_dopamine(ending, emit);
    if (ending != EpisodeEnd::none) steps_.clear();
}

void Accumulator::add_corrected(EpisodeEnd ending, FrameId final_frame, const Emit& emit) {
    auto size = static_cast<std::int64_t>(steps_.size());
    if (size > horizon_)
        emit_window(size - 1 - horizon_, horizon_, size - 1, std::pow(gamma_, horizon_), emit);
    if (ending == EpisodeEnd::none) return;

    // Every start that is left, with the rewards that are left. No frame followed a
    // terminal: with a discount of 0 the stack that ends the episode does as well.
    const std::int64_t first_left = std::max<std::int64_t>(size - horizon_, 0);
    const std::int64_t rewards_end = size;
    if (ending == EpisodeEnd::truncated) {
        steps_.push_back({final_frame, 0});
        ++size;
    }
    for (std::int64_t start = first_left; start < rewards_end; ++start) {
        const std::int64_t rewards = rewards_end - start;
        const double discount = ending == EpisodeEnd::terminal ? 0.0 : std::pow(gamma_, rewards);
        emit_window(start, rewards, size - 1, discount, emit);
    }
}

// Dopamine's accumulator as it is, its issue #228 included: at a terminal it emits again
// after dropping its oldest step, so that stacks lose frames and one start is stored
// several times; a sum of full horizon lacks the last reward; a truncation discards the
// starts that are left.
void Accumulator::add_dopamine(EpisodeEnd ending, const Emit& emit) {
    const bool terminal = ending == EpisodeEnd::terminal;
    for (;;) {
        const auto size = static_cast<std::int64_t>(steps_.size());
        if (size <= (terminal ? 1 : horizon_)) return;
        const std::int64_t start = std::max<std::int64_t>(size - 1 - horizon_, 0);
        emit_window(start, std::min(horizon_, size - start), size - 1,
                    terminal ? 0.0 : std::pow(gamma_, horizon_), emit);
        if (!terminal) return;
        steps_.erase(steps_.begin());
    }
}

void Accumulator::push(const StoredStep& step) {
    steps_.push_back(step);
    if (static_cast<std::int64_t>(steps_.size()) > max_steps()) steps_.erase(steps_.begin());
}

// The transition whose observation ends at step `start`, whose return sums that many
// rewards from there, and whose next observation ends at step `last`.
void Accumulator::emit_window(std::int64_t start, std::int64_t rewards, std::int64_t last, double discount,
                              const Emit& emit) {
    const std::span<const StoredStep> steps = steps_;
    stack_frames(steps, start, observation_);
    stack_frames(steps, last, next_observation_);
    const auto summed = steps.subspan(static_cast<std::size_t>(start), static_cast<std::size_t>(rewards));
    emit({observation_, next_observation_, n_step_return(summed, gamma_), discount});
}

}  // namespace cale
