// Which training programs accept a configuration file.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace cale {

/// Returns the training programs, such as "train_sac", that accept this file unchanged.
std::vector<std::string> programs_that_take(const std::filesystem::path& config_file);

}  // namespace cale
