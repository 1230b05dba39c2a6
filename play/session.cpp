#include "play/session.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include <fmt/format.h>

#include "cale/games.h"
#include "cale/joystick.h"
#include "cale/real_time.h"
#include "cale/seeds.h"
#include "report/video.h"

namespace cale {
namespace {

using Clock = std::chrono::steady_clock;

/// Waits so that steps come at an even pace.
class Metronome {
  public:
    explicit Metronome(double beats_per_second) : beats_per_second_(beats_per_second) {}
    /// The next beat is one later than this, or now.
    void begin() {
        if (beats_per_second_ <= 0) return;
        // A slower beat would leave the clock's range.
        const std::chrono::duration<double> beat(std::min(1 / beats_per_second_, 3600.0));
        next_ += std::chrono::duration_cast<Clock::duration>(beat);
        next_ = std::max(next_, Clock::now());  // what was missed is not made up for
    }
    /// Waits for the beat, at most kPollInterval. Returns whether it has come.
    bool wait() const {
        if (beats_per_second_ <= 0) return true;
        std::this_thread::sleep_until(std::min(next_, Clock::now() + kPollInterval));
        return Clock::now() >= next_;
    }
    /// The player's input is read at least so often.
    static constexpr std::chrono::milliseconds kPollInterval{16};

  private:
    double beats_per_second_;
    Clock::time_point next_ = Clock::now();
};

/// The player's view and commands.
class Show {
  public:
    Show(const PlayPlan& plan, const Stage& stage)
        : plan_(plan),
          stage_(stage),
          name_(only_game(plan.env).name),
          pictures_per_second_(60.0 / static_cast<double>(plan.env.frame_skip)),
          metronome_(plan.real_time ? 0 : pictures_per_second_ * plan.speed) {}

    /// Where the player holds the stick now.
    ContinuousAction stick() {
        const auto asked = take_joystick(hands_);
        if (plan_.env.paddle != Paddle::absolute) return asked;
        // A knob stays where it is left; keys turn it as fast as ALE turns a paddle.
        const double x = asked.radius * std::cos(asked.theta);
        knob_ = hands_.pointer
                    ? paddle_position(x)
                    : std::clamp(knob_ + kKnobTurn * static_cast<double>(plan_.env.frame_skip) * x, 0.0, 1.0);
        return cale::stick(Joystick::paddle, std::array{static_cast<float>(knob_), asked.fire});
    }

    /// Shows and films a moment of a game, then waits for the next one; while the game is paused, until it is
    /// continued.
    Command present(const Env& env, const Scene& scene) { return present(compose_frame(env, scene), scene); }
    /// `times`: so often in a film.
    Command present(const Image& picture, const Scene& scene, std::int64_t times = 1) {
        if (!plan_.video.empty()) {
            if (!film_) film_.emplace(plan_.video, picture.width, picture.height, pictures_per_second_, 1);
            for (std::int64_t i = 0; i < times; ++i) film_->write(picture.rgb);
        }
        bool paused = false;
        while (true) {
            if (stage_.show) {
                stage_.show(picture, fmt::format("{}: return {:.10g}{}", name_, scene.episode_return,
                                                 paused ? " (paused: P continues)" : ""));
            }
            // Where the metronome does not wait, keys are still asked for no faster than 60 times a second.
            if (paused && plan_.speed <= 0) std::this_thread::sleep_for(Metronome::kPollInterval);
            const Command command = wait_for_beat();
            if (command == Command::pause && !plan_.real_time) paused = !paused;
            if (command == Command::quit || command == Command::new_game) return command;
            if (!paused) return Command::none;
        }
    }

    void finish() {
        if (film_) film_->close();
    }

  private:
    /// The command that was given meanwhile ends the wait.
    Command wait_for_beat() {
        metronome_.begin();
        while (true) {
            const bool beat = metronome_.wait();
            const Command command = stage_.poll ? stage_.poll(hands_) : Command::none;
            if (beat || command != Command::none) return command;
        }
    }

    static constexpr double kKnobTurn = 0.03;  // of its whole way, in a frame

