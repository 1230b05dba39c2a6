#include "sweep/config_mismatch.h"

#include <cstdint>
#include <exception>
#include <optional>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "cale/text.h"
#include "report/runs.h"
#include "settings/setting_texts.h"
#include "storage/files.h"
#include "storage/metadata_text.h"
#include "storage/step_name.h"
#include "sweep/run_folder.h"
#include "sweep/settings.h"
#include "train/checkpoint.h"
#include "train/resume.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// What is trained in a folder.
struct Trained {
    std::optional<std::int64_t> steps;  // agent steps of the newest checkpoint; none: it has only begun
    SettingTexts settings;
    /// See agents/agent.h. An older version did not record it; the program then objects on resume.
    std::string schedule_over_run;
};

Trained trained_in(const fs::path& folder, std::optional<std::int64_t> steps) {
    return {.steps = steps,
            .settings = settings_in(read_file(folder / "config.yaml")),
            .schedule_over_run = metadata_text(folder, "schedule_over_run")};
}

/// "agent.loss was huber and is now mse"; empty where the setting does not differ, or may.
std::string change(const std::string& key, const std::string& before, const std::string& now,
                   const Trained& trained) {
    if (same_value(before, now)) return "";
    auto text = change_of_run(key, before, now, trained.schedule_over_run);
    // A run begins as long as planned. It can be made longer, and shorter as long as it has not gone further.
    if (text.empty() && key == "train.total_steps" &&
        (!trained.steps || (integer_in(now) < integer_in(before) && integer_in(now) < *trained.steps)))
        text = fmt::format("{} was {} and is now {}", key, before, now);
    return text;
}

/// All of them, as a list for a sentence.
std::string changes(const PlannedRun& planned, const Trained& trained) {
    std::string text;
    for (const auto& [key, value] : trained.settings) {
        const auto* wanted = planned_value(planned, key);
        if (wanted == nullptr) continue;
        // Of a run that has only begun the plan is the older.
        const auto different =
            trained.steps ? change(key, value, *wanted, trained) : change(key, *wanted, value, trained);
        if (!different.empty()) text += (text.empty() ? "" : ", ") + different;
    }
    return text;
}

}  // namespace

std::string config_mismatch(const PlannedRun& planned, const fs::path& folder) {
    // In this order: a run that another process begins meanwhile has a checkpoint when it has results, or
    // anything else that is strange without one.
    bool has_results = false;
    try {
        has_results = has_begun(folder);
    } catch (const fs::filesystem_error& error) {
        return fmt::format("its folder cannot be read: {}: {}", error.path1().string(),
                           error.code().message());
    } catch (const std::exception& error) {
        return fmt::format("its folder cannot be read: {}", error.what());
    }
    const auto strange = strange_file(folder);
    const auto checkpoints = list_checkpoints(folder);
    const auto step = checkpoints.empty() ? std::nullopt : step_in(checkpoints.back());
    if (!step && !strange.empty())
        return fmt::format(
            "its folder has no checkpoint and holds '{}', which starting the run would delete; "
            "move that away, or give the sweep another --dir",
            printable(strange));
    if (!step && has_results)
        return "it holds results and no checkpoint to resume from, and starting it again would delete them; "
               "move its folder away, or give the sweep another --dir";
    if (!step) return "";
    try {
        if (auto lack = lacks(folder / "config.yaml", checkpoints.back() / "config.yaml"); !lack.empty())
            return lack;
        const auto text = changes(planned, trained_in(folder, step));
        if (!text.empty())
            return fmt::format(
                "trained with other settings: {}; give the sweep another --dir, or take the change back",
                text);
        if (!fs::exists(folder / "episodes.csv"))
            return "its episodes.csv is missing; put it back, or remove the run's folder";
        if (fs::file_size(folder / "episodes.csv") < episode_bytes_at(checkpoints.back()))
            return "its episodes.csv is shorter than at its newest checkpoint; put the whole one back, or "
                   "remove the run's folder";
        return "";
    } catch (const std::exception& error) {
        return fmt::format(
            "its files do not say what it was trained with ({}); put that back, or remove the run's folder",
            error.what());
    }
}

std::optional<std::string> started_otherwise(const PlannedRun& planned, const fs::path& folder) {
    Trained begun;
    try {
        begun = trained_in(folder, /*steps=*/std::nullopt);
    } catch (const std::exception&) {
        return std::nullopt;  // nothing is written yet
    }
    const auto text = changes(planned, begun);
    if (text.empty()) return "";
    return fmt::format(
        "its program read other settings than the sweep: {}; a file of its configuration was changed "
        "meanwhile, so start the sweep again",
        text);
}

RunStatus status_of(const PlannedRun& planned, const fs::path& folder) {
    auto status = status_of(folder, planned.end);
    if (auto reason = config_mismatch(planned, folder); !reason.empty()) {
        status.state = RunPhase::refused;
        status.message = std::move(reason);
    }
    return status;
}

std::string refused_line(const PlannedRun& planned, std::string_view reason) {
    return reason.empty() ? "" : fmt::format("# refused: {}: {}\n", planned.run.name, printable(reason));
}

std::string refused_lines(std::span<const PlannedRun> runs, const fs::path& folder) {
    std::string lines;
    for (const auto& planned : runs)
        lines += refused_line(planned, config_mismatch(planned, folder / planned.run.name));
    return lines;
}

}  // namespace cale
