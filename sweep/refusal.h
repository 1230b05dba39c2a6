// Runs that were trained with other settings than the sweep has: it would pass them off as its own.
#pragma once

#include <filesystem>
#include <string>

#include "sweep/plan.h"
#include "sweep/run_folder.h"

namespace cale {

/// Why what has been trained in `folder` is not the planned run: a sentence with every setting that differs,
/// both values and the way out. Empty where nothing differs, or nothing counts yet for want of a checkpoint.
///
/// Settings that change no result may differ, and the planned run may be longer. Changes that a resumed run
/// was told to accept are part of its config.yaml, which is what is compared.
std::string refusal(const PlannedRun& planned, const std::filesystem::path& folder);

/// Where the planned run stands, RunPhase::refused among the answers.
RunStatus status_of(const PlannedRun& planned, const std::filesystem::path& folder);

}  // namespace cale
