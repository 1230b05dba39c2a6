// Groups of runs with the same settings.
#pragma once

#include <string>
#include <vector>

#include "report/runs.h"

namespace cale {

/// Runs that differ only in game and seed, or in settings that the user chose to ignore.
struct Group {
    std::string label{};
    std::vector<Run> runs{};
};

/// Without `keys`: runs of the same agent with the same settings are a group, and its label is the agent
/// with the settings that tell it from the agent's other groups; where more than three are needed, a
/// number, and differing_settings() tells more. With `keys` ("agent", "agent.encoder", or "encoder"
/// for short): runs that agree in these are a group, whatever else differs.
/// Throws std::invalid_argument for a key that no run has, naming those in which the runs differ.
std::vector<Group> group_runs(std::vector<Run> runs, const std::vector<std::string>& keys = {});

/// The runs without which not every group has been trained on every game with every seed that any of them
/// has: "sac on Pong, seed 3". Groups are those that group_runs() makes without keys. Runs that are in the
/// list of a sweep are passed over, as that list says which are missing.
std::vector<std::string> missing_runs(const std::vector<Run>& runs);

struct SettingRow {
    std::string key{};
    std::vector<std::string> values{};  // by group; where its runs differ, all of them
};

/// All settings by key; a group without one has an empty value.
std::vector<SettingRow> all_settings(const std::vector<Group>& groups);
/// The settings that every group has and in which groups differ.
std::vector<SettingRow> differing_settings(const std::vector<Group>& groups);
/// Those that every group has, with the same value or, where its runs differ, the same values.
std::vector<SettingRow> shared_settings(const std::vector<Group>& groups);

}  // namespace cale
