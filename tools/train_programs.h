// The training programs, for completion and for help with misspelt commands.
#pragma once

#include <vector>

#include "tools/completion.h"

namespace cale {

/// Returns the options and settings of each training program of this library.
std::vector<CommandWords> train_programs();

}  // namespace cale
