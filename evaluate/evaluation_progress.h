// What a console shows of an evaluation while it is under way.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "evaluate/evaluation.h"
#include "terminal/console.h"

namespace cale {

/// A bar on a terminal, a line per game elsewhere: games that have ended, their mean return, the time left.
class EvaluationProgress {
  public:
    /// Has `plan` call it, so it must outlive the evaluation, and the console must outlive it. `title` comes
    /// first in all that it shows. The games that the plan knows count as played.
    EvaluationProgress(Console& console, EvaluationPlan& plan, std::string title = "");
    EvaluationProgress(const EvaluationProgress&) = delete;
    EvaluationProgress& operator=(const EvaluationProgress&) = delete;

  private:
    void count(const EvaluatedGame& game);
    void update_speed();

    Console& console_;
    GamesProgress progress_;
    double sum_of_returns_ = 0;
    std::int64_t steps_of_games_ = 0;  // that have ended
    std::int64_t steps_known_ = 0;     // that were not played here
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cale
