#include "train/recorder.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <iterator>

#include <fmt/format.h>

#include "cale/seeds.h"
#include "cale/text.h"
#include "evaluate/evaluation.h"
#include "evaluate/evaluation_progress.h"
#include "replay/replay.h"
#include "report/csv.h"
#include "report/learning_curve.h"
#include "storage/step_name.h"
#include "terminal/console.h"
#include "terminal/stop_signals.h"
#include "train/checkpoint_writer.h"
#include "train/dormant_units.h"
#include "train/event_file.h"
#include "train/resume.h"
#include "train/time_report.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr std::size_t kRecentEpisodes = 100;
constexpr std::ptrdiff_t kClosingEpisodes = 10;

/// Returns whether a multiple of `every` lies in (before, now]; never where it is 0.
bool passed(std::int64_t before, std::int64_t now, std::int64_t every) {
    return every > 0 && before / every != now / every;
}

/// A clock that continues where the last session stopped.
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

fs::path evaluation_file(const fs::path& run_dir, std::int64_t step) {
    return run_dir / "eval" / (step_name(step) + ".csv");
}

void check_finite(const std::map<std::string, double>& metrics, const RunState& state,
                  const fs::path& run_dir) {
    for (const auto& [name, value] : metrics) {
        if (std::isfinite(value)) continue;
        throw Diverged(
            fmt::format("{} became {} by agent step {}: training stopped, and the last checkpoint in {} is "
                        "from before; a lower agent.learning_rate is the usual remedy",
                        name, value, state.step, (run_dir / "checkpoints").string()));
    }
}

/// How many rows of progress.csv a resumed run keeps: where no step follows, also the last one, which
/// checkpoints do not count.
std::int64_t kept_rows(const RunState& state, const RunSettings& settings, const TrainOptions& options) {
    if (state.step < settings.train.total_steps) return state.progress_rows;
    return ProgressLog::rows_to(options.run_dir / "progress.csv", state.progress_rows, state.step);
}

}  // namespace

/// What the first process alone has.
struct Recorder::Files {
    Files(const RunState& state, const TrainingWorld& world, const RunSettings& settings,
          const TrainOptions& options, const Checkpoint* resumed)
        : console(stderr, options.progress_bar),
          stopwatch(state.seconds),
          speed{state.step, state.seconds},
          episodes(options.run_dir / "episodes.csv",
                   {.env_id = world.id,
                    .agent = options.agent_name,
                    .seed = static_cast<std::uint64_t>(settings.train.seed),
                    .games = world.games},
                   resumed != nullptr ? std::optional(state.episodes_offset) : std::nullopt),
          progress(options.run_dir / "progress.csv",
                   resumed != nullptr ? std::optional(kept_rows(state, settings, options)) : std::nullopt),
          checkpoints(options.run_dir,
                      {.newest = settings.train.keep_checkpoints,
                       .every = settings.train.keep_every,
                       .step_size = world.num_envs,
                       .best = settings.train.keep_best},
                      resumed != nullptr ? std::optional(resumed->stored) : std::nullopt) {
        policy_info = run_policy_info(world, settings, options);
        if (settings.log.tensorboard) {
            events.emplace(options.run_dir, resumed != nullptr ? std::optional(state.step) : std::nullopt);
            events->write_hyperparameters(options.hyperparameters);
        }
    }

    /// Returns what the console shows.
    Progress progress_at(const RunState& state, std::int64_t total_steps) const {
        return {.step = state.step,
                .total_steps = total_steps,
                .frame = state.frame,
                .steps_per_second = speed.read(state.step, stopwatch.seconds()),
                .learns = learns,
                .episodes = state.episodes,
                .mean_return = mean(state.recent_returns),
                .values = shown};
    }

    Console console;
    Stopwatch stopwatch;
    Speedometer speed;
    bool updated = false;  // whether there was an update in this session
    bool learns = false;   // whether there was one before the newest row: steps without are much faster
    EpisodeLog episodes;
    ProgressLog progress;
    CheckpointWriter checkpoints;
    std::optional<EventFile> events;
    std::optional<PolicyInfo> policy_info;  // of a world whose policies can be exported
    std::vector<std::pair<std::string, double>> shown;
    Progress reported;  // newest
};

