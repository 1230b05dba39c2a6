#include <cstdio>
#include <ctime>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <unistd.h>

#include <ATen/Parallel.h>
#include <fmt/format.h>
#include <torch/cuda.h>

#include "cale/games.h"
#include "experiment/command_line.h"
#include "experiment/config.h"
#include "experiment/evaluation_report.h"
#include "experiment/export.h"
#include "experiment/policy_evaluation.h"
#include "train/commands.h"
#include "train/usage.h"

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
    std::int64_t video_episode = 0;
    double video_minutes = 5;
    std::string device = "cpu";
    int threads = 1;
};

EnvConfig environment_of(const Options& options, const PolicyInfo& policy) {
    EnvConfig env = env_config_of(policy);
    set_environment(env, options.settings);
    env.game = find_game(env.game).rom;
    if (const auto kept = keep_life_loss(policy, env); !kept.empty())
        std::fputs(fmt::format("cale evaluate: {}\n", kept).c_str(), stderr);
    return env;
}

EvaluationPlan plan_of(const Options& options, const EnvConfig& env, std::size_t stack_depth) {
    auto plan = options.protocol == "fixed_steps" ? fixed_steps(env) : fixed_episodes(env);
    if (options.episodes) plan.games = *options.episodes;
    if (options.steps) plan.steps = *options.steps;
    if (options.epsilon) plan.epsilon = *options.epsilon;
    if (options.noop_max) plan.env.noop_max = *options.noop_max;
    plan.parallel = options.parallel;
    plan.seed = options.seed;
    plan.stack_depth = stack_depth;
    plan.filmed_game = options.video_episode;
    plan.film_minutes = options.video_minutes;
    if (options.video && plan.filmed_game >= plan.games) {
        throw ConfigError(
            fmt::format("--video-episode {}: the episodes are 0 to {}", plan.filmed_game, plan.games - 1));
    }
    return plan;
}

/// A new folder: an evaluation is never written over another.
fs::path make_folder(const Options& options, const PolicyInfo& policy, const EnvConfig& env) {
    const fs::path folder =
        !options.out.empty()
            ? fs::path(options.out)
            : fs::path("evaluations") / fmt::format("{}__{}__{}__{}", find_game(env.game).name, policy.agent,
                                                    options.seed, std::time(nullptr));
    if (fs::exists(folder / "evaluation.csv")) {
        throw ConfigError(fmt::format("--out {}: an evaluation is in there already; choose another folder",
                                      folder.string()));
    }
    make_output_folder("--out", folder);
    return folder;
}

void run(const Options& options) {
    at::set_num_threads(options.threads);
    const Policy policy = policy_of(options.policy, find_device(options.device, torch::cuda::device_count()));
    const PolicyInfo& info = policy.info();
    EvaluationPlan plan =
        plan_of(options, environment_of(options, info), static_cast<std::size_t>(info.stack));
    require_playable(info, plan.env);
    const bool sampled = options.sampled || (info.evaluation_samples && !options.greedy);
    const fs::path folder = make_folder(options, info, plan.env);
    if (options.video) plan.video = folder / fmt::format("episode_{:04}.mp4", options.video_episode);

    std::int64_t ended = 0;
    double sum = 0;
    if (isatty(STDERR_FILENO) != 0) {
        plan.ended = [&](const EvaluatedGame& game) {
            sum += game.episode_return;
            ++ended;
            std::fputs(fmt::format("\r{} game{}, mean return {:.1f}", ended, ended == 1 ? "" : "s",
                                   sum / static_cast<double>(ended))
                           .c_str(),
                       stderr);
        };
    }
    const Evaluation evaluation = evaluate(decide_by(policy, sampled, options.seed), plan);
    if (ended > 0) std::fputs("\r\033[K", stderr);

    const EvaluationReport report{.source = options.policy,
                                  .protocol = options.protocol,
                                  .sampled = sampled,
                                  .policy = info,
                                  .plan = plan,
                                  .evaluation = evaluation};
    write_evaluation_report(folder, report);
    std::fputs(evaluation_text(report).c_str(), stdout);
    std::fputs(fmt::format("{:<20}  {}\n", "written to", folder.string()).c_str(), stdout);
}

}  // namespace

