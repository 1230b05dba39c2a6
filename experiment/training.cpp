#include "experiment/training.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <optional>

#include <fmt/format.h>
#include <torch/types.h>

#include "agents/time_split.h"
#include "cale/games.h"
#include "cale/random_play.h"
#include "experiment/checkpoint.h"
#include "experiment/checkpoint_writer.h"
#include "experiment/console.h"
#include "experiment/evaluation.h"
#include "experiment/event_file.h"
#include "experiment/games_under_way.h"
#include "experiment/log.h"
#include "experiment/meeting.h"
#include "experiment/seeds.h"
#include "experiment/stop_signals.h"
#include "replay/replay_buffer.h"
#include "report/learning_curve.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr std::size_t kRecentEpisodes = 100;
constexpr std::ptrdiff_t kClosingEpisodes = 10;

/// Thrown out of an evaluation that a signal cuts off.
struct Interrupted {};

/// A clock that goes on where the last sitting stopped.
class Stopwatch {
  public:
    explicit Stopwatch(double seconds_before) : seconds_before_(seconds_before) {}
    double seconds() const {
        return seconds_before_ +
               std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    }

  private:
    double seconds_before_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Steps per second since it was last asked to start again.
struct Speedometer {
    std::int64_t step = 0;
    double seconds = 0;
    double read(std::int64_t step_now, double seconds_now) const {
        return seconds_now > seconds ? static_cast<double>(step_now - step) / (seconds_now - seconds) : 0;
    }
};

std::optional<double> mean(const std::vector<double>& values) {
    if (values.empty()) return std::nullopt;
    double sum = 0;
    for (const double value : values) sum += value;
    return sum / static_cast<double>(values.size());
}

void check_finite(const std::map<std::string, double>& metrics, const RunState& state,
                  const fs::path& run_dir) {
    for (const auto& [name, value] : metrics) {
        if (std::isfinite(value)) continue;
        throw std::runtime_error(fmt::format(
            "{} became {} by agent step {}: training stopped, and the last checkpoint in {} is from before; "
            "a lower agent.learning_rate is the usual remedy",
            name, value, state.step, (run_dir / "checkpoints").string()));
    }
}

/// The logs, the console and the files of one run, and where the run stands.
class Run {
  public:
    Run(Agent& agent, const EnvConfig& env, const TrainConfig& config, const EvalConfig& eval,
        const LogConfig& log, const TrainOptions& options)
        : agent_(agent),
          env_config_(env),
          config_(config),
          eval_(eval),
          log_(log),
          options_(options),
          rhythm_(config, eval, log),
          env_id_(fmt::format("ALE/{}-v5", find_game(env.game).name)),
          console_(stderr, options.progress_bar),
          games_(env, static_cast<std::uint64_t>(config.seed), options.processes),
          resumed_(begin()),
          state_(resumed_ ? resumed_->state : RunState{}),
          stopwatch_(state_.seconds),
          speed_{state_.step, state_.seconds},
          episodes_(options.run_dir / "episodes.csv",
                    {.env_id = env_id_,
                     .agent = options.agent_name,
                     .seed = static_cast<std::uint64_t>(config.seed)},
                    resumed_ ? std::optional(state_.episodes_offset) : std::nullopt),
          progress_(options.run_dir / "progress.csv",
                    resumed_ ? std::optional(state_.progress_rows) : std::nullopt),
          checkpoints_(options.run_dir,
                       {.newest = config.keep_checkpoints,
                        .every = config.keep_every,
                        .step_size = env.num_envs,
                        .best = config.keep_best},
                       resumed_ ? std::optional(resumed_->stored) : std::nullopt) {
        reported_ = progress();
        if (log.tensorboard) {
            events_.emplace(options.run_dir, resumed_ ? std::optional(state_.step) : std::nullopt);
            events_->write_hyperparameters(options.hyperparameters);
        }
    }

