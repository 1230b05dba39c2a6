// The console display of a running evaluation.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "evaluate/evaluation.h"
#include "terminal/console.h"

namespace cale {

/// A bar on a terminal, elsewhere a line per game or nothing: games that have ended, their mean return, the
/// time left.
class EvaluationProgress {
  public:
    /// Sets callbacks of `plan`: it must outlive the evaluation, and the console must outlive it. `title`
    /// begins every line; without `lines` there is the bar alone. The plan's `known` games count as played.
    EvaluationProgress(Console& console, EvaluationPlan& plan, std::string title = "", bool lines = true);
    EvaluationProgress(const EvaluationProgress&) = delete;
    EvaluationProgress& operator=(const EvaluationProgress&) = delete;

  private:
    void count(const EvaluatedGame& game);
    void update_speed();

    Console& console_;
    bool lines_;  // where there is no bar
    GamesProgress progress_;
    double sum_of_returns_ = 0;
    std::int64_t steps_of_games_ = 0;  // that have ended
    std::int64_t steps_known_ = 0;     // that were not played here
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cale
