#include "train/training.h"

#include <future>
#include <optional>

#include <fmt/format.h>

#include "terminal/stop_signals.h"
#include "train/checkpoint.h"
#include "train/collector.h"
#include "train/recorder.h"
#include "train/training_world.h"

namespace cale {
namespace {

/// Agent::update(). What it spends on its batches counts as `replay` and `transfer`.
void update(Agent& agent, const Collector& collector, Recorder& recorder) {
    auto& time = recorder.time;
    const auto before = agent.memory_time();
    bool updated = false;
    {
        const Timed timed(time.update);
        updated = agent.update(collector.observations());
    }
    if (updated) recorder.after_update();
    const auto after = agent.memory_time();
    for (const auto part : {&TimeSplit::replay, &TimeSplit::transfer}) {
        time.*part += after.*part - before.*part;
        time.update -= after.*part - before.*part;
    }
}

torch::Tensor act(Agent& agent, const Collector& collector, TimeSplit& time) {
    const Timed timed(time.act);
    return agent.act(collector.observations(), ActMode::train);
}

}  // namespace

Outcome train(Agent& agent, const TrainingWorld& world, const RunSettings& settings,
              const TrainOptions& options) {
    const StopSignals signals;
    const auto& config = settings.train;
    Collector collector(world.make, world.num_envs, static_cast<std::uint64_t>(config.seed),
                        options.processes);
    std::optional<Checkpoint> resumed;
    if (options.resume) {
        resumed = load_newest_checkpoint(options.run_dir, agent,
                                         [&](const TensorMap& stored) { collector.restore(stored); });
    }
    RunState state = resumed ? resumed->state : RunState{};
    options.processes.require_same(
        fmt::format("{} {}", state.step, options.until),
        fmt::format(
            "the processes of this run do not begin at the same agent step (this one at {}), or do not "
            "have the same --until; give all of them the same command line and the same files",
            state.step));
    if (resumed && options.processes.first()) set_aside_damaged(options.run_dir, resumed->stored.folder);
    Recorder recorder(agent, collector, state, world, settings, options, resumed ? &*resumed : nullptr);
    auto& time = recorder.time;

    // With overlap the environments step on another thread during the update, so that actions are chosen with
    // the parameters from before the newest one. In real time the game runs by itself: after the update there
    // may be a newer observation.
    const bool late_update = (config.overlap || config.realtime) && !options.learns_beside;
    const auto step_when =
        late_update && !config.realtime ? std::launch::async : std::launch::deferred;  // deferred: in get()

    recorder.begin();
    std::vector<Episode> ended;
    while (state.step < config.total_steps && !recorder.stop()) {
        const auto before = state.step;
        if (!late_update) update(agent, collector, recorder);
        const auto actions = act(agent, collector, time);
        if (config.realtime) collector.announce(actions);
        auto step = std::async(step_when, [&] { collector.step(actions); });
        if (late_update) update(agent, collector, recorder);
        {
            const Timed timed(time.environment);  // with overlap the wait alone
            step.get();
        }
        {
            const Timed timed(time.replay);
            collector.record(actions, agent, state, ended);
        }
        const Timed timed(time.log);
        recorder.after_step(before, ended);
    }
    return recorder.finish();
}

}  // namespace cale
