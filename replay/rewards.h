// What every memory asks of the rewards that it is given.
#pragma once

#include <span>

#include "world/step_result.h"

namespace cale {

/// Throws std::invalid_argument, naming the environment and the value, for a reward that is no finite number.
void require_finite_rewards(std::span<const StepResult> results);

}  // namespace cale
