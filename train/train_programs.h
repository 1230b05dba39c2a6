// The training programs, for their completion.
#pragma once

#include <vector>

#include "experiment/completion.h"

namespace cale {

/// What each of them understands. Its source is made by CMake from the list in CMakeLists.txt.
std::vector<CommandWords> train_programs();

}  // namespace cale
