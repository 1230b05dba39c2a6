#include <cerrno>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "cale/games.h"
#include "cale/text.h"
#include "evaluate/policy_evaluation.h"
#include "play/session.h"
#include "play/window.h"
#include "settings/config.h"
#include "terminal/console.h"
#include "terminal/exit_code.h"
#include "terminal/stop_signals.h"
#include "tools/commands.h"
#include "tools/usage.h"
#include "train/export.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

struct Options {
    std::string game;
    std::string policy;
    std::optional<double> threshold;
    std::vector<std::string> settings;
    std::string video;
    bool no_window = false;
    bool real_time = false;
    std::int64_t games = 0;
    double speed = 1;
    bool greedy = false;
    bool sampled = false;
    std::uint64_t seed = 1;
};

/// A person sees every frame and plays without sticky actions, unless configured otherwise.
EnvConfig for_hands() {
    EnvConfig env;
    env.frame_skip = 1;
    env.sticky_probability = 0;
    return env;
}

PlayPlan plan_of(const Options& options) {
    PlayPlan plan{.seed = options.seed, .speed = options.speed, .real_time = options.real_time};
    if (options.games > 0) plan.games = options.games;
    std::optional<Policy> policy;
    if (!options.policy.empty()) policy = policy_of(options.policy);
    plan.env = policy ? env_config_of(policy->info()) : for_hands();
    for (const auto& setting : options.settings) {
        if (!options.game.empty() && setting.starts_with("env.game="))
            throw ConfigError(fmt::format("--set {}: the game is given as {}; leave one of them out", setting,
                                          options.game));
        if (options.threshold && setting.starts_with("env.threshold="))
            throw ConfigError(fmt::format("--set {}: there is --threshold {}; leave one of them out", setting,
                                          *options.threshold));
    }
    if (options.game.find_first_of("/.") != options.game.npos && fs::exists(options.game))
        throw ConfigError(fmt::format("{0} is no game; a policy is given by --policy {0}", options.game));
    if (!options.game.empty()) plan.env.game = options.game;
    if (options.threshold) plan.env.threshold = *options.threshold;
    set_environment(plan.env, options.settings);
    plan.env.game = only_game(plan.env).rom;
    check_roms(plan.env);
    if (!policy) {
        if (plan.env.action_space != ActionSet::continuous)
            throw ConfigError(
                fmt::format("--set env.action_space={}: keys and mouse move the continuous joystick; "
                            "leave it out, or give a --policy that chooses so",
                            name_of(plan.env.action_space)));
        return plan;
    }
    if (const auto kept = keep_life_loss(policy->info(), plan.env); !kept.empty())
        std::fputs(fmt::format("cale play: {}\n", kept).c_str(), stderr);
    require_playable(policy->info(), plan.env);
    if (options.sampled && !can_sample(*policy))
        std::fputs(fmt::format("cale play: {}\n", kDrawsNothing).c_str(), stderr);
    plan.decide = decide_by(*policy, draws_actions(*policy, options.sampled, options.greedy), options.seed);
    return plan;
}

/// A film's file, removed where nothing was filmed to it.
struct FilmFile {
    fs::path path{};

    FilmFile() = default;
    FilmFile(const FilmFile&) = delete;
    FilmFile& operator=(const FilmFile&) = delete;
    ~FilmFile() {
        std::error_code ignored;
        if (!path.empty() && !is_filmed()) fs::remove(path, ignored);
    }
    bool is_filmed() const {
        std::error_code ignored;
        return fs::exists(path, ignored) && !fs::is_empty(path, ignored);
    }
};

/// Makes the file, so that no other program can film to it meanwhile. Returns whether there was none.
bool make_new(const fs::path& file) {
    const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor >= 0) return ::close(descriptor) == 0;
    if (errno == EEXIST) return false;
    throw std::system_error(errno, std::generic_category(), fmt::format("cannot film to {}", file.string()));
}

