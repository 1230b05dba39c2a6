// The training programs, for completion and for help with misspelt commands.
#pragma once

#include <vector>

#include "tools/completion.h"

namespace cale {

/// Returns what each training program of this library understands.
std::vector<CommandWords> train_programs();

}  // namespace cale