Recorder::Recorder(Agent& agent, Collector& collector, RunState& state, const TrainingWorld& world,
                   const RunSettings& settings, const TrainOptions& options, const Checkpoint* resumed)
    : agent_(agent),
      collector_(collector),
      state_(state),
      world_(world),
      settings_(settings),
      options_(options),
      resumed_(resumed) {
    if (!options.processes.first()) return;
    // Before the other log is cut back: a run that is refused stays as it is.
    if (resumed != nullptr) ProgressLog::require(options.run_dir / "progress.csv", state.progress_rows);
    files_ = std::make_unique<Files>(state, world, settings, options, resumed);
    uncounted_rows_ = files_->progress.rows() - state.progress_rows;
    files_->reported = files_->progress_at(state, settings.train.total_steps);
}

Recorder::~Recorder() = default;

// When ------------------------------------------------------------------------------------

/// The processes synchronise where the first one has a row, an evaluation or a checkpoint to write, where
/// they pause, and at the end.
bool Recorder::synchronises(std::int64_t before) const {
    const auto& [train, eval, log] = settings_;
    const std::array periods{log.every, eval.every, train.checkpoint_every, train.keep_every};
    return state_.step >= train.total_steps || (reached_pause() && before < options_.until) ||
           std::ranges::any_of(periods, [&](auto period) { return passed(before, state_.step, period); });
}

/// Where it is not the last step.
bool Recorder::checkpoint_due(std::int64_t before) const {
    const auto& train = settings_.train;
    return passed(before, state_.step, train.checkpoint_every) ||
           passed(before, state_.step, train.keep_every) ||
           (evaluations_decide() && passed(before, state_.step, settings_.eval.every));
}

/// Whether train.keep_best compares evaluations. It compares training episodes where there are none, or only
/// the one at the end.
bool Recorder::evaluations_decide() const {
    return settings_.train.keep_best && settings_.eval.every > 0 && settings_.eval.episodes > 0;
}

bool Recorder::reached_pause() const {
    return options_.until > 0 && state_.step >= options_.until;
}

/// Several processes agree on it when they synchronise.
bool Recorder::agreed_to_stop(bool together) const {
    const bool stops = stop_requested() || reached_pause();
    if (options_.processes.single()) return stops;
    return together && options_.processes.any(stops);
}

// The run ---------------------------------------------------------------------------------

void Recorder::begin() {
    if (resumed_ != nullptr && files_) {
        for (const auto& sentence : resumed_->passed_over) files_->console.message(sentence + ".");
        if (!resumed_->passed_over.empty())
            files_->console.message(
                "Until the next checkpoint is written it is kept as checkpoints/step_*.damaged.");
        files_->console.message(fmt::format("Resumed at agent step {}.", state_.step));
        if (options_.resumed) options_.resumed(state_.seconds);
    }
    // So that a run can be resumed from its first step on, and remembers what was changed.
    if (resumed_ == nullptr || options_.changed) {
        write_checkpoint();
        // Before the first row, which without a checkpoint could not be resumed.
        if (files_ && resumed_ == nullptr) files_->checkpoints.finish();
    }
    if (state_.evaluation_due) {
        state_.evaluation_due = !run_evaluation();
        if (!state_.evaluation_due && evaluations_decide()) write_checkpoint();
    }
    stop_ = agreed_to_stop(/*together=*/true);
}

void Recorder::after_update() {
    if (files_) files_->updated = true;
}

void Recorder::after_step(std::int64_t before, std::vector<Episode>& ended) {
    const auto& [train, eval, log] = settings_;
    const bool together = synchronises(before);
    if (together) collector_.synchronise(state_, ended);
    state_.score.reset();
    for (const auto& episode : ended) write_episode(episode);
    ended.clear();
    if (passed(before, state_.step, log.every)) write_row(/*to_tensorboard=*/true);
    if (files_ && files_->console.due()) files_->console.draw(files_->progress_at(state_, train.total_steps));
    // In this order: a run that is killed in an evaluation repeats it.
    if (passed(before, state_.step, eval.every) && state_.step < train.total_steps) {
        const double evaluated = time.evaluation;
        state_.evaluation_due = !run_evaluation();
        time.log -= time.evaluation - evaluated;  // the caller times all of this as log
    }
    if (checkpoint_due(before)) write_scheduled_checkpoint();
    if (files_) files_->checkpoints.check();
    stop_ = agreed_to_stop(together);
}

/// Whether a longer run has an evaluation at this step, too.
bool Recorder::last_evaluation_due() const {
    const auto& eval = settings_.eval;
    return eval.episodes > 0 && passed(state_.step - world_.num_envs, state_.step, eval.every);
}