    Outcome train() {
        const StopSignals signals;
        if (resumed_) {
            for (const auto& sentence : resumed_->passed_over) console_.message(sentence);
            console_.message(fmt::format("Resumed at agent step {}.", state_.step));
            if (options_.resumed) options_.resumed(state_.seconds);
        }
        // So that a run can go on from its first step on, and remembers what was changed.
        if (!resumed_ || options_.changed) checkpoint();
        if (state_.evaluation_due) {
            state_.evaluation_due = !run_evaluation();
            if (!state_.evaluation_due) checkpoint_of_evaluation();
        }
        std::vector<Episode> ended;
        bool stop = agreed_to_stop(options_.processes, /*meeting=*/true);
        while (state_.step < config_.total_steps && !stop) {
            const std::int64_t before = state_.step;
            state_.score.reset();
            if (config_.overlap) {
                step_while_learning(ended);
            } else {
                step_strictly(ended);
            }
            const Timed timed(time_.log);
            const bool meeting = rhythm_.meets(before, state_.step);
            if (meeting) games_.meet(state_, ended);
            for (const auto& episode : ended) record(episode);
            ended.clear();
            if (passed(before, state_.step, log_.every)) report();
            if (console_.due()) console_.draw(progress());
            // In this order: a run that is killed in an evaluation repeats it.
            if (passed(before, state_.step, eval_.every) && state_.step < config_.total_steps)
                state_.evaluation_due = !run_evaluation();
            if (checkpoint_due(config_, eval_, before, state_.step)) scheduled_checkpoint();
            checkpoints_.check();
            stop = agreed_to_stop(options_.processes, meeting);
        }
        if (written_step_ != state_.step) {
            if (state_.step >= config_.total_steps) {
                scheduled_checkpoint();
            } else {
                checkpoint();
            }
        }
        report_the_rest();
        draw_curve();
        checkpoints_.finish();
        // A run that was killed behind the checkpoint of its last evaluation does not play that again.
        const bool evaluated = state_.score && state_.score->evaluated;
        if (state_.step < config_.total_steps || (!evaluated && !run_evaluation())) {
            console_.message(fmt::format("Interrupted at agent step {}; go on with --resume --run-dir {}",
                                         state_.step, options_.run_dir.string()));
            return Outcome::interrupted;
        }
        if (!evaluated) checkpoint_of_evaluation();
        checkpoints_.finish();
        console_.finish(reported_, fmt::format("{}Results: {}", closing_line(), options_.run_dir.string()));
        return Outcome::finished;
    }

  private:
    /// Brings agent and games to where the run stood.
    std::optional<Checkpoint> begin() {
        if (!options_.resume) return std::nullopt;
        return load_newest_checkpoint(options_.run_dir, agent_, config_.save_replay,
                                      [this](const TensorMap& games) { games_.restore(games); });
    }

    /// The paper's order: learn, decide, act, remember.
    void step_strictly(std::vector<Episode>& ended) {
        learn();
        const auto actions = decide();
        {
            const Timed timed(time_.environment);
            games_.step(actions);
        }
        take_in(actions, ended);
    }

    /// The environments step on another thread while the agent learns, so that it acts with the
    /// parameters from before its newest update. Of the environments' time only the wait counts.
    void step_while_learning(std::vector<Episode>& ended) {
        const auto actions = decide();
        auto stepping = std::async(std::launch::async, [&] { games_.step(actions); });
        learn();
        {
            const Timed timed(time_.environment);
            stepping.get();
        }
        take_in(actions, ended);
    }

    void learn() {
        const auto before = agent_.memory_time();
        {
            const Timed timed(time_.update);
            agent_.update(games_.observations());
        }
        // What an update spends on its batches is the replay's.
        const auto after = agent_.memory_time();
        for (const auto part : {&TimeSplit::replay, &TimeSplit::transfer}) {
            time_.*part += after.*part - before.*part;
            time_.update -= after.*part - before.*part;
        }
    }
    torch::Tensor decide() {
        const Timed timed(time_.act);
        return agent_.act(games_.observations(), ActMode::train);
    }
    void take_in(const torch::Tensor& actions, std::vector<Episode>& ended) {
        const Timed timed(time_.replay);
        games_.take_in(actions, agent_, state_, ended);
    }

    void record(const Episode& episode) {
        episodes_.write(episode);
        ++state_.episodes;
        auto& recent = state_.recent_returns;
        recent.push_back(episode.episode_return);
        if (recent.size() > kRecentEpisodes) recent.erase(recent.begin());
        if (events_) {
            events_->write(episode.global_step,
                           {{"charts/episodic_return", episode.episode_return},
                            {"charts/episodic_length", static_cast<double>(episode.length)}});
        }
    }

