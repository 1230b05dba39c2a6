// The names of what a run makes at an agent step: checkpoints, evaluations, films.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cale {

/// Returns "step_000250000".
std::string step_name(std::int64_t step);

/// Returns 250000 for a path whose last part is "step_000250000`ending`", however many digits there are. None
/// for another name.
std::optional<std::int64_t> step_in(const std::filesystem::path& path, std::string_view ending = "");

/// Returns what the folder holds under such names, oldest first; nothing if there is no folder. Throws
/// std::filesystem::filesystem_error where it cannot be read.
std::vector<std::filesystem::path> named_by_step(const std::filesystem::path& folder,
                                                 std::string_view ending = "");

/// Returns the largest step among the names with this ending in the folder; none if there is no such name, or
/// no folder that can be read.
std::optional<std::int64_t> newest_step(const std::filesystem::path& folder, std::string_view ending = "");

}  // namespace cale
