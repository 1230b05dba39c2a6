// The world that a training program trains in: an Atari 2600 game, or any other (examples/pendulum).
//
// The configuration of another world, a struct with fields() and num_envs, has these functions beside it:
//     std::string world_name(const Config&)                                  "Pendulum"
//     ActionSpace action_space(const Config&)
//     ObservationSpace observation_space(const Config&)
//     std::unique_ptr<World> make_world(const Config&, std::span<const std::uint32_t> seeds)
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cale/env.h"
#include "evaluate/evaluation.h"
#include "policy/policy_info.h"
#include "settings/run_config.h"
#include "world/world.h"

namespace cale {

/// The description of a world for programs, logs and evaluations.
struct TrainingWorld {
    std::string id;                             // of tables and pages: "ALE/Pong-v5"
    std::string name;                           // of run folders: "Pong"
    std::int64_t num_envs = 1;                  // of all processes
    std::int64_t threads = 1;                   // that step them
    std::int64_t bytes_per_env = 0;             // of memory, about
    std::int64_t frames_per_step = 1;           // at most
    std::vector<std::filesystem::path> roms{};  // the games' files; empty: there are none
    std::vector<std::string> games{};           // that the environments play in turn; empty: one

    MakeWorld make;              // a world of so many environments as it is given seeds
    MakeWorld make_real_time{};  // the same in real time; null: it has none
    /// Plays the plan's games with `decide`, one after the other, in this world, whatever `plan.env` is. Must
    /// ask `plan.stop` before each step. A world that cannot be filmed ignores `plan.video`.
    std::function<Evaluation(const Decide& decide, EvaluationPlan plan)> evaluate;
    bool can_film = false;  // whether evaluate() writes `plan.video`

    /// The world's description in a policy file; null: no policy files in this world.
    std::function<PolicyInfo()> policy_info{};

    std::optional<double> random_score{}, human_score{};  // mean returns, where they are known
    /// The world's lines in the header of a run, given its action space.
    std::function<std::vector<std::pair<std::string, std::string>>(const ActionSpace&)> facts;
};

/// Returns the world of an Atari game. Throws std::invalid_argument for an unknown game and
/// std::runtime_error for a ROM that is missing.
TrainingWorld training_world(const EnvConfig& env, const EvalConfig& eval);

/// Returns the world of any other configuration; see the top of this file.
template <class WorldConfig>
TrainingWorld training_world(const WorldConfig& config, const EvalConfig&) {
    const auto make = [config](std::span<const std::uint32_t> seeds) { return make_world(config, seeds); };
    return {.id = world_name(config),
            .name = world_name(config),
            .num_envs = config.num_envs,
            .make = make,
            .evaluate = [make](const Decide& decide,
                               const EvaluationPlan& plan) { return evaluate(decide, make, plan); },
            .facts = [](const ActionSpace&) { return std::vector<std::pair<std::string, std::string>>{}; }};
}

}  // namespace cale
