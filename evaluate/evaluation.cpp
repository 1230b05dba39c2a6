#include "evaluate/evaluation.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <stdexcept>
#include <utility>

#include <ATen/Parallel.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <torch/types.h>

#include "cale/games.h"
#include "cale/random_play.h"
#include "cale/seeds.h"
#include "evaluate/step_log.h"
#include "report/aggregate.h"
#include "report/scene.h"
#include "report/video.h"
#include "storage/files.h"

namespace cale {

namespace {

/// Films a game, one picture per agent step, at the game's own pace: its first minutes,
/// as a picture costs more than a step and a game may last half an hour.
class Film {
  public:
    Film(std::filesystem::path path, const EnvConfig& env, double minutes)
        : path_(std::move(path)),
          pictures_per_second_(60.0 / static_cast<double>(env.frame_skip)),
          most_pictures_(minutes * 60 * pictures_per_second_) {}

    void shoot(const Env& env, const Scene& scene) {
        if (++pictures_ > most_pictures_ && writer_) return;
        const Image image = compose_frame(env, scene);
        if (!writer_) writer_.emplace(path_, image.width, image.height, pictures_per_second_, 1);
        writer_->write(image.rgb);
    }
    void finish() { writer_->close(); }

  private:
    std::filesystem::path path_;
    double pictures_per_second_;
    double most_pictures_;
    double pictures_ = 0;
    std::optional<VideoWriter> writer_;
};

std::filesystem::path step_log_file(const EvaluationPlan& plan, std::int64_t number) {
    return plan.step_logs / fmt::format("game_{:04}.csv", number);
}

void count_step(EvaluatedGame& game, const StepResult& step) {
    if (!std::isfinite(step.reward))
        throw std::invalid_argument(fmt::format("the reward of an evaluation's game is {}", step.reward));
    ++game.rewards[step.reward];
    game.episode_return += step.reward;
    game.length += 1;
    game.frames += step.frames;
}

/// One game, from its beginning to its end.
class GameInPlay {
  public:
    GameInPlay(const EvaluationPlan& plan, std::int64_t number)
        : GameInPlay(plan, config_of(plan.env, number), number) {}

    std::int64_t number() const { return number_; }
    bool over() const { return over_; }
    const EvaluatedGame& result() const { return result_; }

    /// Writes the first observation to row `row` of the stack.
    void begin(FrameStack& stack, std::size_t row) {
        env_.reset(frame_);
        stack.clear(row);
        stack.push(row, frame_);
    }

    /// Carries out what was chosen for it, row `i`.
    void step(const Chosen& chosen, std::int64_t i, FrameStack& stack, std::size_t row) {
        StepCommand command;
        auto& joystick = command.stick;
        StepResult step;
        const bool at_random = epsilon_ > 0 && std::uniform_real_distribution<double>()(noise_) < epsilon_;
        if (env_.actions().empty()) {
            joystick =
                at_random ? random_stick(joystick_, noise_) : chosen_stick(joystick_, chosen.actions, i);
            step = env_.step(*joystick, frame_);
        } else {
            std::uniform_int_distribution<std::int64_t> any(0, std::ssize(env_.actions()) - 1);
            command.number = at_random ? any(noise_) : chosen.actions.const_data_ptr<std::int64_t>()[i];
            step = env_.step(command.number, frame_);
        }
        stack.follow(row, step, frame_);
        count_events(result_.events, step);
        count_step(result_, step);
        over_ = step.episode_over;
        if (log_) {
            log_->add(command, step, env_.stick());
            if (over_) log_->write();
        }
        if (!film_) return;
        film_->shoot(env_, {.observation = frame_,
                            .action = joystick,
                            .stick = env_.stick(),
                            .paddle = joystick_ == Joystick::paddle,
                            .threshold = threshold_,
                            .event = static_cast<Event>(step.event),
                            .episode_return = result_.episode_return,
                            .value = value_of(chosen, i)});
        if (over_) film_->finish();
    }

  private:
    /// `config`: of the plan's games the one that this number plays.
    GameInPlay(const EvaluationPlan& plan, const EnvConfig& config, std::int64_t number)
        : number_(number),
          epsilon_(plan.epsilon),
          threshold_(config.threshold),
          joystick_(coordinates(config)),
          env_(config, derive_seed(plan.seed, "evaluation", number)),
          noise_(derive_seed(plan.seed, "evaluation noise", number)),
          frame_(static_cast<std::size_t>(observation_space(config).frame_size())) {
        if (number == plan.filmed_game && !plan.video.empty())
            film_.emplace(plan.video, config, plan.film_minutes);
        if (games_of(plan.env.game).size() > 1) result_.game = only_game(config).name;
        if (!plan.step_logs.empty()) log_.emplace(step_log_file(plan, number));
    }

