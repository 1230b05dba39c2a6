// What metadata.json, the record of a run's sessions, says.
#pragma once

#include <filesystem>
#include <string>

namespace cale {

/// Returns the text under `key` in the run's metadata.json; empty where there is none, or the file is
/// damaged. Throws std::system_error where it cannot be read.
std::string metadata_text(const std::filesystem::path& run_dir, const char* key);

/// Returns whether metadata.json says that the run's newest session did not come to the run's end. Throws as
/// metadata_text() does.
bool metadata_say_unfinished(const std::filesystem::path& run_dir);

}  // namespace cale
