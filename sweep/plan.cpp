#include "sweep/plan.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

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

/// A program's objection. One to a setting that the sweep's file has names the place there in the stead of
/// the option by which the program was told.
std::string objection(const Sweep& sweep, const std::string& sentence) {
    constexpr std::string_view option = ": --set ";
    const auto at = sentence.find(option);
    if (at != sentence.npos) {
        const auto told = std::string_view(sentence).substr(at + option.size());
        for (const auto& [setting, place] : sweep.places) {
            if (told.starts_with(setting + ": "))
                return fmt::format("{}: {}{}", place, sentence.substr(0, at), told.substr(setting.size()));
        }
    }
    return fmt::format("{}: {}", sweep.name, sentence);
}

/// What the program would run with, as YAML; ConfigError with its own sentence if it objects.
std::string printed_config(const Sweep& sweep, std::vector<std::string> command) {
    command.emplace_back("--print-config");
    const auto text = shell_text(command);
    const auto answer = answer_of(text + " 2>/dev/null");
    if (answer.status == 0) return answer.text;
    const auto sentence = without_line_end(answer_of(text + " 2>&1 >/dev/null").text);
    throw ConfigError(objection(sweep, sentence.empty() ? text + " fails" : sentence));
}

/// A program and the configuration file that it reads, if any.
using Base = std::vector<std::string>;

Base base_of(const fs::path& program, const SweepRun& run) {
    Base base = {program.string()};
    if (!run.config.empty()) base.insert(base.end(), {"--config", run.config.string()});
    return base;
}

void check_rom(const SweepRun& run, const std::string& rom_dir) {
    try {
        static_cast<void>(find_rom(run.game, rom_dir));
    } catch (const std::exception& error) {
        throw ConfigError(fmt::format("env.game: {}", error.what()));
    }
}

}  // namespace

const std::string* planned_value(const PlannedRun& planned, std::string_view key) {
    for (const auto& setting : planned.run.settings) {
        if (setting.key == key) return &setting.value;
    }
    if (planned.base == nullptr) return nullptr;
    const auto found = planned.base->find(key);
    return found == planned.base->end() ? nullptr : &found->second;
}

std::vector<PlannedRun> plan(const Sweep& sweep, const fs::path& folder) {
    std::map<std::string, fs::path> programs;
    std::map<Base, std::set<std::string>> settings;
    for (const auto& run : sweep.runs) {
        if (!programs.contains(run.agent)) programs[run.agent] = find_program(run.agent, folder);
        auto& of_base = settings[base_of(programs[run.agent], run)];
        for (const auto& setting : run.settings) of_base.insert(assignment(setting));
    }

    std::map<Base, std::shared_ptr<const SettingTexts>> bases;
    for (const auto& [base, assignments] : settings) {
        bases[base] = std::make_shared<SettingTexts>(settings_in(printed_config(sweep, base)));
        // The values of all runs are checked in one go: a program reads its arguments in order.
        auto command = base;
        command.insert(command.end(), assignments.begin(), assignments.end());
        static_cast<void>(printed_config(sweep, std::move(command)));
    }

    std::set<std::pair<std::string, std::string>> roms;
    std::vector<PlannedRun> planned;
    for (const auto& run : sweep.runs) {
        const auto& program = programs.at(run.agent);
        PlannedRun next{.run = run, .program = program, .base = bases.at(base_of(program, run))};
        const auto* rom_dir = planned_value(next, "env.rom_dir");
        const auto rom = std::pair(run.game, rom_dir != nullptr ? *rom_dir : "");
        if (roms.insert(rom).second) check_rom(run, rom.second);

        const auto integer = [&](std::string_view key) {
            const auto* text = planned_value(next, key);
            return text != nullptr ? integer_in(*text) : 0;
        };
        next.total_steps = integer("train.total_steps");
        next.evaluates = integer("eval.episodes") > 0;
        const auto stored = std::min(integer("agent.replay_capacity"), next.total_steps);
        next.memory = kMemoryOfProcess + stored * kMemoryOfTransition;
        planned.push_back(std::move(next));
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
