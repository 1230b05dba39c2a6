// Hyper-parameters that change while training goes on.
#pragma once

#include <cstdint>

namespace cale {

/// The probability of a random action after `step` decisions: 1 for `warmup_steps`, then
/// linearly down to `final` within `decay_period` (Mnih et al. 2015).
double linearly_decaying_epsilon(std::int64_t decay_period, std::int64_t step, std::int64_t warmup_steps,
                                 double final);

}  // namespace cale
