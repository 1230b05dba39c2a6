#include "experiment/meeting.h"

#include <vector>

#include "experiment/checkpoint.h"
#include "experiment/games_under_way.h"
#include "experiment/stop_signals.h"

namespace cale {

bool agreed_to_stop(const ProcessGroup& processes, bool meeting) {
    if (processes.single()) return stop_requested();
    return meeting && processes.any(stop_requested());
}

Outcome train_beside(Agent& agent, const EnvConfig& env, const TrainConfig& config, const EvalConfig& eval,
                     const LogConfig& log, const TrainOptions& options) {
    const StopSignals signals;
    const Rhythm rhythm(config, eval, log);
    GamesUnderWay games(env, static_cast<std::uint64_t>(config.seed), options.processes);
    RunState state;
    if (options.resume) {
        state = load_newest_checkpoint(options.run_dir, agent, config.save_replay, [&](const auto& stored) {
                    games.restore(stored);
                }).state;
    }
    // The first process's checkpoints hold the state of all; in its order.
    std::int64_t given_step = -1;
    const auto give_state = [&] {
        agent.state();
        games.state();
        given_step = state.step;
    };
    if (!options.resume || options.changed) give_state();
    if (state.evaluation_due && evaluations_decide(config, eval)) give_state();
    std::vector<Episode> ended;
    bool stop = agreed_to_stop(options.processes, /*meeting=*/true);
    while (state.step < config.total_steps && !stop) {
        const auto before = state.step;
        agent.update(games.observations());
        const auto actions = agent.act(games.observations(), ActMode::train);
        games.step(actions);
        games.take_in(actions, agent, state, ended);
        const bool meeting = rhythm.meets(before, state.step);
        if (meeting) games.meet(state, ended);
        if (checkpoint_due(config, eval, before, state.step)) give_state();
        stop = agreed_to_stop(options.processes, meeting);
    }
    if (given_step != state.step) give_state();
    if (state.step >= config.total_steps && evaluations_decide(config, eval)) give_state();
    return state.step < config.total_steps ? Outcome::interrupted : Outcome::finished;
}

}  // namespace cale
