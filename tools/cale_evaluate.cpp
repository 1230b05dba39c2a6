#include <cstdio>
#include <ctime>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <ATen/Context.h>
#include <ATen/Parallel.h>
#include <fmt/format.h>

#include "cale/games.h"
#include "cale/text.h"
#include "evaluate/evaluation_progress.h"
#include "evaluate/evaluation_report.h"
#include "evaluate/policy_evaluation.h"
#include "evaluate/run_evaluations.h"
#include "settings/command_line.h"
#include "settings/config.h"
#include "storage/checksum.h"
#include "storage/manifest.h"
#include "storage/new_folder.h"
#include "storage/run_lock.h"
#include "storage/step_name.h"
#include "terminal/console.h"
#include "terminal/exit_code.h"
#include "terminal/failure.h"
#include "terminal/stop_signals.h"
#include "tools/commands.h"
#include "tools/usage.h"
#include "train/checkpoint.h"
#include "train/export.h"
#include "train/resume.h"

namespace cale {
namespace fs = std::filesystem;
namespace {

struct Options {
    std::string policy;
    std::string protocol = "fixed_episodes";
    std::optional<std::int64_t> episodes;
    std::optional<std::int64_t> steps;
    std::optional<double> epsilon;
    std::optional<std::int64_t> noop_max;
    std::int64_t parallel = 16;
    std::uint64_t seed = 1;
    bool greedy = false;
    bool sampled = false;
    std::vector<std::string> settings;
    std::string out;
    bool video = false;
    bool step_log = false;
    std::int64_t video_episode = 0;
    double video_minutes = 5;
    std::string device = "cpu";
    int threads = 1;
};

/// Changes `env` as the user's --set have it.
void set_environment(EnvConfig& env, const Options& options) {
    for (const auto& setting : options.settings) {
        if (setting.starts_with("env.noop_max="))
            throw ConfigError(fmt::format("--set {}: no-ops are given by --noop-max", setting));
    }
    set_environment(env, options.settings);
}

EnvConfig environment_of(const Options& options, const PolicyInfo& policy) {
    EnvConfig env = env_config_of(policy);
    set_environment(env, options);
    env.game = only_game(env).rom;
    check_roms(env);
    if (const auto kept = keep_life_loss(policy, env); !kept.empty())
        std::fputs(fmt::format("cale evaluate: {}\n", kept).c_str(), stderr);
    return env;
}

EvaluationPlan plan_of(const Options& options, const EnvConfig& env) {
    auto plan = options.protocol == "fixed_steps" ? fixed_steps(env) : fixed_episodes(env);
    if (options.episodes) plan.games = *options.episodes;
    if (options.steps) plan.steps = *options.steps;
    if (options.epsilon) plan.epsilon = *options.epsilon;
    if (options.noop_max) plan.env.noop_max = *options.noop_max;
    plan.parallel = options.parallel;
    plan.seed = options.seed;
    plan.filmed_game = options.video_episode;
    plan.film_minutes = options.video_minutes;
    if (options.video && plan.filmed_game >= plan.games) {
        throw ConfigError(
            fmt::format("--video-episode {}: the episodes are 0 to {}", plan.filmed_game, plan.games - 1));
    }
    return plan;
}

/// A new folder: an evaluation is never written over another.
NewFolder make_folder(const Options& options, const PolicyInfo& policy, const EnvConfig& env) {
    if (options.out.empty()) {
        return NewFolder::with_a_free_name(fs::path("evaluations") /
                                           fmt::format("{}__{}__{}__{}", only_game(env).name, policy.agent,
                                                       options.seed, std::time(nullptr)));
    }
    NewFolder folder = make_output_folder("--out", options.out);
    if (fs::exists(folder.path() / "evaluation.csv")) {
        throw ConfigError(
            fmt::format("--out {}: an evaluation is in there already; choose another folder", options.out));
    }
    if (!fs::is_empty(folder.path())) {
        throw ConfigError(fmt::format(
            "--out {}: there are files in it, which would lie beside those of this evaluation; choose "
            "another folder, or a new one",
            options.out));
    }
    return folder;
}

/// A policy, and what it is to play.
struct Task {
    Policy policy;
    std::string policy_checksum;
    EvaluationPlan plan;
    bool sampled = false;
};

Task task_of(const Options& options, const fs::path& path, torch::Device device) {
    const auto contents = policy_file_of(path);
    Task task{.policy = Policy::parse(contents, path.string(), device),
              .policy_checksum = checksum_text(crc32c(contents)),
              .plan = {}};
    const PolicyInfo& info = task.policy.info();
    task.plan = plan_of(options, environment_of(options, info));
    require_playable(info, task.plan.env);
    task.sampled = draws_actions(task.policy, options.sampled, options.greedy);
    return task;
}

Evaluation play(const Options& options, const Task& task) {
    return evaluate(decide_by(task.policy, task.sampled, options.seed), task.plan);
}

EvaluationReport report_of(const Options& options, const Task& task, const std::string& source,
                           const Evaluation& evaluation) {
    return {.source = source,
            .protocol = options.protocol,
            .sampled = task.sampled,
            .policy_checksum = task.policy_checksum,
            .device = task.policy.device().str(),
            .policy = task.policy.info(),
            .plan = task.plan,
            .evaluation = evaluation};
}

/// Returns the exit code.
int evaluate_policy(const Options& options, torch::Device device) {
    const StopSignals signals;
    Task task = task_of(options, options.policy, device);
    if (options.sampled && !can_sample(task.policy))
        std::fputs(fmt::format("cale evaluate: {}\n", kDrawsNothing).c_str(), stderr);
    const NewFolder made = make_folder(options, task.policy.info(), task.plan.env);
    const fs::path& folder = made.path();
    if (options.video) task.plan.video = folder / fmt::format("episode_{:04}.mp4", options.video_episode);
    std::optional<NewFolder> made_for_steps;
    if (options.step_log) {
        task.plan.step_logs = folder / "steps";
        made_for_steps.emplace(make_output_folder("--step-log", task.plan.step_logs));
    }
    task.plan.stop = stop_requested;
    Console console(stderr);
    EvaluationProgress progress(console, task.plan);
    const Evaluation evaluation = play(options, task);
    console.clear();
    if (evaluation.games.empty()) {
        std::fputs(
            fmt::format("cale evaluate: {} came before a game had ended: there is no table\n", stop_signal())
                .c_str(),
            stderr);
        return kInterrupted;
    }
    if (options.video && !fs::exists(task.plan.video))
        std::fputs(fmt::format("cale evaluate: --video-episode {}: there is no film, as only {} games were "
                               "played\n",
                               options.video_episode, evaluation.games.size())
                       .c_str(),
                   stderr);
    const EvaluationReport report = report_of(options, task, options.policy, evaluation);
    // First: on a full disk the games would have been played for nothing.
    std::fputs(evaluation_text(report).c_str(), stdout);
    std::fflush(stdout);
    write_evaluation_report(folder, report);
    std::fputs(fmt::format("{:<20}  {}\n", "written to", printable(folder.string())).c_str(), stdout);
    return evaluation.interrupted ? kInterrupted : kDone;
}

// ---- many runs ------------------------------------------------------------------------

EvaluationProtocol protocol_of(const Options& options) {
    EnvConfig env;
    set_environment(env, options);
    const EvaluationPlan plan = plan_of(options, env);
    EvaluationProtocol protocol{.name = options.protocol,
                                .games = plan.games,
                                .steps = plan.steps,
                                .epsilon = plan.epsilon,
                                .seed = options.seed,
                                .choice = options.greedy ? "greedy" : (options.sampled ? "sampled" : "own")};
    if (options.noop_max || options.protocol == "fixed_episodes") protocol.noop_max = plan.env.noop_max;
    ConfigTable table;
    table.add("env", env);
    for (const auto& setting : options.settings) {
        const auto key = setting.substr(0, setting.find('='));
        protocol.settings[key] = key == "env.game" ? only_game(env).rom : table.at(key).get();
    }
    for (const auto* without_effect :
         {"env.rom_dir", "env.env_threads", "env.num_envs", "env.terminal_on_life_loss"})
        protocol.settings.erase(without_effect);
    return protocol;
}

/// Returns the evaluation of the run's newest checkpoint; none unless all of its games were played by that
/// checkpoint's policy.
std::optional<EvaluationResult> result_of_newest(const fs::path& run, const EvaluationProtocol& protocol) {
    const auto steps = newest_checkpoint_step(run);
    if (!steps) return std::nullopt;
    try {
        return evaluation_result(evaluations_folder(run, protocol), *steps,
                                 policy_checksum(run / "checkpoints" / step_name(*steps)).value());
    } catch (const std::exception&) {
        return std::nullopt;  // what is wrong with it is said where its policy is read
    }
}

struct EvaluatedElsewhere : std::runtime_error {
    EvaluatedElsewhere() : std::runtime_error("another process is evaluating it") {}
};

/// Plays what is left to play of the games of a run's newest checkpoint; nothing where it was interrupted.
std::optional<EvaluationResult> evaluate_run(const Options& options, const EvaluationProtocol& protocol,
                                             Task task, const fs::path& run, Console& console,
                                             const std::string& title) {
    const auto steps = number_in<std::int64_t>(task.policy.info().provenance.at("agent_steps")).value();
    const auto folder = evaluations_folder(run, protocol);
    make_evaluations_folder(folder, protocol);
    std::optional<RunLock> lock;
    try {
        lock.emplace(folder);
    } catch (const FolderTaken&) {
        throw EvaluatedElsewhere();
    }
    if (auto result = evaluation_result(folder, steps, task.policy_checksum)) return result;
    const auto partial = partial_evaluation(folder, steps, task.policy_checksum);
    PlayedGames played(partial);
    task.plan.known = played.known();
    task.plan.ended = [&](std::int64_t number, const EvaluatedGame& game) { played.write(number, game); };
    task.plan.stop = stop_requested;
    EvaluationProgress progress(console, task.plan, title);
    const Evaluation evaluation = play(options, task);
    if (evaluation.interrupted) return std::nullopt;
    write_evaluation_report(folder, report_of(options, task, run.string(), evaluation), step_name(steps));
    fs::remove(partial);
    return evaluation_result(folder, steps, task.policy_checksum);
}

/// Returns the exit code.
int evaluate_runs(const Options& options, const std::vector<fs::path>& runs, torch::Device device) {
    for (const auto* option : {options.out.empty() ? nullptr : "--out", options.video ? "--video" : nullptr,
                               options.step_log ? "--step-log" : nullptr}) {
        if (option == nullptr) continue;
        throw ConfigError(
            fmt::format("{}: {} holds runs, whose evaluations are written into their own folders, without "
                        "films and step logs; leave {} out, or name one of the runs, such as {}",
                        option, options.policy, option, runs.front().string()));
    }
    const EvaluationProtocol protocol = protocol_of(options);
    const StopSignals signals;
    std::vector<EvaluationRow> rows;
    std::size_t evaluated = 0;
    for (const auto& run : runs) {
        auto& row =
            rows.emplace_back(EvaluationRow{.run = run.lexically_relative(options.policy).string(),
                                            .failure = "not evaluated yet; the same command continues"});
        row.result = result_of_newest(run, protocol);
        evaluated += row.result ? 1 : 0;
    }
    Console console(stderr);
    const std::pair<std::string, std::string> facts[] = {
        {"runs", fmt::format("{}, {} of them evaluated already", runs.size(), evaluated)},
        {"written to", fmt::format("{} in the folder of each",
                                   evaluations_folder(".", protocol).lexically_normal().string())}};
    console.header(fmt::format("Evaluating {} by {}", options.policy, options.protocol), facts);
    int exit_code = kDone;
    for (std::size_t i = 0; i < runs.size(); ++i) {
        auto& row = rows[i];
        if (row.result) continue;
        const auto number = fmt::format("{}/{}", i + 1, runs.size());
        try {
            row.result = evaluate_run(options, protocol, task_of(options, runs[i], device), runs[i], console,
                                      "run " + number);
            if (!row.result) {
                row.failure = "interrupted; the same command continues";
                exit_code = kInterrupted;
                break;
            }
            console.message(fmt::format("[{}] {}: mean return {:.1f} (standard deviation {:.1f}) over {}",
                                        number, row.run, row.result->mean, row.result->standard_deviation,
                                        counted(row.result->games, "game")));
        } catch (const std::exception& error) {
            row.failure = failure_sentence(error);
            console.message(fmt::format("[{}] {}: {}", number, row.run, row.failure));
            if (dynamic_cast<const EvaluatedElsewhere*>(&error) == nullptr) exit_code = kFailed;
        }
    }
    console.clear();
    std::fputs(evaluation_table(rows).c_str(), stdout);
    return exit_code;
}

/// The runs that lie in the folder that the user named; none where that is a run, a checkpoint or no folder.
std::vector<fs::path> runs_in(const fs::path& path) {
    std::error_code ignored;
    return is_run(path) || !fs::is_directory(path, ignored) ? std::vector<fs::path>() : run_folders(path);
}

int run(const Options& options) {
    at::set_num_threads(options.threads);
    const torch::Device device = find_device(options.device, at::getNumGPUs());
    const auto runs = runs_in(options.policy);
    return runs.empty() ? evaluate_policy(options, device) : evaluate_runs(options, runs, device);
}

/// Which games are played, and how.
void add_game_options(CLI::App& command, Options& options) {
    command
        .add_option(
            "POLICY", options.policy,
            "a policy file, a checkpoint's folder, or a run's: its newest checkpoint; or a folder that "
            "holds runs")
        ->required()
        ->type_name("FILE");
    command
        .add_option("--protocol", options.protocol,
                    "fixed_episodes: 100 games that begin with 0 to 29 no-ops; fixed_steps: games until "
                    "125,000 agent steps; both with 0.1 % random actions")
        ->transform(one_of({"fixed_episodes", "fixed_steps"}))
        ->type_name("NAME");
    command.add_option("--episodes", options.episodes, "games, at most")
        ->transform(whole_numbers(1, 1'000'000))
        ->type_name("N");
    command.add_option("--steps", options.steps, "no game begins after this many agent steps")
        ->transform(whole_numbers(1, 1'000'000'000))
        ->type_name("N");
    command.add_option("--epsilon", options.epsilon, "probability of a uniformly random action")
        ->transform(numbers(0, 1))
        ->type_name("P");
    command.add_option("--noop-max", options.noop_max, "a game begins with 0 to this many no-op agent steps")
        ->transform(whole_numbers(0, 1000))
        ->type_name("N");
    command.add_option("--seed", options.seed, "what happens in a game follows from this and its number")
        ->transform(seeds())
        ->type_name("N");
    command
        .add_option("--parallel", options.parallel,
                    "games under way at a time; the results do not depend on it")
        ->transform(whole_numbers(1, 1024))
        ->type_name("N");
    auto* greedy = command.add_flag("--greedy", options.greedy,
                                    "the likeliest or most valuable action, the mean of a Gaussian");
    command
        .add_flag("--sampled", options.sampled,
                  "actions drawn from the policy, or after noise is drawn for its weights; without either: "
                  "as the agent's own evaluations (PPO, the joystick Rainbow and SAC plus from pixels draw)")
        ->excludes(greedy);
    command
        .add_option(
            "--set", options.settings,
            "change a setting of the environment: env.sticky_probability=0, env.game=..., as in train_*")
        ->allow_extra_args(false)
        ->take_all()
        ->type_name("KEY=VALUE");
}

/// What is written, and with what it is computed.
void add_run_options(CLI::App& command, Options& options) {
    command.add_option("--out", options.out, "folder to write to; else a new one in evaluations/")
        ->type_name("DIR");
    auto* video = command.add_flag("--video", options.video,
                                   "film a game: the screen beside what the agent sees and does");
    command.add_option("--video-episode", options.video_episode, "which")
        ->needs(video)
        ->transform(whole_numbers(0, 1'000'000))
        ->type_name("N");
    command.add_option("--video-minutes", options.video_minutes, "how much of it, in minutes of the game")
        ->needs(video)
        ->transform(numbers(0.01, 1000))
        ->type_name("X");
    command.add_flag("--step-log", options.step_log,
                     "a table of each game in the folder's steps/: the command of each agent step, and what "
                     "the console saw in each frame");
    command
        .add_option("--device", options.device, "auto, cpu, cuda or cuda:<index>; auto: cuda if there is one")
        ->type_name("DEVICE");
    command.add_option("--threads", options.threads, "threads for tensors; sums may be rounded another way")
        ->transform(whole_numbers(1, 4096))
        ->type_name("N");
}

constexpr const char* kFooter =
    "Written to the folder: evaluation.csv (a row per game), evaluation_events.csv (how often each "
    "joystick event),\n"
    "evaluation_rewards.csv (quantiles of the rewards), evaluation.json (settings and statistics), "
    "episode_N.mp4,\n"
    "steps/game_N.csv.\n"
    "Of a folder of runs: the same tables to evaluations/ in each run, where cale report --score "
    "evaluation reads\n"
    "them. What was evaluated by the same protocol is not played again; after Ctrl-C or a kill the same\n"
    "command continues. What another process evaluates is left to it, and is no failure.\n"
    "\n"
    "Examples:\n"
    "  cale evaluate runs/Breakout__sac__1__1795270400 --video\n"
    "  cale evaluate breakout.safetensors --episodes 10 --epsilon 0 --noop-max 0\n"
    "  cale evaluate runs/a/checkpoints/step_000100000 --protocol fixed_steps --set "
    "env.sticky_probability=0.25\n"
    "  cale evaluate runs/encoders\n"
    "\n"
    "Exit codes: 0 done, 1 failed, of a folder of runs: at least one, 2 usage, 130 interrupted: the tables\n"
    "have the games up to then.";

}  // namespace

void add_evaluate(CLI::App& app, int& exit_code) {
    auto& command = *app.add_subcommand("evaluate",
                                        "Plays games with a trained policy, without learning, and says "
                                        "what they returned. The environment is the one it was trained "
                                        "in, unless --set changes it. Of a folder that holds runs, such as "
                                        "a sweep's, it evaluates every run.");
    const auto options = std::make_shared<Options>();
    add_game_options(command, *options);
    add_run_options(command, *options);
    command.footer(kFooter);
    command.callback([options, &exit_code] { exit_code = run(*options); });
}

}  // namespace cale
