#include "sweep/plan.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include "cale/env.h"
#include "cale/frames.h"
#include "cale/text.h"
#include "report/runs.h"
#include "settings/config.h"
#include "settings/shell_text.h"
#include "sweep/settings.h"
#include "sweep/shell.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// What a run takes beside its replay: LibTorch, networks, optimisers and a batch at work.
constexpr std::int64_t kMemoryOfProcess = 900'000'000;
/// Configurations that a program is asked about in one command line.
constexpr std::size_t kGroupsAtOnce = 50;
/// Games and seeds in such a command line.
constexpr std::size_t kValuesAtOnce = 2'000;
/// What either may take of it. The command line is one argument of a shell, which Linux limits to 128 KiB.
constexpr std::size_t kBytesAtOnce = 50'000;
/// What a stored transition takes beside its frame: action, reward and bookkeeping.
constexpr std::int64_t kMemoryOfTransition = 350;

/// Agents whose programs lie in `folder`.
std::vector<std::string> agents_in(const fs::path& folder) {
    std::vector<std::string> agents;
    std::error_code ignored;
    for (const auto& item : fs::directory_iterator(folder, ignored)) {
        const auto name = item.path().filename().string();
        if (name.starts_with("train_") && item.path().extension().empty()) agents.push_back(name.substr(6));
    }
    std::ranges::sort(agents);
    return agents;
}

fs::path find_program(const std::string& agent, const fs::path& folder) {
    const auto name = "train_" + agent;
    if (::access((folder / name).c_str(), X_OK) == 0) return folder / name;
    const char* path = std::getenv("PATH");
    // An empty part, at its end too, is the working folder.
    for (const auto& other : path != nullptr ? split(path, ':') : std::vector<std::string>()) {
        auto file = fs::absolute(fs::path(other) / name);
        if (::access(file.c_str(), X_OK) == 0) return file;
    }
    const auto agents = agents_in(folder);
    const auto guess = nearest(agent, agents);
    auto others = fmt::format("there are {}", fmt::join(agents, ", "));
    if (agents.empty()) others = "nor is there any other";
    if (!guess.empty()) others = fmt::format("did you mean '{}'?", guess);
    throw ConfigError(fmt::format("agent '{}': there is no program {} in {} or on the PATH; {}", agent, name,
                                  folder.string(), others));
}

/// Returns a program's objection to a run. For a setting of the sweep's file it names the place there instead
/// of the option passed to the program; for a combination of settings it names the run.
std::string objection(const Sweep& sweep, const std::string& run, const std::string& sentence) {
    constexpr std::string_view option = ": --set ";
    const auto at = sentence.find(option);
    if (at == sentence.npos) return fmt::format("{}: {}: {}", sweep.name, run, sentence);
    const auto said = std::string_view(sentence).substr(at + option.size());
    for (const auto& [setting, place] : sweep.places) {
        if (said.starts_with(setting + ": "))
            return fmt::format("{}: {}{}", place, sentence.substr(0, at), said.substr(setting.size()));
    }
    return fmt::format("{}: {}", sweep.name, sentence);
}

/// Runs that differ in their game and seed alone, and what their program makes of their settings.
struct RunGroup {
    std::vector<std::string> assignments;  // without game and seed
    std::vector<std::string> one_of_them;  // game and seed of the first
    std::string example;                   // its name
    std::shared_ptr<const SettingTexts> settings{};
};

/// The documents that --print-config has printed, one for every configuration until one was wrong.
std::vector<std::string> documents(const std::string& printed) {
    constexpr std::string_view line = "\n---\n";
    std::vector<std::string> texts;
    std::size_t begin = 0;
    for (auto end = printed.find(line); end != printed.npos; end = printed.find(line, begin)) {
        texts.push_back(printed.substr(begin, end - begin));
        begin = end + line.size();
    }
    if (begin < printed.size()) texts.push_back(printed.substr(begin));
    return texts;
}

