#include "policy/policy_info.h"

#include <stdexcept>

namespace cale {

Decision decision(const PolicyInfo& info, const ContinuousAction& stick) {
    return {.stick = stick,
            .event = joystick_event(stick, static_cast<float>(info.threshold), info.event_map),
            .strength = info.radius_is_strength ? stick.radius : 1};
}

Decision decision(const PolicyInfo& info, std::int64_t action) {
    return {.action = action, .event = info.actions.at(static_cast<std::size_t>(action))};
}

}  // namespace cale