/// A film must be able to come, before anything is played for it.
fs::path new_film(const fs::path& video) {
    if (video.extension() != ".mp4")
        throw ConfigError(fmt::format("--video {}: its name must end in .mp4", video.string()));
    check_output_file("--video", video);
    if (!make_new(video))
        throw ConfigError(fmt::format(
            "--video {}: there is such a file already; give another name, or delete it", video.string()));
    return video;
}

/// play_pong.mp4, or play_pong_2.mp4 where there is one already, and so on.
fs::path new_film_of(const std::string& game) {
    fs::path film = fmt::format("play_{}.mp4", game);
    check_output_file("--video", film);
    for (int number = 2; !make_new(film); ++number) film = fmt::format("play_{}_{}.mp4", game, number);
    return film;
}

/// None where the user wants none, or there is no display and a film will do.
std::unique_ptr<Window> open_window(const Options& options, PlayPlan& plan) {
    const bool by_hand = !plan.decide;
    if (by_hand && options.no_window)
        throw ConfigError("--no-window: keys need a window; give --policy FILE to film a policy");
    if (!options.no_window) {
        const PictureSize size = picture_size(plan.env);
        try {
            return std::make_unique<Window>(size.width, size.height, size.dial);
        } catch (const std::runtime_error& error) {
            if (by_hand) {
                throw std::runtime_error(
                    fmt::format("{}; to film a policy without a window give --policy FILE", error.what()));
            }
            std::fputs(fmt::format("cale play: {}; filming instead\n", error.what()).c_str(), stderr);
        }
    }
    if (options.games == 0) plan.games = 1;
    plan.speed = 0;
    return nullptr;
}

/// The progress of a film. The length of its first game is unknown.
class FilmProgress {
  public:
    explicit FilmProgress(const PlayPlan& plan) {
        if (plan.games < kNoLimit) progress_.total_games = plan.games;
    }
    void step(const EvaluatedGame& game) {
        ++progress_.steps;
        progress_.values = {{"return so far", game.episode_return}};
    }
    void end(const EvaluatedGame& game) {
        const auto before = static_cast<double>(progress_.games++);
        const auto games = static_cast<double>(progress_.games);
        const auto mean = [&](double old, double value) { return (old * before + value) / games; };
        progress_.mean_return = mean(progress_.mean_return.value_or(0), game.episode_return);
        progress_.mean_length = mean(progress_.mean_length, static_cast<double>(game.length));
    }
    GamesProgress now() {
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start_;
        progress_.steps_per_second = static_cast<double>(progress_.steps) / seconds.count();
        return progress_;
    }

  private:
    GamesProgress progress_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Returns the exit code.
int run(const Options& options) {
    if (options.game.empty() && options.policy.empty())
        throw ConfigError("give a GAME, a --policy FILE, or both");
    FilmFile film;
    if (!options.video.empty()) film.path = new_film(options.video);
    PlayPlan plan = plan_of(options);
    const StopSignals signals;  // end the session as a closed window does, so that the film is finished
    const auto window = open_window(options, plan);
    if (!window && film.path.empty()) film.path = new_film_of(plan.env.game);
    plan.video = film.path;
    Stage stage;
    stage.poll = [&](Hands& hands) {
        if (stop_requested()) return Command::quit;
        return window ? window->poll(hands) : Command::none;
    };
    if (window) {
        if (!plan.decide) std::fputs(keyboard_help(!options.real_time).c_str(), stdout);
        stage.show = [&](const Image& picture, const std::string& title) { window->show(picture, title); };
    }
    Console console(stderr);
    FilmProgress progress(plan);
    if (!window) {
        plan.stepped = [&](const EvaluatedGame& game) {
            progress.step(game);
            if (console.due()) console.draw(progress.now());
        };
    }
    plan.ended = [&](const EvaluatedGame& game) {
        progress.end(game);
        console.clear();
        std::fputs(
            fmt::format("return {:.10g} after {} agent steps\n", game.episode_return, game.length).c_str(),
            stdout);
        std::fflush(stdout);
    };
    const auto counts = play(plan, stage);
    console.clear();
    if (plan.real_time) {
        std::fputs(fmt::format("{} frames; {} of them were played while an observation had not been looked "
                               "at; the console was {} frames behind its clock\n",
                               counts.frames, counts.missed_frames, counts.late_frames)
                       .c_str(),
                   stdout);
    }
    if (film.is_filmed()) std::fputs(fmt::format("{}\n", printable(film.path.string())).c_str(), stdout);
    if (!stop_requested()) return kDone;
    std::fputs(fmt::format("cale play: ended by {} before the game did\n", stop_signal()).c_str(), stderr);
    return kInterrupted;
}

}  // namespace