    static std::optional<double> value_of(const Chosen& chosen, std::int64_t i) {
        if (!chosen.values.defined()) return std::nullopt;
        return chosen.values.const_data_ptr<float>()[i];
    }

    std::int64_t number_;
    double epsilon_;
    double threshold_;
    Joystick joystick_;
    Env env_;
    std::mt19937 noise_;
    std::optional<Film> film_;
    std::optional<StepLog> log_;
    std::vector<std::uint8_t> frame_;
    EvaluatedGame result_;
    bool over_ = false;
};

using Games = std::vector<std::unique_ptr<GameInPlay>>;  // a row is free where there is none

/// Begins game numbers[i] in row rows[i] where that is free; in parallel, as an emulator takes a tenth of a
/// second to start.
void begin_games(const EvaluationPlan& plan, const std::vector<std::int64_t>& rows,
                 const std::vector<std::int64_t>& numbers, FrameStack& stack, Games& games) {
    at::parallel_for(0, std::ssize(rows), 1, [&](std::int64_t first, std::int64_t last) {
        for (auto i = static_cast<std::size_t>(first); i < static_cast<std::size_t>(last); ++i) {
            const auto row = static_cast<std::size_t>(rows[i]);
            if (games[row]) continue;
            games[row] = std::make_unique<GameInPlay>(plan, numbers[i]);
            games[row]->begin(stack, row);
        }
    });
}

/// On the CPU, contiguous, as many as there are games, of the kind that the action space wants.
Chosen checked(Chosen chosen, std::int64_t games, const ActionSpace& space) {
    auto& [actions, values] = chosen;
    const auto coordinates = box_size(space);
    const bool continuous = coordinates > 0;
    const auto wanted =
        continuous ? std::vector<std::int64_t>{games, coordinates} : std::vector<std::int64_t>{games};
    if (actions.sizes() != torch::IntArrayRef(wanted) ||
        actions.scalar_type() != (continuous ? torch::kFloat32 : torch::kInt64)) {
        throw std::invalid_argument(
            fmt::format("{} actions were expected, but got: {} {}", continuous ? "continuous" : "discrete",
                        c10::toString(actions.scalar_type()), fmt::join(actions.sizes(), " x ")));
    }
    actions = actions.cpu().contiguous();
    if (!values.defined()) return chosen;
    if (values.sizes() != torch::IntArrayRef{games})
        throw std::invalid_argument(
            fmt::format("{} values were expected, but got: {}", games, fmt::join(values.sizes(), " x ")));
    values = values.to(torch::kCPU, torch::kFloat32).contiguous();
    return chosen;
}

/// Which games of a plan are still to be begun.
class Schedule {
  public:
    explicit Schedule(const EvaluationPlan& plan) : plan_(plan) {}

    /// Returns the number of the next game to play, if there is one. Known games before it are put into
    /// `games`, which is then as long as the games begun.
    std::optional<std::int64_t> next(std::vector<EvaluatedGame>& games) {
        while (begun_ < plan_.games && steps_ < plan_.steps) {
            games.resize(static_cast<std::size_t>(begun_ + 1));
            const auto known = plan_.known.find(begun_++);
            if (known == plan_.known.end()) return begun_ - 1;
            steps_ += known->second.length;
            games.back() = known->second;
        }
        return std::nullopt;
    }

    void count_steps(std::int64_t steps) { steps_ += steps; }
    std::int64_t begun() const { return begun_; }
    std::int64_t steps() const { return steps_; }

