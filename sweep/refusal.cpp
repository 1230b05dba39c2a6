#include "sweep/refusal.h"

#include <algorithm>
#include <cstdint>
#include <exception>
#include <utility>

#include <fmt/format.h>

#include "experiment/files.h"
#include "experiment/resume.h"
#include "sweep/settings.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// `trained_steps`: agent steps of the run's newest checkpoint.
bool differs(const std::string& key, const std::string& trained, const std::string& planned,
             std::int64_t trained_steps) {
    // A run can be made longer, and shorter as long as it has not gone further.
    if (key == "train.total_steps")
        return integer_in(planned) < integer_in(trained) && integer_in(planned) < trained_steps;
    return std::ranges::find(kMayDifferOnResume, key) == kMayDifferOnResume.end() &&
           !same_value(trained, planned);
}

/// "agent.loss was huber and is now mse, ..."; empty where nothing differs.
std::string changes(const PlannedRun& planned, const SettingTexts& trained, std::int64_t trained_steps) {
    std::string text;
    for (const auto& [key, before] : trained) {
        const auto* now = planned_value(planned, key);
        if (now == nullptr || !differs(key, before, *now, trained_steps)) continue;
        text += fmt::format("{}{} was {} and is now {}", text.empty() ? "" : ", ", key, before, *now);
    }
    return text;
}

}  // namespace

std::string refusal(const PlannedRun& planned, const fs::path& folder) {
    const auto step = newest_checkpoint(folder);
    if (!step) return "";
    try {
        const auto text = changes(planned, settings_in(read_file(folder / "config.yaml")), *step);
        if (text.empty()) return "";
        return fmt::format(
            "trained with other settings: {}; give the sweep another --dir, or take the change back", text);
    } catch (const std::exception& error) {
        return fmt::format(
            "its config.yaml does not say what it was trained with ({}); put it back, or remove the run's "
            "folder",
            error.what());
    }
}

RunStatus status_of(const PlannedRun& planned, const fs::path& folder) {
    auto status = status_of(folder, planned.total_steps, planned.evaluates);
    if (auto reason = refusal(planned, folder); !reason.empty()) {
        status.state = RunPhase::refused;
        status.message = std::move(reason);
    }
    return status;
}

}  // namespace cale
