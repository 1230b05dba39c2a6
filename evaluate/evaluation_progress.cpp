#include "evaluate/evaluation_progress.h"

#include <utility>

namespace cale {
namespace {

/// 0 where there is no limit.
std::int64_t known_limit(std::int64_t limit) {
    return limit == kNoLimit ? 0 : limit;
}

}  // namespace

EvaluationProgress::EvaluationProgress(Console& console, EvaluationPlan& plan, std::string title, bool lines)
    : console_(console), lines_(lines) {
    progress_.title = std::move(title);
    progress_.total_games = known_limit(plan.games);
    progress_.total_steps = known_limit(plan.steps);
    for (const auto& [number, game] : plan.known) {
        count(game);
        progress_.steps += game.length;
    }
    steps_known_ = progress_.steps;
    plan.ended = [this, before = plan.ended](std::int64_t number, const EvaluatedGame& game) {
        if (before) before(number, game);
        count(game);
        update_speed();
        progress_.values = {{"return", game.episode_return}};
        if (lines_)
            console_.report(progress_);
        else
            console_.draw(progress_);
        progress_.values.clear();
    };
    plan.stepped = [this, before = plan.stepped](std::int64_t steps) {
        if (before) before(steps);
        progress_.steps += steps;
        if (!console_.due()) return;
        update_speed();
        console_.draw(progress_);
    };
}

void EvaluationProgress::count(const EvaluatedGame& game) {
    ++progress_.games;
    sum_of_returns_ += game.episode_return;
    steps_of_games_ += game.length;
    const auto games = static_cast<double>(progress_.games);
    progress_.mean_return = sum_of_returns_ / games;
    progress_.mean_length = static_cast<double>(steps_of_games_) / games;
}

void EvaluationProgress::update_speed() {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    progress_.steps_per_second = static_cast<double>(progress_.steps - steps_known_) / seconds;
}

}  // namespace cale