    Progress progress() {
        return {.step = state_.step,
                .total_steps = config_.total_steps,
                .frame = state_.frame,
                .steps_per_second = speed_.read(state_.step, stopwatch_.seconds()),
                .episodes = state_.episodes,
                .mean_return = mean(state_.recent_returns),
                .values = shown_};
    }

    /// The steps since the last row. After the checkpoint, which does not count this row: a run that is
    /// resumed from it has the rows that it would have without the interruption.
    void report_the_rest() {
        if (state_.step <= progress_.last_step()) return;
        // TensorBoard cannot forget a value of the step that a run is resumed from.
        report(/*to_tensorboard=*/state_.step >= config_.total_steps);
        progress_.sync();
    }

    void report(bool to_tensorboard = true) {
        const double seconds = stopwatch_.seconds();
        const double steps_per_second = speed_.read(state_.step, seconds);
        auto metrics = newest_metrics();
        // Nothing was measured where a run is resumed at its end.
        for (const auto& [name, part] : TimeSplit::kParts)
            if (time_.total() > 0) metrics[fmt::format("time/{}", name)] = time_.*part / time_.total();
        time_ = {};
        shown_.clear();
        for (const auto* tag : {"losses/alpha", "charts/epsilon"}) {
            const auto found = metrics.find(tag);
            if (found != metrics.end()) shown_.emplace_back(fs::path(tag).filename(), found->second);
        }
        if (const auto recent = mean(state_.recent_returns)) metrics["charts/avg_episodic_return"] = *recent;
        progress_.write({.global_step = state_.step,
                         .frame = state_.frame,
                         .seconds = seconds,
                         .steps_per_second = steps_per_second,
                         .scalars = metrics});
        if (events_ && to_tensorboard) {
            metrics["charts/SPS"] = steps_per_second;
            events_->write(state_.step, metrics);
        }
        reported_ = progress();
        console_.report(reported_);
        speed_ = {state_.step, seconds};
    }

    /// A resumed agent knows those of its newest update only when it has made another.
    std::map<std::string, double> newest_metrics() {
        auto metrics = agent_.metrics();
        metrics.insert(state_.metrics.begin(), state_.metrics.end());
        check_finite(metrics, state_, options_.run_dir);
        return metrics;
    }

    void checkpoint() {
        checkpoints_.finish();
        state_.metrics = newest_metrics();
        episodes_.sync();
        progress_.sync();
        state_.seconds = stopwatch_.seconds();
        state_.episodes_offset = episodes_.offset();
        state_.progress_rows = progress_.rows();
        RunSnapshot snapshot{
            .state = state_, .agent = agent_.state(), .games = games_.state(), .config = options_.config};
        if (config_.save_replay && agent_.replay() != nullptr) snapshot.replay.emplace(*agent_.replay());
        checkpoints_.start(std::move(snapshot));
        written_step_ = state_.step;
        if (options_.checkpointed) options_.checkpointed();
    }

    /// One that an uninterrupted run writes, too, so that train.keep_best compares it.
    void scheduled_checkpoint() {
        const auto training_return = mean(state_.recent_returns);
        if (!state_.score && training_return && !evaluations_decide(config_, eval_))
            state_.score = {.evaluated = false, .mean_return = *training_return};
        checkpoint();
    }
    /// Writes the checkpoint of this step again, after an evaluation that came later than it did.
    void checkpoint_of_evaluation() {
        if (evaluations_decide(config_, eval_)) checkpoint();
    }

