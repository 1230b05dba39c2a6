#include "train/training_world.h"

#include <memory>

#include <fmt/format.h>

#include "cale/fields.h"
#include "cale/games.h"
#include "cale/random_play.h"
#include "cale/real_time.h"
#include "cale/vector_env.h"

namespace cale {
namespace {

PolicyInfo policy_info(const EnvConfig& env) {
    PolicyInfo info;
    info.game = game_names(env.game);
    info.action_space = name_of(env.action_space);
    if (env.action_space != ActionSet::continuous) {
        const Env game(config_of(env, 0), /*seed=*/0);
        info.actions.assign(game.actions().begin(), game.actions().end());
    } else if (env.joystick == Joystick::factored) {
        info.actions.assign(factored_events().begin(), factored_events().end());
    }
    if (env.action_space == ActionSet::continuous) info.joystick = coordinates(env);
    info.threshold = env.threshold;
    info.event_map = env.event_map;
    info.radius_is_strength = env.paddle_strength == PaddleStrength::radius;
    info.frame_skip = env.frame_skip;
    info.life_loss_ends_episode = env.terminal_on_life_loss;
    return info;
}

/// What the head of a run's output says of the game.
std::vector<std::pair<std::string, std::string>> facts_of(const EnvConfig& env, const ActionSpace& actions) {
    const auto joystick = coordinates(env);
    const auto chosen_by =
        joystick == Joystick::polar ? std::string() : fmt::format(" ({})", name_of(joystick));
    std::vector<std::pair<std::string, std::string>> lines{
        {"protocol", fmt::format("sticky {}, life loss {}", env.sticky_probability,
                                 env.terminal_on_life_loss ? "ends an episode" : "does not matter")},
        {"actions", env.action_space == ActionSet::continuous
                        ? fmt::format("continuous{}, threshold {}", chosen_by, env.threshold)
                        : fmt::format("{} joystick events", num_actions(actions))}};
    if (is_variant(env)) lines.emplace_back("game", variant_name(env));
    if (const auto stick = changed_settings(env.motion); !stick.empty()) lines.emplace_back("stick", stick);
    return lines;
}

}  // namespace

TrainingWorld training_world(const EnvConfig& env, const EvalConfig& eval) {
    const auto all_games = games_of(env.game);
    std::vector<std::string> names;
    for (const auto* const game : all_games) names.emplace_back(game->name);
    const auto make = [env](std::span<const std::uint32_t> seeds) {
        auto share = env;
        share.num_envs = std::ssize(seeds);
        return std::make_unique<VectorEnv>(share, seeds);
    };
    const auto evaluate_games = [env, noop_max = eval.noop_max](const Decide& decide, EvaluationPlan plan) {
        plan.env = env;
        plan.env.noop_max = noop_max;
        return evaluate(decide, plan);
    };
    return {.id = fmt::format("ALE/{}-v5", game_names(env.game)),
            .name = variant_name(env),
            .num_envs = env.num_envs,
            .threads = VectorEnv::threads(env),
            .bytes_per_env = VectorEnv::memory_per_env(env),
            .frames_per_step = env.frame_skip,
            .roms = find_roms(env),
            .games = all_games.size() > 1 ? std::move(names) : std::vector<std::string>(),
            .make = make,
            .make_real_time =
                [env](std::span<const std::uint32_t> seeds) {
                    return std::make_unique<RealTimeGame>(env, seeds.front());
                },
            .evaluate = evaluate_games,
            .can_film = true,
            .policy_info = [env] { return policy_info(env); },
            .random_score = random_floor(env),
            .human_score =
                all_games.size() == 1 && !is_variant(env) ? all_games.front()->human_score : std::nullopt,
            .facts = [env](const ActionSpace& actions) { return facts_of(env, actions); }};
}

}  // namespace cale
