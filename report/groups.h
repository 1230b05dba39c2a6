// Groups of runs with the same settings.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "report/runs.h"

namespace cale {

/// Runs that differ only in game and seed, or in settings that the user chose to ignore.
struct Group {
    std::string label{};
    std::vector<Run> runs{};

    /// Whether its runs are rows of a table (recorded_runs.h).
    bool is_recorded() const { return runs.front().is_recorded(); }
};

/// Without `keys`: runs of the same agent with the same settings are a group, and its label is the agent
/// with the settings that tell it from the agent's other groups; where more than three are needed, a
/// number, and differing_settings() tells more. Recorded runs keep the name of their group. With `keys`
/// ("agent", "agent.encoder", or "encoder" for short): runs that agree in these are a group, whatever else
/// differs. Throws std::invalid_argument for a key that no run has, naming those in which the runs differ,
/// for a short one that may be several, and for the game and the seed.
std::vector<Group> group_runs(std::vector<Run> runs, const std::vector<std::string>& keys = {});

/// Gives groups the names to which `names` maps their labels, and sorts them again, recorded ones last.
/// Throws std::invalid_argument for a label that no group has, naming those that there are, and where two
/// groups then have the same name. Where a recorded group has the label of one of the user's, the latter is
/// meant.
void rename_groups(std::vector<Group>& groups, const std::map<std::string, std::string>& names);

/// The runs without which not every group has been trained on every game with every seed that any of them
/// has: "sac on Pong, seed 3". Recorded runs are passed over, and those that are in the list of a sweep, as
/// that list says which are missing.
std::vector<std::string> missing_runs(const std::vector<Group>& groups);
/// The same of the groups that group_runs() makes of them without keys.
std::vector<std::string> missing_runs(const std::vector<Run>& runs);

/// The settings in which runs differ, by key; not the agent.
std::vector<std::string> differing_keys(const std::vector<const Run*>& runs);

/// The settings that some runs of an agent have and others, of another version, lack: "sac: agent.padding".
std::vector<std::string> partial_settings(const std::vector<Group>& groups);

struct SettingRow {
    std::string key{};
    std::vector<std::string> values{};  // by group; where its runs differ, all of them
};

/// All settings by key; a group without one has an empty value.
std::vector<SettingRow> all_settings(const std::vector<Group>& groups);
/// The settings that every group has, none of them empty, and in which groups differ; and those in which
/// groups of the same agent differ, which other agents may lack.
std::vector<SettingRow> differing_settings(const std::vector<Group>& groups);
/// Those that every group has, none of them empty, with the same value or, where its runs differ, the same
/// values.
std::vector<SettingRow> shared_settings(const std::vector<Group>& groups);

}  // namespace cale