/// Asks the program for the settings of these groups, all at once, as LibTorch takes its time to load.
/// Throws ConfigError with the program's own sentence where it objects.
void print_configs(const Sweep& sweep, std::vector<std::string> command, std::span<RunGroup> groups) {
    command.emplace_back("--print-config");
    for (const auto& group : groups) {
        if (&group != &groups.front()) command.emplace_back("--or");
        command.insert(command.end(), group.one_of_them.begin(), group.one_of_them.end());
        command.insert(command.end(), group.assignments.begin(), group.assignments.end());
    }
    const auto text = shell_text(command);
    const auto answer = answer_of(text + " 2>/dev/null");
    const auto printed = documents(answer.text);
    if (answer.status != 0) {
        const auto sentence = without_line_end(answer_of(text + " 2>&1 >/dev/null").text);
        throw ConfigError(objection(sweep, groups[std::min(printed.size(), groups.size() - 1)].example,
                                    sentence.empty() ? text + " fails" : sentence));
    }
    if (printed.size() != groups.size())
        throw ConfigError(fmt::format("{}: {} prints {} configurations, not {}: it is of another version",
                                      sweep.name, command.front(), printed.size(), groups.size()));
    for (std::size_t i = 0; i < groups.size(); ++i)
        groups[i].settings = std::make_shared<SettingTexts>(settings_in(printed[i]));
}

/// Returns the bounds of [0, bytes.size()) cut into parts of at most `most`, and of kBytesAtOnce where each
/// takes so many bytes; at least one part, which may be empty.
std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> parts_of(std::span<const std::size_t> bytes,
                                                                std::size_t most) {
    std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> parts;
    std::size_t from = 0;
    do {
        auto to = from;
        for (std::size_t sum = 0; to < bytes.size() && to - from < most; ++to) {
            sum += bytes[to];
            if (to > from && sum > kBytesAtOnce) break;
        }
        parts.emplace_back(from, to);
        from = to;
    } while (from < bytes.size());
    return parts;
}

/// What they take in a command, with the quotes and the blank of each.
std::size_t bytes_of(std::span<const std::string> assignments) {
    std::size_t bytes = 0;
    for (const auto& text : assignments) bytes += text.size() + 3;
    return bytes;
}

/// A program and the configuration file that it reads, if any.
using Base = std::vector<std::string>;

Base base_of(const fs::path& program, const SweepRun& run) {
    Base base = {program.string()};
    if (!run.config.empty()) base.insert(base.end(), {"--config", run.config.string()});
    return base;
}

/// The runs of a base.
struct BaseRuns {
    std::vector<RunGroup> groups;                               // in the order of the sweep
    std::map<std::vector<std::string>, std::size_t> numbers{};  // assignments -> which of them
    std::set<std::string> games_and_seeds;                      // assignments, of all groups
};

/// Those of the run's game and seed, or all others, which are its group's.
std::vector<std::string> assignments_of(const SweepRun& run, bool game_and_seed) {
    std::vector<std::string> assignments;
    for (const auto& setting : run.settings)
        if (is_game_or_seed(setting.key) == game_and_seed) assignments.push_back(assignment(setting));
    return assignments;
}

void add_run(const SweepRun& run, BaseRuns& runs) {
    auto own = assignments_of(run, /*game_and_seed=*/true);
    runs.games_and_seeds.insert(own.begin(), own.end());
    auto assignments = assignments_of(run, /*game_and_seed=*/false);
    if (runs.numbers.emplace(assignments, runs.groups.size()).second)
        runs.groups.push_back(
            {.assignments = std::move(assignments), .one_of_them = std::move(own), .example = run.name});
}

const RunGroup& group_of(const SweepRun& run, const BaseRuns& runs) {
    return runs.groups[runs.numbers.at(assignments_of(run, /*game_and_seed=*/false))];
}

void check_rom(const SweepRun& run, const std::string& rom_dir) {
    try {
        static_cast<void>(find_rom(run.game, rom_dir));
    } catch (const std::exception& error) {
        throw ConfigError(fmt::format("env.game: {}", error.what()));
    }
}

