// What metadata.json, the record of a run's sessions, says.
#pragma once

#include <filesystem>
#include <string>

namespace cale {

/// Returns the text under `key` in the run's metadata.json; empty where there is none, or the file is
/// damaged. Throws std::system_error where it cannot be read.
std::string metadata_text(const std::filesystem::path& run_dir, const char* key);

}  // namespace cale
