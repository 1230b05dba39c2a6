// What a run's folder is, and which of a run's settings may change on resume.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace cale {

/// Returns "agent.gamma was 0.99 and is now 0.5", or "" if the setting may differ on resume: kWithoutEffect
/// (report/runs.h), eval.noop_max, the run's length, another spelling of the game. `schedule_over_run`: the
/// key of the setting by which a schedule lasts for the whole run, so that its length must not change; empty:
/// there is none.
std::string change_of_run(std::string_view key, std::string_view before, std::string_view now,
                          std::string_view schedule_over_run);

/// Returns "runs/1/config.yaml lacks agent.gamma: it was cut or edited since; copy ... there" where the
/// configuration `whole` has keys that `file` lacks, as one that was cut short does. Else, and where one of
/// them is no configuration or extends others, "".
std::string lacks(const std::filesystem::path& file, const std::filesystem::path& whole);

/// Returns "--resume --run-dir 'my runs/1'", as it can be typed.
std::string resume_options(const std::filesystem::path& run_dir);

/// Returns whether this is a run's folder: whether it has what a run writes first.
bool has_run_record(const std::filesystem::path& folder);

/// Returns the nearest folder above that is a run's; empty: none is.
std::filesystem::path run_above(const std::filesystem::path& folder);

/// Returns the step of a run's newest checkpoint; none if it has none.
std::optional<std::int64_t> newest_checkpoint_step(const std::filesystem::path& run);

}  // namespace cale
