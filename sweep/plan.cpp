#include "sweep/plan.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include "cale/env.h"
#include "experiment/config.h"
#include "sweep/shell.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// What a run takes beside its replay: LibTorch, networks, optimisers and a batch at work.
constexpr std::int64_t kMemoryOfProcess = 900'000'000;
/// A stored transition: a frame of 84 x 84, the action, the reward and the bookkeeping.
constexpr std::int64_t kMemoryOfTransition = 7'400;

/// The settings of a run that matter to its plan.
constexpr std::array<std::string_view, 4> kPlanKeys = {"train.total_steps", "eval.episodes",
                                                       "agent.replay_capacity", "env.rom_dir"};

bool is_plan_key(std::string_view key) {
    return std::find(kPlanKeys.begin(), kPlanKeys.end(), key) != kPlanKeys.end();
}

std::string assignment(const Setting& setting) {
    return fmt::format("{}={}", setting.key, setting.value);
}

/// Agents whose programs lie in `folder`.
std::vector<std::string> agents_in(const fs::path& folder) {
    std::vector<std::string> agents;
    std::error_code ignored;
    for (const auto& item : fs::directory_iterator(folder, ignored)) {
        const auto name = item.path().filename().string();
        if (name.starts_with("train_") && item.path().extension().empty()) agents.push_back(name.substr(6));
    }
    std::sort(agents.begin(), agents.end());
    return agents;
}

fs::path find_program(const std::string& agent, const fs::path& folder) {
    const auto name = "train_" + agent;
    if (::access((folder / name).c_str(), X_OK) == 0) return folder / name;
    const char* path = std::getenv("PATH");
    std::istringstream folders(path != nullptr ? path : "");
    for (std::string other; std::getline(folders, other, ':');) {
        if (::access((fs::path(other) / name).c_str(), X_OK) == 0) return fs::absolute(other) / name;
    }
    const auto agents = agents_in(folder);
    const auto guess = nearest(agent, agents);
    throw ConfigError(fmt::format("agent '{}': there is no program {} in {} or on the PATH; {}", agent, name,
                                  folder.string(),
                                  guess.empty() ? fmt::format("there are {}", fmt::join(agents, ", "))
                                                : fmt::format("did you mean '{}'?", guess)));
}

/// What the program would run with, as YAML; ConfigError with its own sentence if it objects.
YAML::Node resolved_config(const std::string& sweep, std::vector<std::string> command) {
    command.emplace_back("--print-config");
    const auto text = shell_text(command);
    const auto answer = answer_of(text + " 2>/dev/null");
    if (answer.status == 0) return YAML::Load(answer.text);
    const auto sentence = without_line_end(answer_of(text + " 2>&1 >/dev/null").text);
    throw ConfigError(fmt::format("{}: {}", sweep, sentence.empty() ? text + " fails" : sentence));
}

std::int64_t number(const YAML::Node& config, const char* section, const char* name, std::int64_t otherwise) {
    const auto node = config[section] ? config[section][name] : YAML::Node();
    return node ? node.as<std::int64_t>(otherwise) : otherwise;
}

/// Runs that share a program, a configuration file and the values of all keys that matter to the plan.
using Group = std::pair<std::vector<std::string>, std::vector<std::string>>;  // program and file; KEY=VALUE

Group group_of(const fs::path& program, const SweepRun& run) {
    Group group;
    group.first.push_back(program.string());
    if (!run.config.empty()) group.first.insert(group.first.end(), {"--config", run.config.string()});
    for (const auto& setting : run.settings) {
        if (is_plan_key(setting.key)) group.second.push_back(assignment(setting));
    }
    return group;
}

void check_rom(const SweepRun& run, const std::string& rom_dir) {
    try {
        static_cast<void>(find_rom(run.game, rom_dir));
    } catch (const std::exception& error) {
        throw ConfigError(fmt::format("env.game: {}", error.what()));
    }
}

}  // namespace

std::vector<PlannedRun> plan(const Sweep& sweep, const fs::path& folder) {
    std::map<std::string, fs::path> programs;
    // All values of the other settings are checked in one go: a program reads its arguments in order.
    std::map<std::vector<std::string>, std::set<std::string>> other_settings;
    for (const auto& run : sweep.runs) {
        if (!programs.contains(run.agent)) programs[run.agent] = find_program(run.agent, folder);
        auto& others = other_settings[group_of(programs[run.agent], run).first];
        for (const auto& setting : run.settings) {
            if (!is_plan_key(setting.key)) others.insert(assignment(setting));
        }
    }

    std::map<Group, YAML::Node> configs;
    std::set<std::pair<std::string, std::string>> roms;
    std::vector<PlannedRun> planned;
    for (const auto& run : sweep.runs) {
        const auto group = group_of(programs[run.agent], run);
        if (!configs.contains(group)) {
            auto command = group.first;
            const auto& others = other_settings[group.first];
            command.insert(command.end(), others.begin(), others.end());
            command.insert(command.end(), group.second.begin(), group.second.end());
            configs.emplace(group, resolved_config(sweep.name, std::move(command)));
        }
        const auto& config = configs.at(group);
        const auto rom_dir = config["env"] && config["env"]["rom_dir"]
                                 ? config["env"]["rom_dir"].as<std::string>("")
                                 : std::string();
        if (roms.emplace(run.game, rom_dir).second) check_rom(run, rom_dir);

        const auto total_steps = number(config, "train", "total_steps", 0);
        const auto stored = std::min(number(config, "agent", "replay_capacity", 0), total_steps);
        planned.push_back({.run = run,
                           .program = programs[run.agent],
                           .total_steps = total_steps,
                           .evaluates = number(config, "eval", "episodes", 0) > 0,
                           .memory = kMemoryOfProcess + stored * kMemoryOfTransition});
    }
    return planned;
}

std::int64_t largest_memory(std::span<const PlannedRun> runs) {
    std::int64_t most = 1;
    for (const auto& planned : runs) most = std::max(most, planned.memory);
    return most;
}

std::vector<std::string> command_of(const PlannedRun& planned, const RunPlace& place, bool resume) {
    std::vector<std::string> command = {planned.program.string()};
    if (!planned.run.config.empty()) command.insert(command.end(), {"--config", planned.run.config.string()});
    for (const auto& setting : planned.run.settings) command.push_back(assignment(setting));
    command.insert(command.end(), {"--run-dir", place.folder.string(), "--threads",
                                   std::to_string(place.threads), "--device", place.device, "--no-progress"});
    if (resume) command.emplace_back("--resume");
    return command;
}

}  // namespace cale
