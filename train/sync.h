// How the processes of one run keep together: all play and learn, the first one keeps the records.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "agents/agent.h"
#include "settings/run_config.h"
#include "train/training.h"

namespace cale {

/// Whether a multiple of `every` lies in (before, now]; never where it is 0.
inline bool passed(std::int64_t before, std::int64_t now, std::int64_t every) {
    return every > 0 && before / every != now / every;
}

/// Whether train.keep_best compares evaluations. It compares training episodes where there are none, or only
/// the one at the end.
inline bool evaluations_decide(const TrainConfig& train, const EvalConfig& eval) {
    return train.keep_best && eval.every > 0 && eval.episodes > 0;
}

/// Whether a checkpoint is written at `now`, where it is not the last step.
inline bool checkpoint_due(const TrainConfig& train, const EvalConfig& eval, std::int64_t before,
                           std::int64_t now) {
    return passed(before, now, train.checkpoint_every) || passed(before, now, train.keep_every) ||
           (evaluations_decide(train, eval) && passed(before, now, eval.every));
}

/// When the processes meet: where the first one has a row, an evaluation or a checkpoint to write, and at the
/// end.
struct Rhythm {
    Rhythm(const TrainConfig& train, const EvalConfig& eval, const LogConfig& log)
        : total_steps(train.total_steps),
          every{log.every, eval.every, train.checkpoint_every, train.keep_every} {}

    std::int64_t total_steps;
    std::array<std::int64_t, 4> every;  // agent steps

    bool meets(std::int64_t before, std::int64_t now) const {
        return now >= total_steps || std::any_of(every.begin(), every.end(),
                                                 [&](auto period) { return passed(before, now, period); });
    }
};

/// Whether to end early. Several processes agree on it, when they meet.
bool agreed_to_stop(const ProcessGroup& processes, bool meeting);

/// train() for the processes beside the first: they write nothing.
Outcome train_beside(Agent& agent, const EnvConfig& env, const TrainConfig& config, const EvalConfig& eval,
                     const LogConfig& log, const TrainOptions& options);

}  // namespace cale
