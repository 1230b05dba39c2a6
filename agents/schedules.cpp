#include "agents/schedules.h"

#include <algorithm>

namespace cale {

double linearly_decaying_epsilon(std::int64_t decay_period, std::int64_t step, std::int64_t warmup_steps,
                                 double final) {
    const auto steps_left = static_cast<double>(decay_period + warmup_steps - step);
    const double bonus = (1 - final) * steps_left / static_cast<double>(decay_period);
    return final + std::clamp(bonus, 0.0, 1 - final);
}

}  // namespace cale
