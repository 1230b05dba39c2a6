#include "train/resume.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include <fmt/format.h>

#include "cale/games.h"
#include "cale/text.h"
#include "settings/yaml.h"
#include "storage/files.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// "step_000250000" or "step_000250000.csv" as 250000.
std::optional<std::int64_t> step_in(std::string_view name, std::string_view ending) {
    if (!name.starts_with("step_") || !name.ends_with(ending)) return std::nullopt;
    name.remove_prefix(5);
    if (name.size() < ending.size()) return std::nullopt;
    name.remove_suffix(ending.size());
    return number_in<std::int64_t>(name);
}

/// The keys of a configuration. None if it is damaged, or extends others.
std::optional<std::set<std::string>> keys_in(const fs::path& file) {
    std::set<std::string> keys;
    try {
        for (const auto& section : parse_yaml(read_file(file))) {
            if (section.first.as<std::string>() == "extends") return std::nullopt;
            for (const auto& setting : section.second)
                keys.insert(section.first.as<std::string>() + "." + setting.first.as<std::string>());
        }
    } catch (const std::exception&) {
        return std::nullopt;
    }
    return keys;
}

/// Whether both spell the same games. Worlds that are no Atari games have others.
bool same_games(std::string_view a, std::string_view b) {
    try {
        return game_names(a) == game_names(b);
    } catch (const std::invalid_argument&) {
        return false;
    }
}

}  // namespace

std::optional<std::int64_t> checkpoint_step(const fs::path& folder) {
    return step_in(folder.filename().native(), "");
}

std::string change_of_run(std::string_view key, std::string_view before, std::string_view now,
                          std::string_view schedule_over_run) {
    if (key == "env.game" && same_games(before, now)) return "";
    const bool scheduled = key == "train.total_steps" && !schedule_over_run.empty();
    if (!scheduled && std::ranges::find(kMayDifferOnResume, key) != kMayDifferOnResume.end()) return "";
    return fmt::format("{} was {} and is now {}{}", key, before, now,
                       scheduled ? fmt::format(", which changes the schedule of {}", schedule_over_run) : "");
}

std::vector<std::string> missing_settings(const fs::path& file, const fs::path& whole) {
    const auto here = keys_in(file), all = keys_in(whole);
    std::vector<std::string> missing;
    if (here && all) std::ranges::set_difference(*all, *here, std::back_inserter(missing));
    return missing;
}

std::optional<std::int64_t> newest_step(const fs::path& folder, std::string_view ending) {
    std::optional<std::int64_t> newest;
    std::error_code ignored;
    for (const auto& item : fs::directory_iterator(folder, ignored))
        newest = std::max(newest, step_in(item.path().filename().native(), ending));
    return newest;
}

std::optional<std::int64_t> newest_checkpoint(const fs::path& run) {
    return newest_step(run / "checkpoints", "");
}

}  // namespace cale
