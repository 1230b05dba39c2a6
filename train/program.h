// The main program around a training algorithm.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "agents/agent.h"
#include "agents/off_policy_memory.h"
#include "agents/on_policy_memory.h"
#include "settings/config.h"
#include "settings/run_config.h"
#include "train/training.h"
#include "train/training_world.h"

namespace cale {

/// One algorithm in one kind of world, with its settings in the table.
struct TrainingProgram {
    std::string name;                                                    // "train_sac"
    std::string agent_name;                                              // "sac"
    std::string description;                                             // for --help
    ConfigTable& table;                                                  // refers to all settings
    RunSettings& settings;                                               // sections train, eval and log
    std::int64_t& num_envs;                                              // env.num_envs
    std::function<TrainingWorld()> world;                                // made from the settings
    std::function<AgentSpec()> spec;                                     // made from the settings
    std::function<std::unique_ptr<Agent>(const AgentSpec&)> make_agent;  // called once
    /// May train one agent together: the agent uses AgentSpec::processes.
    bool several_processes = false;
    /// With train.overlap update() only starts the learning, which continues beside the decisions that
    /// follow: it is called before each of them, as without overlap.
    bool learns_beside = false;
    /// update() may be called between a decision and its observation too, as train.overlap and train.realtime
    /// have it for agents that do not learn beside.
    bool updates_late = true;
    std::function<std::string()> schedule_over_run = [] { return std::string(); };  // see agents/agent.h
    /// Throws std::runtime_error unless the agent fits into `available` bytes. Null if its size is unknown.
    std::function<void(const AgentSpec&, std::int64_t available)> check_memory = nullptr;
};

/// Reads the command line, makes or opens the run's folder, trains.
/// Returns the exit code: 0 done, 1 failed, 2 usage or configuration, 3 cannot resume, 4 diverged,
/// 130 interrupted after a checkpoint. Every error is one sentence on stderr.
int run_program(const TrainingProgram& program, int argc, const char* const* argv);

/// Agents whose settings declare so: see TrainingProgram::several_processes.
template <class AgentConfig>
concept TrainsInSeveralProcesses = requires {
    requires AgentConfig::kSeveralProcesses;
};
/// Agents whose settings declare so: see TrainingProgram::learns_beside.
template <class AgentConfig>
concept LearnsBeside = requires {
    requires AgentConfig::kLearnsBeside;
};

/// Agents that may update late: those whose settings have a member `replay` (agents/off_policy.h), from which
/// an update may be made at any time. See TrainingProgram::updates_late.
template <class AgentConfig>
concept UpdatesLate = requires(const AgentConfig& config) {
    config.replay;
};

/// The main() of a training program in one call, in the world of `WorldConfig`: see train/training_world.h.
template <class WorldConfig = EnvConfig, class AgentConfig>
int run_program(const std::string& agent_name, const std::string& description,
                std::unique_ptr<Agent> (*make_agent)(const AgentConfig&, const AgentSpec&), int argc,
                const char* const* argv) {
    RunConfig<AgentConfig, WorldConfig> config;
    ConfigTable table = settings_of(config);
    TrainingProgram program{
        .name = std::filesystem::path(argv[0]).filename().string(),
        .agent_name = agent_name,
        .description = description,
        .table = table,
        .settings = config,
        .num_envs = config.env.num_envs,
        .world = [&] { return training_world(config.env, config.eval); },
        .spec = [&] { return spec_of(config.env, config.train); },
        .make_agent = [&](const AgentSpec& spec) { return make_agent(config.agent, spec); },
        .several_processes = TrainsInSeveralProcesses<AgentConfig>,
        .learns_beside = LearnsBeside<AgentConfig>,
        .updates_late = UpdatesLate<AgentConfig>,
    };
    if constexpr (requires { schedule_over_run(config.agent); })
        program.schedule_over_run = [&] { return std::string(schedule_over_run(config.agent)); };
    if constexpr (requires(const AgentSpec& spec) { check_memory(config.agent, spec, std::int64_t{}); }) {
        program.check_memory = [&](const AgentSpec& spec, std::int64_t available) {
            check_memory(config.agent, spec, available);
        };
    }
    return run_program(program, argc, argv);
}

}  // namespace cale
