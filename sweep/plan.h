// From the runs of a sweep to the commands that train them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "settings/setting_texts.h"
#include "sweep/run_folder.h"
#include "sweep/sweep_file.h"

namespace cale {

/// A run, and its program's description of it.
struct PlannedRun {
    SweepRun run;
    std::filesystem::path program;  // .../bin/train_sac
    RunEnd end{};
    std::int64_t until = 0;   // agent step at which it pauses; 0: none
    std::int64_t memory = 0;  // bytes that it will take, estimated: the replay once it is full, and the rest
    // All settings as its program prints them, which runs share that differ in game and seed alone;
    // run.settings go before.
    std::shared_ptr<const SettingTexts> base{};
};

/// What a setting of the run is to be; nullptr where its program has no such setting.
const std::string* planned_value(const PlannedRun& planned, std::string_view key);

/// Asks the program of every agent for the settings of every run, which it checks: keys, types, ranges, and
/// whether they fit together. Looks for the programs in `folder`, then on the PATH, and for the ROM of every
/// game.
/// Throws ConfigError, one sentence, for the first thing that is wrong: nothing has been started then.
std::vector<PlannedRun> plan(const Sweep& sweep, const std::filesystem::path& folder);

/// Bytes of the largest of them; 1 if there are none.
std::int64_t largest_memory(std::span<const PlannedRun> runs);

/// How a run is started.
struct RunPlace {
    std::filesystem::path folder;  // of the run
    int threads = 1;
    std::string device = "auto";
};

/// Returns the arguments of a run's process, the program first. `resume`: from its newest checkpoint.
std::vector<std::string> command_of(const PlannedRun& planned, const RunPlace& place, bool resume);

}  // namespace cale