void add_play(CLI::App& app, int& exit_code) {
    auto& command =
        *app.add_subcommand("play",
                            "Shows a game in a window: a trained policy plays it, or you do, with the "
                            "continuous joystick. Where there is no display, a policy is filmed.");
    const auto options = std::make_shared<Options>();
    command
        .add_option("GAME", options->game, "pong, Pong or ALE/Pong-v5; the policy's own if it is left out")
        ->type_name("GAME");
    auto* policy = command
                       .add_option("--policy", options->policy,
                                   "who plays: a policy file, a checkpoint's folder, or a run's; else you")
                       ->type_name("FILE");
    command
        .add_option("--threshold", options->threshold,
                    "tau: how far the joystick must be pushed to count, as a part of its radius")
        ->transform(numbers(0, 1))
        ->type_name("X");
    command
        .add_option("--set", options->settings,
                    "change a setting of the environment, as in train_*; else it is the policy's, or, for "
                    "you, every frame a step and no sticky actions")
        ->allow_extra_args(false)
        ->take_all()
        ->type_name("KEY=VALUE");
    command
        .add_option(
            "--video", options->video,
            "film all that is shown, to this .mp4 file, which must not exist; where there is no window "
            "play_GAME.mp4 is one without it")
        ->type_name("FILE");
    auto* real_time = command.add_flag("--realtime", options->real_time,
                                       "the console runs at 60 frames a second and waits for nobody, P and R "
                                       "do nothing; at the end it says what was missed");
    auto* no_window = command.add_flag("--no-window", options->no_window,
                                       "film only, as fast as it can; with --realtime at 60 frames a second");
    command
        .add_option("--games", options->games,
                    "leave after these; 0: when the window is closed, where there is none after one")
        ->transform(whole_numbers(0, 1'000'000))
        ->type_name("N");
    command.add_option("--speed", options->speed, "times the speed of the console; 0: as fast as it can")
        ->excludes(real_time)
        ->excludes(no_window)
        ->transform(numbers(0, 100))
        ->type_name("X");
    auto* greedy = command.add_flag("--greedy", options->greedy, "the policy's best action")->needs(policy);
    command.add_flag("--sampled", options->sampled, "an action drawn from the policy")
        ->excludes(greedy)
        ->needs(policy);
    command.add_option("--seed", options->seed, "for sticky actions, no-op starts and what is drawn")
        ->transform(seeds())
        ->type_name("N");
    command.footer(
        fmt::format("Keys:\n{}\n"
                    "Examples:\n"
                    "  cale play breakout\n"
                    "  cale play breakout --threshold 0.3 --set env.paddle_strength=radius\n"
                    "  cale play --policy runs/Breakout__sac__1__1795270400\n"
                    "  cale play pong --policy pong.safetensors --no-window --video pong.mp4\n"
                    "\n"
                    "Exit codes: 0 done, 1 failed, 2 usage, 130 interrupted: the film ends there.",
                    keyboard_help()));
    command.callback([options, &exit_code] { exit_code = run(*options); });
}

}  // namespace cale
