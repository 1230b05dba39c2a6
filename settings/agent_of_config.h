// Whose configuration a file is.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace cale {

/// The training programs, such as "train_sac", that take this file as it is.
std::vector<std::string> programs_that_take(const std::filesystem::path& config_file);

}  // namespace cale
