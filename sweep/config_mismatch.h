// Detects runs that were trained with other settings than the sweep has.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sweep/plan.h"
#include "sweep/run_folder.h"

namespace cale {

/// Returns why the run in `folder` is not the planned run: a sentence with every setting that differs, both
/// values and the remedy; or that it cannot be resumed, as files are missing, damaged or a user's. Empty if
/// nothing differs, or if the run has not begun.
///
/// Settings that change no result may differ, and the planned run may be longer, or shorter if the run has
/// gone no further. The comparison uses the run's config.yaml, which includes changes accepted on resume
/// (--accept-changes).
std::string config_mismatch(const PlannedRun& planned, const std::filesystem::path& folder);

/// Returns how the settings that a program wrote into the run's folder when it began differ from the planned
/// ones, in one sentence with the remedy: a file of its configuration was changed after the sweep had read
/// it. Settings that change no result may differ, train.total_steps may not. Empty where nothing differs,
/// nothing where none can be read yet.
std::optional<std::string> started_otherwise(const PlannedRun& planned, const std::filesystem::path& folder);

/// Returns a line "# refused: RUN: REASON"; nothing where there is no reason.
std::string refused_line(const PlannedRun& planned, std::string_view reason);
/// Returns one for each run that is refused by config_mismatch(). `folder` is the sweep's.
std::string refused_lines(std::span<const PlannedRun> runs, const std::filesystem::path& folder);

/// Where the planned run stands, RunPhase::refused among the answers.
RunStatus status_of(const PlannedRun& planned, const std::filesystem::path& folder);

}  // namespace cale