    /// Returns false where a signal has cut it off; the agent is then as it was before.
    bool run_evaluation() {
        if (eval_.episodes == 0) return true;
        const std::string name = fmt::format("step_{:09}", state_.step);
        const fs::path video = eval_.video ? options_.run_dir / "videos" / (name + ".mp4") : fs::path();
        if (eval_.video) fs::create_directories(video.parent_path());
        const fs::path csv = options_.run_dir / "eval" / (name + ".csv");
        const auto agent_before = options_.processes.single() ? agent_.state() : TensorMap();
        Evaluation result;
        try {
            result = evaluate(video);
        } catch (const Interrupted&) {
            state_.metrics = newest_metrics();
            agent_.load_state(agent_before);
            return false;
        }
        write_evaluation(csv, result);
        if (evaluations_decide(config_, eval_))
            state_.score = {.evaluated = true, .mean_return = result.mean_return};
        if (events_) events_->write(state_.step, {{"eval/episodic_return", result.mean_return}});
        console_.message(fmt::format(
            "Evaluation at agent step {}: mean return {:.1f} (standard deviation {:.1f}) over "
            "{} game{}; {}{}",
            state_.step, result.mean_return, result.standard_deviation, result.games.size(),
            result.games.size() == 1 ? "" : "s", csv.string(), eval_.video ? ", " + video.string() : ""));
        return true;
    }

    Evaluation evaluate(const fs::path& video) {
        // Other processes, which wait for the end of this, would not know that it was cut off.
        const auto decide = [this](const torch::Tensor& observations, std::span<const std::int64_t>) {
            if (options_.processes.single() && stop_requested()) throw Interrupted{};
            return Chosen{.actions = agent_.act(observations, ActMode::evaluate)};
        };
        auto env = env_config_;
        env.noop_max = eval_.noop_max;
        return cale::evaluate(decide, {.env = std::move(env),
                                       .games = eval_.episodes,
                                       .seed = derive_seed(static_cast<std::uint64_t>(config_.seed),
                                                           "evaluation at", state_.step),
                                       .stack_depth = GamesUnderWay::kStack,
                                       .video = video});
    }

    /// How the newest games went beside random play, and a line end; empty where no game has ended.
    std::string closing_line() const {
        const auto& all = state_.recent_returns;
        const std::vector newest(all.end() - std::min<std::ptrdiff_t>(std::ssize(all), kClosingEpisodes),
                                 all.end());
        const auto mean_return = mean(newest);
        if (!mean_return) return "";
        auto text = fmt::format("Mean return of the last {} game{} in training: {:.1f}", newest.size(),
                                newest.size() == 1 ? "" : "s", *mean_return);
        if (const auto floor = random_floor(env_config_)) {
            text += fmt::format(", {:.1f} {} than random play ({:.1f})", std::abs(*mean_return - *floor),
                                *mean_return < *floor ? "less" : "more", *floor);
        }
        return text + "\n";
    }

    void draw_curve() {
        const EpisodeHistory history = read_episodes(options_.run_dir / "episodes.csv");
        if (history.steps.empty()) return;
        const Game& game = find_game(env_config_.game);
        std::vector<ReferenceScore> references;
        if (const auto floor = random_floor(env_config_)) references.push_back({"random", *floor});
        if (game.human_score) references.push_back({"human", *game.human_score});
        const Picture picture =
            learning_curve(history, fmt::format("{} on {}", options_.agent_name, env_id_), references);
        for (const auto* name : {"learning_curve.svg", "learning_curve.png"}) {
            write_picture(picture, options_.run_dir / name);
        }
    }

    Agent& agent_;
    const EnvConfig& env_config_;
    const TrainConfig& config_;
    const EvalConfig& eval_;
    const LogConfig& log_;
    const TrainOptions& options_;
    Rhythm rhythm_;
    std::string env_id_;
    Console console_;
    GamesUnderWay games_;
    std::optional<Checkpoint> resumed_;
    RunState state_;
    Stopwatch stopwatch_;
    Speedometer speed_;
    TimeSplit time_;  // since the newest report
    EpisodeLog episodes_;
    ProgressLog progress_;
    std::optional<EventFile> events_;
    std::vector<std::pair<std::string, double>> shown_;
    Progress reported_;               // newest
    std::int64_t written_step_ = -1;  // of the newest checkpoint of this sitting
    CheckpointWriter checkpoints_;
};

}  // namespace

Outcome train(Agent& agent, const EnvConfig& env, const TrainConfig& config, const EvalConfig& eval,
              const LogConfig& log, const TrainOptions& options) {
    if (!options.processes.first()) return train_beside(agent, env, config, eval, log, options);
    return Run(agent, env, config, eval, log, options).train();
}

}  // namespace cale