  private:
    const EvaluationPlan& plan_;
    std::int64_t begun_ = 0, steps_ = 0;
};

/// How many of the games begun, in their order, have lasted `steps` agent steps together; all where they have
/// not yet.
std::int64_t games_of_steps(std::int64_t steps, const std::vector<EvaluatedGame>& ended,
                            const Games& under_way) {
    std::vector<std::int64_t> lengths;
    lengths.reserve(ended.size());
    for (const auto& game : ended) lengths.push_back(game.length);
    for (const auto& game : under_way)
        if (game) lengths[static_cast<std::size_t>(game->number())] = game->result().length;
    std::size_t count = 0;
    for (std::int64_t sum = 0; count < lengths.size() && sum < steps; ++count) sum += lengths[count];
    return static_cast<std::int64_t>(count);
}

/// Removes the step logs and the film of games that were begun and have no part in the evaluation; a film
/// that was interrupted stays.
void remove_dropped(const EvaluationPlan& plan, std::int64_t begun, const Evaluation& evaluation) {
    const auto games = std::ssize(evaluation.games);
    if (!plan.step_logs.empty())
        for (auto number = games; number < begun; ++number)
            std::filesystem::remove(step_log_file(plan, number));
    if (!plan.video.empty() && plan.filmed_game >= games && !evaluation.interrupted)
        std::filesystem::remove(plan.video);
}

void add_up(Evaluation& evaluation) {
    const auto n = static_cast<double>(evaluation.games.size());
    if (evaluation.games.empty()) return;
    for (const auto& game : evaluation.games) {
        evaluation.mean_return += game.episode_return;
        for (std::size_t i = 0; i < kEventCount; ++i) evaluation.events[i] += game.events[i];
        for (const auto& [reward, count] : game.rewards) evaluation.rewards[reward] += count;
    }
    evaluation.mean_return /= n;  // the sum of whole numbers is exact
    double squares = 0;
    for (const auto& game : evaluation.games)
        squares += std::pow(game.episode_return - evaluation.mean_return, 2);
    evaluation.standard_deviation = std::sqrt(squares / n);
}

}  // namespace

torch::Tensor stack_tensor(const FrameStack& stack, std::size_t num_envs, const ObservationSpace& space) {
    const auto shape = space.tensor_shape({static_cast<std::int64_t>(num_envs)});
    // LibTorch has no constant tensors; this one is never written through.
    return torch::from_blob(const_cast<std::uint8_t*>(stack.data().data()), shape, torch::kUInt8);
}

Actions view_of_actions(const torch::Tensor& actions) {
    const auto count = static_cast<std::size_t>(actions.numel());
    if (actions.scalar_type() == torch::kInt64)
        return std::span(actions.const_data_ptr<std::int64_t>(), count);
    return std::span(actions.const_data_ptr<float>(), count);
}

ContinuousAction chosen_stick(Joystick joystick, const torch::Tensor& actions, std::int64_t i) {
    if (joystick == Joystick::factored) return factored_stick(actions.const_data_ptr<std::int64_t>()[i]);
    const auto size = actions.size(1);
    return stick(joystick, {actions.const_data_ptr<float>() + size * i, static_cast<std::size_t>(size)});
}

EvaluationPlan fixed_episodes(const EnvConfig& env) {
    EvaluationPlan plan{.env = env, .games = 100, .parallel = 16, .epsilon = 0.001};
    plan.env.noop_max = 29;
    return plan;
}

EvaluationPlan fixed_steps(const EnvConfig& env) {
    return {.env = env, .games = kNoLimit, .steps = 125'000, .parallel = 16, .epsilon = 0.001};
}

Evaluation evaluate(const Decide& decide, const EvaluationPlan& plan) {
    const auto actions = action_space(plan.env);
    const auto rows =
        static_cast<std::size_t>(std::max(std::int64_t{1}, std::min(plan.parallel, plan.games)));
    const auto space = observation_space(plan.env);
    FrameStack stack(rows, static_cast<std::size_t>(space.stack),
                     static_cast<std::size_t>(space.frame_size()));
    const auto all_rows = stack_tensor(stack, rows, space);
    Games games(rows);

    Evaluation evaluation;
    Schedule schedule(plan);
    while (true) {
        std::vector<std::int64_t> active, numbers;
        bool some_begin = false;
        for (std::size_t row = 0; row < rows; ++row) {
            const auto number =
                games[row] ? std::optional(games[row]->number()) : schedule.next(evaluation.games);
            if (!number) continue;
            some_begin = some_begin || !games[row];
            active.push_back(static_cast<std::int64_t>(row));
            numbers.push_back(*number);
        }
        if (active.empty()) break;
        if (plan.stop && plan.stop()) {
            evaluation.interrupted = true;
            evaluation.games.resize(static_cast<std::size_t>(std::ranges::min(numbers)));
            games.clear();  // their films end
            break;
        }
        if (some_begin) begin_games(plan, active, numbers, stack, games);

        const auto count = std::ssize(active);
        const auto observations =
            active.size() == rows ? all_rows : all_rows.index_select(0, torch::tensor(active));
        const Chosen chosen = checked(decide(observations, numbers), count, actions);
        at::parallel_for(0, count, 1, [&](std::int64_t first, std::int64_t last) {
            for (std::int64_t i = first; i < last; ++i) {
                const auto row = static_cast<std::size_t>(active[static_cast<std::size_t>(i)]);
                games[row]->step(chosen, i, stack, row);
            }
        });
        schedule.count_steps(count);
        if (plan.stepped) plan.stepped(count);
        for (auto& game : games) {
            if (!game || !game->over()) continue;
            evaluation.games[static_cast<std::size_t>(game->number())] = game->result();
            if (plan.ended) plan.ended(game->number(), game->result());
            game.reset();
        }
        if (schedule.steps() < plan.steps) continue;
        // The games before these have lasted long enough, so that they would be dropped.
        const auto enough = games_of_steps(plan.steps, evaluation.games, games);
        for (auto& game : games)
            if (game && game->number() >= enough) game.reset();
    }
    evaluation.games.resize(static_cast<std::size_t>(games_of_steps(plan.steps, evaluation.games, games)));
    remove_dropped(plan, schedule.begun(), evaluation);
    add_up(evaluation);
    return evaluation;
}

Evaluation evaluate(const Decide& decide, const MakeWorld& make_world, const EvaluationPlan& plan) {
    Evaluation evaluation;
    for (std::int64_t number = 0; number < plan.games; ++number) {
        const auto seed_of_game = derive_seed(plan.seed, "evaluation", number);
        const auto world = make_world({&seed_of_game, 1});
        const auto space = world->observation_space();
        const auto action_space = world->action_space();
        std::vector<std::uint8_t> frame(static_cast<std::size_t>(space.frame_size())),
            last_frame(frame.size());
        FrameStack stack(1, static_cast<std::size_t>(space.stack), frame.size());
        world->reset(frame);
        stack.push(0, frame);
        EvaluatedGame game;
        for (StepResult step; !step.episode_over;) {
            if (plan.stop && plan.stop()) {
                evaluation.interrupted = true;
                add_up(evaluation);
                return evaluation;
            }
            const auto chosen =
                checked(decide(stack_tensor(stack, 1, space), {&number, 1}), /*games=*/1, action_space);
            world->step(view_of_actions(chosen.actions), frame, last_frame, {&step, 1});
            stack.follow(0, step, frame);
            count_step(game, step);
            if (plan.stepped) plan.stepped(1);
        }
        if (plan.ended) plan.ended(number, game);
        evaluation.games.push_back(std::move(game));
    }
    add_up(evaluation);
    return evaluation;
}

float reward_quantile(const std::map<float, std::int64_t>& rewards, double quantile) {
    std::int64_t steps = 0;
    for (const auto& [reward, count] : rewards) steps += count;
    if (steps == 0) throw std::invalid_argument("no rewards have no quantiles");
    std::int64_t up_to_here = 0;
    for (const auto& [reward, count] : rewards) {
        up_to_here += count;
        // 0.07 * 100 is more than 7.
        if (static_cast<double>(up_to_here) >= (quantile - 1e-12) * static_cast<double>(steps)) return reward;
    }
    return rewards.rbegin()->first;
}

void write_evaluation(const std::filesystem::path& csv, const Evaluation& evaluation) {
    const auto beside = [&csv](std::string_view name) {
        return csv.parent_path() / fmt::format("{}_{}.csv", csv.stem().string(), name);
    };
    const bool several =
        std::ranges::any_of(evaluation.games, [](const auto& game) { return !game.game.empty(); });
    std::string games = fmt::format("episode,return,length,frames{}\n", several ? ",game" : "");
    for (std::size_t i = 0; i < evaluation.games.size(); ++i) {
        const auto& game = evaluation.games[i];
        games += fmt::format("{},{},{},{}{}\n", i, game.episode_return, game.length, game.frames,
                             several ? ',' + game.game : "");
    }
    std::string rewards = "quantile,reward\n";
    for (int percent = 0; percent <= 100; ++percent) {
        const double quantile = percent / 100.0;
        rewards += fmt::format("{},{}\n", quantile, reward_quantile(evaluation.rewards, quantile));
    }
    if (csv.has_parent_path()) std::filesystem::create_directories(csv.parent_path());
    write_file_atomically(beside("events"), event_table(evaluation.events));
    write_file_atomically(beside("rewards"), rewards);
    write_file_atomically(csv, games);
}

ReturnSummary summarise(const Evaluation& evaluation, std::string_view game) {
    std::vector<double> returns;
    for (const auto& played : evaluation.games) returns.push_back(played.episode_return);
    if (returns.empty()) throw std::invalid_argument("no games cannot be summarised");
    std::ranges::sort(returns);
    const std::size_t n = returns.size(), quarter = n / 4;
    ReturnSummary summary{.mean = evaluation.mean_return,
                          .standard_deviation = evaluation.standard_deviation,
                          .median = (returns[(n - 1) / 2] + returns[n / 2]) / 2,
                          .minimum = returns.front(),
                          .maximum = returns.back()};
    for (std::size_t i = quarter; i < n - quarter; ++i)
        summary.interquartile_mean += returns[i] / static_cast<double>(n - 2 * quarter);
    const Game& scores = find_game(game);
    if (scores.human_score) summary.human_normalised = human_normalised(summary.mean, scores);
    return summary;
}

}  // namespace cale