    const PlayPlan& plan_;
    const Stage& stage_;
    std::string name_;
    double pictures_per_second_;
    Metronome metronome_;
    Hands hands_;
    double knob_ = 0.5;
    std::optional<VideoWriter> film_;
};

Scene scene_of(const EnvConfig& env, std::span<const std::uint8_t> observation) {
    return {.observation = observation, .paddle = env.paddle == Paddle::absolute, .threshold = env.threshold};
}

/// What `decide` chooses, contiguous. `scene` gets its value and, where it is the joystick, the action.
torch::Tensor choose(const PlayPlan& plan, const FrameStack& stack, std::int64_t number, Scene& scene) {
    const Chosen chosen = plan.decide(stack_tensor(stack, 1, observation_space(plan.env)), {&number, 1});
    auto actions = chosen.actions.contiguous();
    if (chosen.values.defined()) scene.value = chosen.values[0].item<double>();
    if (plan.env.action_space == ActionSet::continuous)
        scene.action = chosen_stick(coordinates(plan.env), actions, 0);
    return actions;
}

/// Counts what a step brought.
void count(EvaluatedGame& game, Scene& scene, const StepResult& result) {
    game.episode_return += result.reward;
    game.length += 1;
    game.frames += result.frames;
    scene.event = static_cast<Event>(result.event);
    scene.episode_return = game.episode_return;
}

/// Plays one game. Returns the command by which the player broke it off; of a game that ended by itself quit,
/// if that was given at its last step, else none.
Command play_game(const PlayPlan& plan, Env& env, std::int64_t number, Show& show) {
    const auto space = observation_space(plan.env);
    std::vector<std::uint8_t> frame(static_cast<std::size_t>(space.frame_size()));
    FrameStack stack(1, static_cast<std::size_t>(space.stack), frame.size());
    env.reset(frame);
    stack.push(0, frame);
    EvaluatedGame game;
    Scene scene = scene_of(plan.env, frame);
    Command command = Command::none;
    for (StepResult result; !result.episode_over;) {
        if (plan.decide) {
            const auto actions = choose(plan, stack, number, scene);
            if (!scene.action) result = env.step(actions.const_data_ptr<std::int64_t>()[0], frame);
        } else {
            scene.action = show.stick();
        }
        if (scene.action) result = env.step(*scene.action, frame);
        stack.follow(0, result, frame);
        count(game, scene, result);
        scene.stick = env.stick();
        command = show.present(env, scene);
        if (plan.stepped) plan.stepped(game);
        if (command != Command::none && !result.episode_over) return command;
    }
    if (plan.ended) plan.ended(game);
    return command == Command::quit ? command : Command::none;
}

/// What the console's thread showed last.
class Screen {
  public:
    void watch(const Env& env) {
        const std::lock_guard lock(mutex_);
        env.screen_rgb(newest_);
        stick_ = env.stick();
        width_ = env.screen_width();
        height_ = env.screen_height();
    }
    /// `scene` with what there is to see now.
    Image picture(Scene scene) {
        {
            const std::lock_guard lock(mutex_);
            shown_ = newest_;
            scene.stick = stick_;
            scene.screen_width = width_;
            scene.screen_height = height_;
        }
        scene.screen = shown_;
        return compose_frame(scene);
    }

  private:
    std::mutex mutex_;  // of what the console's thread writes
    std::vector<std::uint8_t> newest_;
    std::optional<StickPosition> stick_;
    int width_ = 0, height_ = 0;
    std::vector<std::uint8_t> shown_;
};

/// Tells the game what `decide`, or the player, wants. Returns what came of it.
StepResult step_in_real_time(const PlayPlan& plan, RealTimeGame& game, const FrameStack& stack,
                             std::int64_t number, Show& show, std::span<std::uint8_t> frame,
                             std::span<std::uint8_t> last_frame, Scene& scene) {
    StepResult result;
    if (!plan.decide) {
        scene.action = show.stick();
        const bool paddle = plan.env.paddle == Paddle::absolute;
        const auto stick = coordinates_of(paddle ? Joystick::paddle : Joystick::polar, *scene.action);
        game.step(std::span<const float>(stick), frame, last_frame, {&result, 1});
        return result;
    }
    const auto actions = choose(plan, stack, number, scene);
    game.step(view_of_actions(actions), frame, last_frame, {&result, 1});
    return result;
}

RealTimeCounts play_in_real_time(const PlayPlan& plan, Show& show) {
    auto env = plan.env;
    if (!plan.decide) env.joystick = Joystick::polar;  // the player's
    const auto seed = derive_seed(plan.seed, "play", 0);
    Screen screen;
    RealTimeGame game(env, seed, console_clock(), [&screen](const Env& now) { screen.watch(now); });
    const auto space = observation_space(env);
    std::vector<std::uint8_t> frame(static_cast<std::size_t>(space.frame_size())), last_frame(frame.size());
    FrameStack stack(1, static_cast<std::size_t>(space.stack), frame.size());
    game.reset(frame);
    stack.push(0, frame);
    RealTimeCounts counts;
    std::int64_t filmed = 0;  // pictures
    Scene scene = scene_of(env, frame);
    EvaluatedGame so_far;
    for (std::int64_t number = 0; number < plan.games;) {
        const auto result = step_in_real_time(plan, game, stack, number, show, frame, last_frame, scene);
        stack.follow(0, result, frame);
        counts.frames += result.frames;
        count(so_far, scene, result);
        // So that a film is as long as the games.
        const auto pictures = counts.frames / env.frame_skip - filmed;
        filmed += pictures;
        const bool quits = show.present(screen.picture(scene), scene, pictures) == Command::quit;
        if (plan.stepped) plan.stepped(so_far);
        if (result.episode_over) {
            if (plan.ended) plan.ended(so_far);
            so_far = {};
            ++number;
        }
        if (quits) break;
    }
    const auto metrics = game.metrics();
    counts.missed_frames = static_cast<std::int64_t>(metrics.at("realtime/missed_frames"));
    counts.late_frames = static_cast<std::int64_t>(metrics.at("realtime/late_frames"));
    return counts;
}

}  // namespace

RealTimeCounts play(const PlayPlan& plan, const Stage& stage) {
    Show show(plan, stage);
    if (plan.real_time) {
        const auto counts = play_in_real_time(plan, show);
        show.finish();
        return counts;
    }
    Env env(plan.env, derive_seed(plan.seed, "play", 0));
    std::int64_t ended = 0;  // those that the player did not restart
    for (std::int64_t number = 0; ended < plan.games; ++number) {
        const auto command = play_game(plan, env, number, show);
        if (command == Command::quit) break;
        if (command == Command::none) ++ended;
    }
    show.finish();
    return {};
}

PictureSize picture_size(const EnvConfig& env) {
    Env world(env, /*seed=*/0);
    std::vector<std::uint8_t> frame(static_cast<std::size_t>(observation_space(env).frame_size()));
    world.reset(frame);
    const Image picture = compose_frame(world, {.observation = frame});
    return {.width = picture.width, .height = picture.height, .dial = joystick_dial(world.screen_width())};
}

}  // namespace cale
