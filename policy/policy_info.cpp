#include "policy/policy_info.h"

#include <algorithm>
#include <cmath>

namespace cale {

void set_observation(PolicyInfo& info, const std::vector<std::int64_t>& shape) {
    info.stack = shape.front();
    info.frame_height = shape.size() == 3 ? shape[1] : 1;
    info.frame_width = shape.back();
}

std::vector<std::int64_t> observation_shape(const PolicyInfo& info) {
    if (info.frame_height == 1) return {info.stack, info.frame_width};
    return {info.stack, info.frame_height, info.frame_width};
}

bool is_agent_name(std::string_view name) {
    const auto is_plain = [](char c) {
        return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' ||
               c == '-';
    };
    constexpr std::size_t kLongest = 64;
    return !name.empty() && name.size() <= kLongest && std::ranges::all_of(name, is_plain);
}

bool draws(const PolicyInfo& info, Choice choice) {
    return choice == Choice::sampled || (choice == Choice::as_evaluated && info.evaluation_samples);
}

Decision decision(const PolicyInfo& info, const ContinuousAction& stick) {
    if (info.joystick == Joystick::paddle) {
        const auto position = paddle_position(stick.radius * std::cos(stick.theta));
        const bool fire = stick.fire > static_cast<float>(info.threshold);
        return {.stick = stick,
                .event = fire ? Event::fire : Event::noop,
                .paddle = static_cast<float>(position)};
    }
    return {.stick = stick,
            .event = joystick_event(stick, static_cast<float>(info.threshold), info.event_map),
            .strength = info.radius_is_strength ? stick.radius : 1};
}

Decision decision(const PolicyInfo& info, std::int64_t action) {
    if (info.joystick == Joystick::factored) {
        auto factored = decision(info, factored_stick(action));
        factored.action = action;
        return factored;
    }
    return {.action = action, .event = info.actions.at(static_cast<std::size_t>(action))};
}

}  // namespace cale