/// Whether the evaluation at this step was played, in this session or, as it would be now, in one before. A
/// run that was killed behind its last evaluation's checkpoint does not play that again, nor does one that
/// had ended.
bool Recorder::has_its_last_evaluation() const {
    const auto played = [this] {
        if (evaluated_step_ == state_.step) return true;
        if (resumed_ == nullptr || resumed_->state.step != state_.step || options_.evaluates_otherwise)
            return false;
        return (options_.finished || (state_.score && state_.score->evaluated)) &&
               fs::exists(evaluation_file(options_.run_dir, state_.step));
    };
    // The first process's word counts: it has the files.
    return options_.processes.single() ? played() : options_.processes.any(files_ && played());
}

Outcome Recorder::finish() {
    const bool complete = state_.step >= settings_.train.total_steps;
    const bool evaluated = has_its_last_evaluation();
    // An evaluation may be there already and be played again. Until it is, no checkpoint may hold its score:
    // a run that was killed in between would take it for played.
    const bool replays_evaluation = complete && !evaluated && state_.score && state_.score->evaluated;
    if (replays_evaluation) state_.score.reset();
    if (written_step_ != state_.step || replays_evaluation) {
        if (complete) {
            write_scheduled_checkpoint();
        } else {
            write_checkpoint();
        }
    }
    write_last_row();
    draw_curve();
    if (files_) files_->checkpoints.finish();
    if (!complete || (!evaluated && !run_last_evaluation(replays_evaluation))) {
        const bool paused = !complete && reached_pause() && !stop_requested();
        const bool was_there = paused && resumed_ != nullptr && resumed_->state.step > options_.until;
        if (files_)
            files_->console.message(fmt::format(
                "{} at agent step {}{}; resume with {}", paused ? "Paused" : "Interrupted", state_.step,
                was_there ? fmt::format(", where it was: --until {} is behind it", options_.until) : "",
                resume_options(options_.run_dir)));
        return paused ? Outcome::paused : Outcome::interrupted;
    }
    if (files_) {
        files_->checkpoints.finish();
        files_->console.finish(files_->reported, fmt::format("{}Results: {}", closing_line(),
                                                             printable(options_.run_dir.string())));
    }
    return Outcome::finished;
}

// Rows ------------------------------------------------------------------------------------

void Recorder::write_episode(const Episode& episode) {
    // What no reader of episodes.csv would take.
    if (!(std::abs(episode.episode_return) <= kHighestScore))
        throw std::runtime_error(fmt::format(
            "a game ended with a return of {}, of which none may be beyond {:g}: the world is at fault",
            episode.episode_return, kHighestScore));
    ++state_.episodes;
    auto& recent = state_.recent_returns;
    recent.push_back(episode.episode_return);
    if (recent.size() > kRecentEpisodes) recent.erase(recent.begin());
    if (!files_) return;
    files_->episodes.write(episode);
    if (!files_->events) return;
    std::map<std::string, double> scalars{{"charts/episodic_return", episode.episode_return},
                                          {"charts/episodic_length", static_cast<double>(episode.length)}};
    if (!world_.games.empty())
        scalars["charts/episodic_return/" + game_of(world_.games, episode.env)] = episode.episode_return;
    files_->events->write(episode.global_step, scalars);
}

/// The steps since the last row. Checkpoints do not count it: a run that is resumed from one has the rows
/// that it would have without the interruption.
void Recorder::write_last_row() {
    if (!files_ || state_.step <= files_->progress.last_step()) return;
    const auto reported = state_.reported_events;
    // TensorBoard cannot forget a value of the step that a run is resumed from.
    write_row(/*to_tensorboard=*/state_.step >= settings_.train.total_steps);
    state_.reported_events = reported;
    uncounted_rows_ = 1;
    files_->progress.sync();
}

