#include "report/groups.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <functional>
#include <set>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "cale/text.h"
#include "report/ranges.h"

namespace cale {
namespace {

constexpr std::size_t kMostSettingsInALabel = 3;

using Runs = std::vector<const Run*>;

std::string_view short_name(std::string_view key) {
    return key.substr(key.rfind('.') + 1);
}

std::string value_of(const Run& run, const std::string& key) {
    return key == "agent" ? run.agent : setting_of(run, key);
}

std::set<std::string> keys_of(const Runs& runs) {
    std::set<std::string> keys;
    for (const auto* run : runs)
        for (const auto& [key, value] : run->settings) keys.insert(key);
    return keys;
}

std::vector<std::string> values_of(const Run& run, const std::vector<std::string>& keys) {
    return mapped(keys, [&](const std::string& key) { return value_of(run, key); });
}

std::set<std::vector<std::string>> different_values(const Runs& runs, const std::vector<std::string>& keys) {
    std::set<std::vector<std::string>> different;
    for (const auto* run : runs) different.insert(values_of(*run, keys));
    return different;
}

/// As few settings as tell apart all that differ: one that splits no group further is passed over, and one
/// that those behind it make needless.
std::vector<std::string> distinguishing_keys(const Runs& runs) {
    std::vector<std::string> chosen;
    std::size_t groups = 1;
    for (const auto& key : keys_of(runs)) {
        chosen.push_back(key);
        const auto split = different_values(runs, chosen).size();
        if (split == groups) chosen.pop_back();
        groups = split;
    }
    for (auto i = chosen.size(); i-- > 0;) {
        auto others = chosen;
        others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
        if (different_values(runs, others).size() == groups) chosen = std::move(others);
    }
    return chosen;
}

std::string label_part(const std::string& key, const std::string& value) {
    if (value.empty()) return fmt::format("no {}", short_name(key));
    const bool speaks_for_itself = std::isalpha(static_cast<unsigned char>(value.front())) != 0 &&
                                   value != "true" && value != "false" && value != "none";
    return speaks_for_itself ? value : fmt::format("{}={}", short_name(key), value);
}

std::string label_of(const Run& run, const std::vector<std::string>& keys) {
    const auto part = [&](const std::string& key) { return label_part(key, value_of(run, key)); };
    return joined(mapped(keys, part), ", ");
}

std::map<std::string, Runs> by_agent(const Runs& runs) {
    std::map<std::string, Runs> agents;
    for (const auto* run : runs) agents[run->agent].push_back(run);
    return agents;
}

/// For each run its label.
std::map<const Run*, std::string> labels_of_themselves(const Runs& runs) {
    std::map<const Run*, std::string> labels;
    const auto agents = by_agent(runs);
    for (const auto& [agent, own] : agents) {
        auto keys = distinguishing_keys(own);
        if (keys.size() > kMostSettingsInALabel) {
            const auto different = different_values(own, keys);
            for (const auto* run : own) {
                const auto place = std::distance(different.begin(), different.find(values_of(*run, keys)));
                labels[run] = fmt::format("{} {}", agent, place + 1);
            }
            continue;
        }
        if (agents.size() > 1 || keys.empty()) keys.insert(keys.begin(), "agent");
        for (const auto* run : own) labels[run] = label_of(*run, keys);
    }
    return labels;
}

std::string full_key(const std::string& wanted, const Runs& runs) {
    if (wanted == "agent") return wanted;
    const auto keys = keys_of(runs);
    if (keys.contains(wanted)) return wanted;
    std::vector<std::string> meant;
    for (const auto& key : keys)
        if (short_name(key) == wanted) meant.push_back(key);
    if (meant.size() == 1) return meant.front();
    if (meant.size() > 1)
        throw std::invalid_argument(
            fmt::format("--group-by {}: that may be {}", wanted, fmt::join(meant, " or ")));
    if (is_game_or_seed(wanted) || wanted == "game" || wanted == "seed")
        throw std::invalid_argument(
            fmt::format("--group-by {}: game and seed are what the runs of a group differ in; leave it "
                        "out: tables and curves are by game in any case",
                        wanted));
    auto differing = differing_keys(runs);
    if (by_agent(runs).size() > 1) differing.insert(differing.begin(), "agent");
    throw std::invalid_argument(fmt::format(
        "--group-by {}: no run has such a setting, or it has no effect on results; the runs differ "
        "in {}",
        wanted, differing.empty() ? "no setting" : joined(differing, ", ")));
}

bool all_agree(const SettingRow& row) {
    return std::ranges::all_of(row.values, [&](const auto& value) { return value == row.values.front(); });
}

}  // namespace

std::vector<Group> group_runs(std::vector<Run> runs, const std::vector<std::string>& keys) {
    Runs pointers;
    pointers.reserve(runs.size());
    for (const auto& run : runs)
        if (!run.is_recorded()) pointers.push_back(&run);
    std::map<const Run*, std::string> labels;
    if (keys.empty()) {
        labels = labels_of_themselves(pointers);
    } else {
        std::vector<std::string> full;
        for (const auto& key : keys) {
            auto name = full_key(key, pointers);
            if (std::ranges::find(full, name) == full.end()) full.push_back(std::move(name));
        }
        for (const auto* run : pointers) labels[run] = label_of(*run, full);
    }
    std::map<std::pair<std::string, bool>, Group> groups;  // a recorded one may have the label of another
    for (auto& run : runs) {
        const bool recorded = run.is_recorded();
        const auto label = recorded ? run.recorded_as : labels.at(&run);
        auto& group = groups[{label, recorded}];
        group.label = label;
        group.runs.push_back(std::move(run));
    }
    auto sorted = values_in(std::move(groups));
    std::ranges::stable_sort(sorted, natural_less, &Group::label);
    return sorted;
}

void rename_groups(std::vector<Group>& groups, const std::map<std::string, std::string>& names) {
    std::set<std::string> labels;
    for (const auto& group : groups) labels.insert(group.label);
    for (const auto& [label, name] : names)
        if (!labels.contains(label))
            throw std::invalid_argument(fmt::format("--name {0}={1}: no group is called {0}; there are {2}",
                                                    label, name, fmt::join(labels, "; ")));
    std::set<std::string> own, taken;
    for (const auto& group : groups)
        if (!group.is_recorded()) own.insert(group.label);
    for (auto& group : groups) {
        const auto name = names.find(group.label);
        const auto label = group.label;
        // Where a recorded group is called like one of the user's, that one is meant.
        if (name != names.end() && !(group.is_recorded() && own.contains(group.label)))
            group.label = name->second;
        if (!taken.insert(group.label).second)
            throw std::invalid_argument(
                fmt::format("two groups are called {}: give one of them another name by --name '{}=NAME'",
                            group.label, labels.contains(group.label) ? group.label : label));
    }
    // Recorded groups come last.
    std::ranges::stable_sort(groups, natural_less, &Group::label);
    std::stable_partition(groups.begin(), groups.end(), std::not_fn(&Group::is_recorded));
}

std::vector<std::string> missing_runs(const std::vector<Group>& groups) {
    std::set<std::string_view> games;
    std::set<std::uint64_t> seeds;
    const auto counts = [](const Run& run) { return !run.in_sweep_list && !run.is_recorded(); };
    for (const auto& group : groups) {
        for (const auto& run : group.runs) {
            if (!counts(run)) continue;
            games.insert(run.game->name);
            seeds.insert(run.seed);
        }
    }
    std::vector<std::string> missing;
    for (const auto& group : groups) {
        if (std::ranges::none_of(group.runs, counts)) continue;
        std::set<std::pair<std::string_view, std::uint64_t>> there;
        for (const auto& run : group.runs) there.emplace(run.game->name, run.seed);
        for (const auto game : games)
            for (const auto seed : seeds)
                if (!there.contains({game, seed}))
                    missing.push_back(fmt::format("{} on {}, seed {}", group.label, game, seed));
    }
    return missing;
}

std::vector<std::string> missing_runs(const std::vector<Run>& runs) {
    return missing_runs(group_runs(runs));
}

std::vector<std::string> differing_keys(const std::vector<const Run*>& runs) {
    std::vector<std::string> differing;
    for (const auto& key : keys_of(runs))
        if (different_values(runs, {key}).size() > 1) differing.push_back(key);
    return differing;
}

std::vector<std::string> partial_settings(const std::vector<Group>& groups) {
    Runs runs;
    for (const auto& group : groups)
        for (const auto& run : group.runs)
            if (!run.is_recorded()) runs.push_back(&run);
    std::vector<std::string> partial;
    for (const auto& [agent, own] : by_agent(runs)) {
        for (const auto& key : keys_of(own)) {
            if (!std::ranges::all_of(own, [&](const Run* run) { return run->settings.contains(key); }))
                partial.push_back(fmt::format("{}: {}", agent, key));
        }
    }
    return partial;
}

std::vector<SettingRow> all_settings(const std::vector<Group>& groups) {
    std::map<std::string, std::vector<std::set<std::string>>> values;
    for (std::size_t i = 0; i < groups.size(); ++i) {
        for (const auto& run : groups[i].runs) {
            for (const auto& [key, value] : run.settings) {
                auto& row = values[key];
                row.resize(groups.size());
                row[i].insert(value);
            }
        }
    }
    return mapped(values, [](const auto& row) {
        const auto all_of = [](const auto& some) { return joined(some, " / "); };
        return SettingRow{row.first, mapped(row.second, all_of)};
    });
}

std::vector<SettingRow> differing_settings(const std::vector<Group>& groups) {
    std::map<std::string, std::vector<std::size_t>> of_agents;  // groups of the user's, by agent
    for (std::size_t i = 0; i < groups.size(); ++i)
        if (!groups[i].is_recorded()) of_agents[groups[i].runs.front().agent].push_back(i);
    auto rows = all_settings(groups);
    std::erase_if(rows, [&](const SettingRow& row) {
        const bool of_all = std::ranges::find(row.values, "") == row.values.end();
        const auto tells_apart = [&](const auto& agent) {
            const auto& first = row.values[agent.second.front()];
            return std::ranges::any_of(agent.second,
                                       [&](std::size_t group) { return row.values[group] != first; });
        };
        return !(of_all && !all_agree(row)) && std::ranges::none_of(of_agents, tells_apart);
    });
    return rows;
}

std::vector<SettingRow> shared_settings(const std::vector<Group>& groups) {
    auto rows = all_settings(groups);
    std::erase_if(rows, [](const SettingRow& row) { return !all_agree(row); });
    return rows;
}

}  // namespace cale