void add_evaluate(CLI::App& app) {
    auto& command = *app.add_subcommand("evaluate",
                                        "Plays games with a trained policy, without learning, and says "
                                        "what they returned. The environment is the one it was trained "
                                        "in, unless --set changes it.");
    const auto options = std::make_shared<Options>();
    command
        .add_option("POLICY", options->policy,
                    "a policy file, a checkpoint's folder, or a run's: its newest checkpoint")
        ->required()
        ->type_name("FILE");
    command
        .add_option("--protocol", options->protocol,
                    "fixed_episodes: 100 games that begin with 0 to 29 no-ops; fixed_steps: games until "
                    "125,000 agent "
                    "steps; both with 0.1 % random actions")
        ->transform(one_of({"fixed_episodes", "fixed_steps"}))
        ->type_name("NAME");
    command.add_option("--episodes", options->episodes, "games, at most")
        ->transform(whole_numbers(1, 1'000'000))
        ->type_name("N");
    command.add_option("--steps", options->steps, "no game begins after this many agent steps")
        ->transform(whole_numbers(1, 1'000'000'000))
        ->type_name("N");
    command.add_option("--epsilon", options->epsilon, "probability of a uniformly random action")
        ->transform(numbers(0, 1))
        ->type_name("P");
    command
        .add_option("--noop-max", options->noop_max, "a game begins with 0 to this many no-op agent steps")
        ->transform(whole_numbers(0, 1000))
        ->type_name("N");
    command.add_option("--seed", options->seed, "what happens in a game follows from this and its number")
        ->transform(seeds())
        ->type_name("N");
    command
        .add_option("--parallel", options->parallel,
                    "games under way at a time; the results do not depend on it")
        ->transform(whole_numbers(1, 1024))
        ->type_name("N");
    auto* greedy = command.add_flag("--greedy", options->greedy,
                                    "the likeliest or most valuable action, the mean of a Gaussian");
    command
        .add_flag("--sampled", options->sampled,
                  "actions drawn from the policy; without either: as the agent's own evaluations (PPO draws)")
        ->excludes(greedy);
    command
        .add_option(
            "--set", options->settings,
            "change a setting of the environment: env.sticky_probability=0, env.game=..., as in train_*")
        ->allow_extra_args(false)
        ->take_all()
        ->type_name("KEY=VALUE");
    command.add_option("--out", options->out, "folder to write to; else a new one in evaluations/")
        ->type_name("DIR");
    auto* video = command.add_flag("--video", options->video,
                                   "film a game: the screen beside what the agent sees and does");
    command.add_option("--video-episode", options->video_episode, "which")
        ->needs(video)
        ->transform(whole_numbers(0, 1'000'000))
        ->type_name("N");
    command.add_option("--video-minutes", options->video_minutes, "how much of it")
        ->needs(video)
        ->transform(numbers(0.01, 1000))
        ->type_name("X");
    command
        .add_option("--device", options->device,
                    "auto, cpu, cuda or cuda:<index>; auto: cuda if there is one")
        ->type_name("DEVICE");
    command.add_option("--threads", options->threads, "threads for tensors; sums may be rounded another way")
        ->transform(whole_numbers(1, 4096))
        ->type_name("N");
    command.footer(
        "Written to the folder: evaluation.csv (a row per game), evaluation_events.csv (how often each "
        "joystick event),\n"
        "evaluation_rewards.csv (quantiles of the rewards), evaluation.json (settings and statistics), "
        "episode_N.mp4.\n"
        "\n"
        "Examples:\n"
        "  cale evaluate runs/Breakout__sac__1__1795270400 --video\n"
        "  cale evaluate breakout.safetensors --episodes 10 --epsilon 0 --noop-max 0\n"
        "  cale evaluate runs/a/checkpoints/step_000100000 --protocol fixed_steps --set "
        "env.sticky_probability=0.25\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([options] { run(*options); });
}

}  // namespace cale