/// Throws ConfigError where the settings do not fit the run's own game, such as a paddle that it lacks.
void check_game(const Sweep& sweep, const PlannedRun& planned) {
    auto env = env_of({planned.base->begin(), planned.base->end()});
    if (!env) return;
    env->game = planned.run.game;
    try {
        static_cast<void>(action_space(*env));
        if (is_variant(*env)) Env(*env, 0);
    } catch (const std::exception& error) {
        throw ConfigError(objection(sweep, planned.run.name, error.what()));
    }
}

/// Asks a program for the settings of all runs of a base. Many games and seeds are checked in one go: a
/// program reads its arguments in order. The length of a command is limited, so all groups are checked with
/// the first of them, and one group with the rest.
void ask_program(const Sweep& sweep, const Base& base, BaseRuns& runs) {
    const std::vector<std::string> values(runs.games_and_seeds.begin(), runs.games_and_seeds.end());
    std::vector<std::size_t> value_bytes, group_bytes;
    for (const auto& value : values) value_bytes.push_back(bytes_of({&value, 1}));
    for (const auto& group : runs.groups)
        group_bytes.push_back(bytes_of(group.assignments) + bytes_of(group.one_of_them));
    for (const auto& [from, to] : parts_of(value_bytes, kValuesAtOnce)) {
        auto command = base;
        command.insert(command.end(), values.begin() + from, values.begin() + to);
        const std::span groups(group_bytes);
        for (const auto& [first, last] : parts_of(from == 0 ? groups : groups.first(1), kGroupsAtOnce))
            print_configs(sweep, command, {runs.groups.begin() + first, runs.groups.begin() + last});
    }
}

/// Sets where the run ends and how much memory it takes, by the settings that its program printed.
void estimate(PlannedRun& planned) {
    const auto integer = [&](std::string_view key) {
        const auto* const text = planned_value(planned, key);
        return text != nullptr ? integer_in(*text) : 0;
    };
    planned.end = {.total_steps = integer("train.total_steps"), .evaluates = integer("eval.episodes") > 0};
    const auto* const capacity = planned_value(planned, "agent.replay_capacity");
    const auto stored =
        std::min(capacity != nullptr ? if_integer(*capacity).value_or(0) : 0, planned.end.total_steps);
    const auto* const seen = planned_value(planned, "env.obs");
    const auto frame = seen != nullptr && *seen == "ram" ? kRamSize : kFrameSize;
    planned.memory = kMemoryOfProcess + stored * (frame + kMemoryOfTransition);
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
    std::map<Base, BaseRuns> bases;
    for (const auto& run : sweep.runs) {
        if (!programs.contains(run.agent)) programs[run.agent] = find_program(run.agent, folder);
        add_run(run, bases[base_of(programs[run.agent], run)]);
    }
    for (auto& [base, runs] : bases) ask_program(sweep, base, runs);

    std::set<std::pair<std::string, std::string>> roms;
    std::set<std::pair<std::string, const SettingTexts*>> checked;  // games with what they are played with
    std::vector<PlannedRun> planned;
    for (const auto& run : sweep.runs) {
        const auto& program = programs.at(run.agent);
        PlannedRun next{
            .run = run, .program = program, .base = group_of(run, bases.at(base_of(program, run))).settings};
        const auto* rom_dir = planned_value(next, "env.rom_dir");
        const auto rom = std::pair(run.game, rom_dir != nullptr ? *rom_dir : "");
        if (roms.insert(rom).second) check_rom(run, rom.second);
        if (checked.emplace(run.game, next.base.get()).second) check_game(sweep, next);
        estimate(next);
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
    auto command = base_of(planned.program, planned.run);
    for (const auto& setting : planned.run.settings) command.push_back(assignment(setting));
    command.insert(command.end(), {"--run-dir", place.folder.string(), "--threads",
                                   std::to_string(place.threads), "--device", place.device, "--no-progress"});
    if (planned.until > 0) command.insert(command.end(), {"--until", std::to_string(planned.until)});
    if (resume) command.emplace_back("--resume");
    return command;
}

}  // namespace cale
