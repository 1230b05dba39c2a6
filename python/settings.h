// The settings of an environment by name, as keyword arguments need them.
#pragma once

#include <string>
#include <string_view>

#include "cale/env.h"

namespace cale::python {

/// Reads a setting from text, as YAML and the command line do. Throws std::out_of_range for an unknown name
/// and std::invalid_argument for a value that is not allowed, both with the sentence to show.
void set(EnvConfig& config, std::string_view name, std::string_view text);

/// Returns a text. Where two configurations share it, a game takes the same course in both.
std::string course_of_games(const EnvConfig& config);

}  // namespace cale::python
