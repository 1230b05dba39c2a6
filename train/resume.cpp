#include "train/resume.h"

#include <algorithm>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "cale/games.h"
#include "cale/text.h"
#include "report/runs.h"
#include "settings/setting_texts.h"
#include "settings/shell_text.h"
#include "storage/files.h"
#include "storage/step_name.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// The settings of a configuration. None if it is damaged, or extends others.
std::optional<SettingTexts> settings_of(const fs::path& file) {
    try {
        return settings_in(read_file(file));
    } catch (const std::exception&) {
        return std::nullopt;
    }
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

std::string change_of_run(std::string_view key, std::string_view before, std::string_view now,
                          std::string_view schedule_over_run) {
    if (key == "env.game" && same_games(before, now)) return "";
    const bool scheduled = key == "train.total_steps" && !schedule_over_run.empty();
    const bool may_differ = key == "train.total_steps" || key == "eval.noop_max" ||
                            std::ranges::find(kWithoutEffect, key) != kWithoutEffect.end();
    if (may_differ && !scheduled) return "";
    return fmt::format("{} was {} and is now {}{}", key, before, now,
                       scheduled ? fmt::format(", which changes the schedule of {}", schedule_over_run) : "");
}

std::string lacks(const fs::path& file, const fs::path& whole) {
    const auto here = settings_of(file), all = settings_of(whole);
    if (!here || !all) return "";
    std::vector<std::string> missing;
    for (const auto& [key, value] : *all)
        if (!here->contains(key)) missing.push_back(key);
    if (missing.empty()) return "";
    return fmt::format(
        "{} lacks {}{}: it was cut or edited since; copy {} there", file.string(), missing.front(),
        missing.size() > 1 ? " and " + counted(missing.size() - 1, "other") : "", whole.string());
}

std::string resume_options(const fs::path& run_dir) {
    return shell_text(std::vector<std::string>{"--resume", "--run-dir", run_dir.string()});
}

bool has_run_record(const fs::path& folder) {
    std::error_code unreadable;  // then it is not known to be one
    return fs::exists(folder / "config.yaml", unreadable) && fs::exists(folder / "metadata.json", unreadable);
}

fs::path run_above(const fs::path& folder) {
    const auto path = without_slash(fs::absolute(folder));
    for (auto above = path.parent_path(); above != above.parent_path(); above = above.parent_path())
        if (has_run_record(above)) return above;
    return {};
}

std::optional<std::int64_t> newest_checkpoint_step(const fs::path& run) {
    return newest_step(run / "checkpoints");
}

}  // namespace cale
