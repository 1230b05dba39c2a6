// A run's configuration: the sections train, eval and log, and all sections as one table.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "agents/agent.h"
#include "agents/encoder_check.h"
#include "cale/env.h"
#include "cale/fields.h"
#include "cale/games.h"
#include "settings/config.h"

namespace cale {

/// Section train.
struct TrainConfig {
    std::int64_t total_steps = 50'000'000;
    std::int64_t seed = 1;
    std::int64_t checkpoint_every = 250'000;
    std::int64_t keep_checkpoints = 2;
    std::int64_t keep_every = 0;
    bool keep_best = false;
    bool save_replay = true;
    bool overlap = false;
    bool realtime = false;
    Precision precision = Precision::float32;
};

template <class Visit>
void fields(TrainConfig& config, Visit&& visit) {
    visit("total_steps", config.total_steps, Range{1, 1e12},
          "agent steps of the run, over all environments (frames / frame_skip)");
    visit("seed", config.seed, Range{0, 4294967295.0}, "everything random in the run follows from it");
    visit("checkpoint_every", config.checkpoint_every, Range{1, 1e12},
          "agent steps between checkpoints; one is always written at the end");
    visit("keep_checkpoints", config.keep_checkpoints, Range{1, 1000},
          "number of newest checkpoints to keep");
    visit("keep_every", config.keep_every, Range{0, 1e12},
          "a checkpoint at each multiple of so many agent steps stays for good; 0: none");
    visit("keep_best", config.keep_best,
          "the best checkpoint stays, and checkpoints/best points to it: the largest mean return over the "
          "newest 100 training episodes or, with eval.every, of an evaluation, after each of which a "
          "checkpoint is written then");
    visit("save_replay", config.save_replay,
          "checkpoints hold the replay; without it a resumed run starts with an empty one");
    visit(
        "overlap", config.overlap,
        "the environments step while the agent learns (PPO: a rollout trains while the next one is filled), "
        "so that it acts with the parameters, and explores by the schedule, from before its newest update; "
        "false: the paper's strict order");
    visit("realtime", config.realtime,
          "the game runs at 60 frames a second and waits for nobody: the agent acts on its newest "
          "observation, and learns while the game continues");
    visit("precision", config.precision,
          "what convolutions and products are computed in; bf16: half the bits, for processors with "
          "AVX512-BF16 or AMX, and GPUs");
}

/// Section eval.
struct EvalConfig {
    std::int64_t every = 0;
    std::int64_t episodes = 10;
    std::int64_t noop_max = 0;
    bool video = true;
};

template <class Visit>
void fields(EvalConfig& config, Visit&& visit) {
    visit("every", config.every, Range{0, 1e12},
          "agent steps between evaluations; 0: only at the end of the run");
    visit("episodes", config.episodes, Range{0, 10'000}, "games per evaluation; 0: no evaluation");
    visit("noop_max", config.noop_max, Range{0, 1000},
          "an evaluated Atari game starts with 0 to this many no-op agent steps");
    visit("video", config.video, "film the first Atari game of an evaluation, up to five minutes of it");
}

/// Section log.
struct LogConfig {
    std::int64_t every = 1'000;
    bool tensorboard = true;
};

template <class Visit>
void fields(LogConfig& config, Visit&& visit) {
    visit("every", config.every, Range{1, 1e12}, "agent steps between the rows of progress.csv");
    visit("tensorboard", config.tensorboard, "write TensorBoard events beside the CSV files");
}

/// The sections of a configuration that every run has.
struct RunSettings {
    TrainConfig train{};  // section train
    EvalConfig eval{};    // section eval
    LogConfig log{};      // section log
};

/// The whole configuration of a run of one algorithm in one kind of world.
template <class AgentConfig, class WorldConfig = EnvConfig>
struct RunConfig : RunSettings {
    WorldConfig env;    // section env
    AgentConfig agent;  // section agent
};

/// Returns the part of an agent's spec that follows from the settings alone, without the number of a game's
/// own actions.
template <class WorldConfig>
AgentSpec spec_of(const WorldConfig& env, const TrainConfig& train) {
    AgentSpec spec;
    spec.num_envs = env.num_envs;
    spec.action_space = action_space(env);
    spec.observation = observation_space(env);
    spec.total_steps = train.total_steps;
    spec.overlap = train.overlap || train.realtime;
    spec.precision = train.precision;
    spec.seed = static_cast<std::uint64_t>(train.seed);
    return spec;
}

/// Returns all settings of a run. The table refers to `config`. AgentConfig::kDiscrete says
/// whether an Atari game has its minimal set of actions or the joystick, unless the user chooses.
template <class AgentConfig, class WorldConfig>
ConfigTable settings_of(RunConfig<AgentConfig, WorldConfig>& config) {
    ConfigTable table;
    if constexpr (std::is_same_v<WorldConfig, EnvConfig>)
        config.env.action_space = AgentConfig::kDiscrete ? ActionSet::minimal : ActionSet::continuous;
    table.add("env", config.env);
    if constexpr (std::is_same_v<WorldConfig, EnvConfig>) {
        table.check("env.game", [](const std::string& games) { games_of(games); });
        table.take_list("env.game");
        table.add_rule([&config] { action_space(config.env); });
    }
    table.add("agent", config.agent);
    table.add("train", config.train);
    table.add("eval", config.eval);
    table.add("log", config.log);
    table.add_rule([&config] {
        if (config.train.realtime && config.env.num_envs != 1)
            throw std::invalid_argument("train.realtime is for one game, and env.num_envs is " +
                                        std::to_string(config.env.num_envs) + ": set it to 1");
    });
    table.add_rule([&config] { check_encoder(config.agent, spec_of(config.env, config.train)); });
    if constexpr (requires { check_settings(config.agent, AgentSpec()); })
        table.add_rule([&config] { check_settings(config.agent, spec_of(config.env, config.train)); });
    return table;
}

}  // namespace cale
