#include "replay/types.h"

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>

namespace cale {

std::span<const std::string_view> names_of(ReplayTerminal) {
    static constexpr std::string_view names[] = {"corrected", "dopamine"};
    return names;
}

void require_finite_rewards(std::span<const StepResult> results) {
    for (std::size_t env = 0; env < results.size(); ++env) {
        if (std::isfinite(results[env].reward)) continue;
        throw std::invalid_argument("the reward of environment " + std::to_string(env) + " is " +
                                    std::to_string(results[env].reward));
    }
}

}  // namespace cale