void Recorder::write_row(bool to_tensorboard) {
    if (!files_) return;
    const double seconds = files_->stopwatch.seconds();
    const double steps_per_second = files_->speed.read(state_.step, seconds);
    update_metrics();
    auto metrics = state_.metrics;
    // Nothing was measured where a run is resumed at its end.
    const double all_parts = total_seconds(time);
    for (const auto& [name, part] : kTimeParts)
        if (all_parts > 0) metrics[fmt::format("time/{}", name)] = time.*part / all_parts;
    time = {};
    if (std::any_of(std::next(state_.joystick_events.begin()), state_.joystick_events.end(),
                    std::identity())) {
        for (const auto& [zone, share] : zone_shares(state_.reported_events, state_.joystick_events))
            metrics["zones/" + zone] = share;
    }
    state_.reported_events = state_.joystick_events;
    const auto seed = static_cast<std::uint64_t>(settings_.train.seed);
    if (const auto share = dormant_share(agent_, derive_seed(seed, "dormant units at", state_.step)))
        metrics["charts/dormant_units"] = *share;
    files_->shown.clear();
    for (const auto& [tag, name] :
         {std::pair{"losses/alpha", "alpha"}, std::pair{"charts/epsilon", "epsilon"}}) {
        const auto found = metrics.find(tag);
        if (found != metrics.end()) files_->shown.emplace_back(name, found->second);
    }
    if (const auto recent = mean(state_.recent_returns)) metrics["charts/avg_episodic_return"] = *recent;
    files_->progress.write({.global_step = state_.step,
                            .frame = state_.frame,
                            .seconds = seconds,
                            .steps_per_second = steps_per_second,
                            .scalars = metrics});
    if (files_->events && to_tensorboard) {
        metrics["charts/SPS"] = steps_per_second;
        files_->events->write(state_.step, metrics);
    }
    files_->reported = files_->progress_at(state_, settings_.train.total_steps);
    files_->console.report(files_->reported);
    files_->speed = {state_.step, seconds};
    files_->learns = files_->updated;
}

/// Until a resumed agent has made an update, those of the checkpoint stay, and behind an evaluation that
/// leaves the agent as it was, and so without metrics, those of its last update.
void Recorder::update_metrics() {
    auto metrics = agent_.metrics();
    const auto is_loss = [](const auto& metric) { return metric.first.starts_with("losses/"); };
    const bool updated = std::ranges::any_of(metrics, is_loss);
    metrics.merge(collector_.metrics());
    if (!updated) metrics.insert(state_.metrics.begin(), state_.metrics.end());
    check_finite(metrics, state_, options_.run_dir);
    state_.metrics = std::move(metrics);
}

// Checkpoints -----------------------------------------------------------------------------

/// None of a world or an agent whose policies are not exported.
std::optional<PolicySnapshot> Recorder::policy_snapshot() const {
    if (!files_->policy_info) return std::nullopt;
    auto policy = agent_.policy();
    if (!policy) return std::nullopt;
    PolicySnapshot snapshot{std::move(*policy), *files_->policy_info};
    auto& origin = snapshot.info.provenance;
    origin["agent_steps"] = std::to_string(state_.step);
    origin["frames"] = std::to_string(state_.frame);
    return snapshot;
}

/// All processes call it: the first one's checkpoints hold the state of all.
void Recorder::write_checkpoint() {
    written_step_ = state_.step;
    if (!files_) {
        agent_.state();
        collector_.state();
        return;
    }
    const Collector::Pause pause(collector_);
    files_->checkpoints.finish();
    update_metrics();
    files_->episodes.sync();
    files_->progress.sync();
    state_.seconds = files_->stopwatch.seconds();
    state_.episodes_offset = files_->episodes.offset();
    state_.progress_rows = files_->progress.rows() - uncounted_rows_;
    RunSnapshot snapshot{
        .state = state_, .agent = agent_.state(), .games = collector_.state(), .config = options_.config};
    snapshot.policy = policy_snapshot();
    if (settings_.train.save_replay && agent_.replay() != nullptr) snapshot.replay.emplace(*agent_.replay());
    files_->checkpoints.start(std::move(snapshot));
    if (options_.checkpointed) options_.checkpointed();
}

/// One that an uninterrupted run writes, too, so that train.keep_best compares it.
void Recorder::write_scheduled_checkpoint() {
    const auto training_return = mean(state_.recent_returns);
    if (!state_.score && training_return && !evaluations_decide())
        state_.score = {.evaluated = false, .mean_return = *training_return};
    // So that this run, if it is made longer, plays an evaluation that is cut off at its end.
    if (state_.step >= settings_.train.total_steps)
        state_.evaluation_due = last_evaluation_due() && !(state_.score && state_.score->evaluated);
    write_checkpoint();
}

// Evaluations -----------------------------------------------------------------------------

/// Returns false where a signal has cut it off; the agent is then as it was before.
bool Recorder::run_evaluation() {
    const auto& eval = settings_.eval;
    if (eval.episodes == 0) return true;
    const Collector::Pause pause(collector_);
    // The other processes wait for the end of this; they would not know that it was cut off.
    const bool interruptible = options_.processes.single();
    Evaluation result;
    const std::string name = step_name(state_.step);
    const bool films = eval.video && world_.can_film;
    const fs::path video = films ? options_.run_dir / "videos" / (name + ".mp4") : fs::path();
    if (files_) {
        if (films) fs::create_directories(video.parent_path());
        const auto agent_before = interruptible ? agent_.state() : TensorMap();
        const auto decide = [&](const torch::Tensor& observations, std::span<const std::int64_t>) {
            return Chosen{.actions = agent_.act(observations, ActMode::evaluate)};
        };
        const auto seed = static_cast<std::uint64_t>(settings_.train.seed);
        EvaluationPlan plan{
            .games = eval.episodes, .seed = derive_seed(seed, "evaluation at", state_.step), .video = video};
        if (interruptible) plan.stop = stop_requested;
        const EvaluationProgress progress(files_->console, plan, "evaluation", /*lines=*/false);
        const double begun = files_->stopwatch.seconds();
        result = world_.evaluate(decide, plan);
        const double played = files_->stopwatch.seconds() - begun;
        time.evaluation += played;
        files_->speed.seconds += played;  // it makes no agent steps of the run
        if (result.interrupted) {
            update_metrics();
            agent_.load_state(agent_before);
            return false;
        }
    }
    evaluated_step_ = state_.step;
    if (eval.every > 0) state_.score = {.evaluated = true, .mean_return = result.mean_return};
    if (!files_) return true;
    const fs::path csv = evaluation_file(options_.run_dir, state_.step);
    write_evaluation(csv, result);
    if (files_->events) files_->events->write(state_.step, {{"eval/episodic_return", result.mean_return}});
    files_->console.message(fmt::format(
        "Evaluation at agent step {}: mean return {:.1f} (standard deviation {:.1f}) over {}; {}{}",
        state_.step, result.mean_return, result.standard_deviation, counted(result.games.size(), "game"),
        csv.string(), films ? ", " + video.string() : ""));
    return true;
}

/// The evaluation at the end, behind the last checkpoint, which is written once more with its score and what
/// it drew. `replays_evaluation`: it was played before, and what it drew then stays. Returns false where a
/// signal has cut it off.
bool Recorder::run_last_evaluation(bool replays_evaluation) {
    // A longer run would have no evaluation here where none is due: what it draws must not change the agent.
    const bool due = last_evaluation_due();
    const bool restores_agent = replays_evaluation || (!due && evaluations_decide());
    const auto agent_before = restores_agent ? agent_.state() : TensorMap();
    if (!run_evaluation()) return false;
    if (restores_agent && files_) agent_.load_state(agent_before);  // the other processes have played nothing
    state_.evaluation_due = false;
    if (due || evaluations_decide()) write_checkpoint();
    return true;
}

// The end ---------------------------------------------------------------------------------

/// How the newest games went beside random play, and a line end; empty where no game has ended.
std::string Recorder::closing_line() const {
    const auto& all = state_.recent_returns;
    const std::vector newest(all.end() - std::min<std::ptrdiff_t>(std::ssize(all), kClosingEpisodes),
                             all.end());
    const auto mean_return = mean(newest);
    if (!mean_return) return "";
    auto text = fmt::format("Mean return of the last {} in training: {:.1f}", counted(newest.size(), "game"),
                            *mean_return);
    if (const auto floor = world_.random_score) {
        // The difference of the numbers as they are shown.
        const auto shown = [](double value) { return std::round(10 * value) / 10; };
        const double more = shown(*mean_return) - shown(*floor);
        text += fmt::format(", {:.1f} {} than random play ({:.1f})", std::abs(more),
                            more < 0 ? "less" : "more", *floor);
    }
    return text + "\n";
}

void Recorder::draw_curve() const {
    if (!files_) return;
    const EpisodeHistory history = read_episodes(options_.run_dir / "episodes.csv");
    if (history.steps.empty()) return;
    std::vector<ReferenceScore> references;
    if (world_.random_score) references.push_back({"random", *world_.random_score});
    if (world_.human_score) references.push_back({"human", *world_.human_score});
    const Picture picture =
        learning_curve(history, fmt::format("{} on {}", options_.agent_name, world_.id), references);
    for (const auto* name : {"learning_curve.svg", "learning_curve.png"}) {
        write_picture(picture, options_.run_dir / name);
    }
}

}  // namespace cale
