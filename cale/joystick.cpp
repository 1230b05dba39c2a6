#include "cale/joystick.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace cale {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr std::array<StickCoordinate, 3> kPolar{{{"radius", 0, 1}, {"theta", -kPi, kPi}, {"fire", 0, 1}}};
constexpr std::array<StickCoordinate, 3> kCartesian{{{"x", -1, 1}, {"y", -1, 1}, {"fire", 0, 1}}};
constexpr std::array<StickCoordinate, 4> kDirection{
    {{"cos_theta", -1, 1}, {"sin_theta", -1, 1}, {"radius", 0, 1}, {"fire", 0, 1}}};
constexpr std::array<StickCoordinate, 2> kPaddle{{{"position", 0, 1}, {"fire", 0, 1}}};

ContinuousAction at_position(float x, float y, float fire) {
    if (std::hypot(x, y) > 1) {
        // The stick slides along the gate.
        constexpr float kDiagonal = 0.70710678F;
        const bool wide = std::abs(x) >= std::abs(y);
        const float smaller = std::min(std::min(std::abs(x), std::abs(y)), kDiagonal);
        const float larger = std::sqrt(1 - smaller * smaller);
        x = std::copysign(wide ? larger : smaller, x);
        y = std::copysign(wide ? smaller : larger, y);
    }
    return {.radius = std::min(std::hypot(x, y), 1.0F), .theta = std::atan2(y, x), .fire = fire};
}

void check(const StickCoordinate& coordinate, float value) {
    // Written so that NaN, which compares false to everything, is refused too.
    if (value >= coordinate.low && value <= coordinate.high) return;
    std::ostringstream message;
    message.precision(9);
    message << "the action's " << coordinate.name << " is " << value << ": it must lie in [" << coordinate.low
            << ", " << coordinate.high << "]";
    throw std::invalid_argument(message.str());
}

}  // namespace

std::span<const std::string_view> names_of(Joystick) {
    static constexpr std::string_view kNames[] = {"polar", "cartesian", "direction", "factored", "paddle"};
    return kNames;
}

std::span<const StickCoordinate> stick_coordinates(Joystick joystick) {
    switch (joystick) {
        case Joystick::polar:
            return kPolar;
        case Joystick::cartesian:
            return kCartesian;
        case Joystick::direction:
            return kDirection;
        case Joystick::paddle:
            return kPaddle;
        case Joystick::factored:
            break;
    }
    return {};
}

ActionSpace joystick_space(Joystick joystick) {
    if (joystick == Joystick::factored) {
        return Discrete{.n = kEventCount, .factors = {3, 3, 2}};
    }
    Box box;
    for (const auto& [name, low, high] : stick_coordinates(joystick)) {
        box.low.push_back(low);
        box.high.push_back(high);
        box.names.emplace_back(name);
    }
    for (std::int64_t action = 0; action < kEventCount; ++action) {
        const bool centred = action / 2 % 3 == 1;  // of the vertical axis, which a paddle lacks
        if (joystick == Joystick::paddle && !centred) continue;
        const auto landmark = coordinates_of(joystick, factored_stick(action));
        box.landmarks.insert(box.landmarks.end(), landmark.begin(), landmark.end());
    }
    return box;
}

ContinuousAction stick(Joystick joystick, std::span<const float> action) {
    const auto coordinates = stick_coordinates(joystick);
    if (coordinates.empty())
        throw std::invalid_argument("a factored action is a number, and has no coordinates");
    if (action.size() != coordinates.size()) {
        throw std::invalid_argument("an action has " + std::to_string(coordinates.size()) +
                                    " coordinates, not " + std::to_string(action.size()));
    }
    if (joystick == Joystick::polar) {
        const ContinuousAction polar{action[0], action[1], action[2]};
        validate(polar);
        return polar;
    }
    for (std::size_t i = 0; i < action.size(); ++i) check(coordinates[i], action[i]);
    if (joystick == Joystick::cartesian) return at_position(action[0], action[1], action[2]);
    if (joystick == Joystick::paddle)
        return at_position(static_cast<float>(2 * double{action[0]} - 1), 0, action[1]);
    return {.radius = action[2], .theta = std::atan2(action[1], action[0]), .fire = action[3]};
}

std::vector<float> coordinates_of(Joystick joystick, const ContinuousAction& action) {
    const float x = std::cos(action.theta), y = std::sin(action.theta);
    switch (joystick) {
        case Joystick::polar:
            return {action.radius, action.theta, action.fire};
        case Joystick::cartesian:
            return {action.radius * x, action.radius * y, action.fire};
        case Joystick::direction:
            return {x, y, action.radius, action.fire};
        case Joystick::paddle:
            return {static_cast<float>(paddle_position(action.radius * x)), action.fire};
        case Joystick::factored:
            break;
    }
    return {};
}

ContinuousAction factored_stick(std::int64_t action) {
    if (action < 0 || action >= kEventCount) {
        throw std::out_of_range("there is no action " + std::to_string(action) +
                                " among the 18 of the factored joystick");
    }
    const auto x = action / 6 - 1, y = action / 2 % 3 - 1;
    return at_position(static_cast<float>(x), static_cast<float>(y), static_cast<float>(action % 2));
}

std::span<const Event> factored_events() {
    static const auto events = [] {
        std::array<Event, kEventCount> all{};
        for (std::int64_t action = 0; action < kEventCount; ++action)
            all[static_cast<std::size_t>(action)] = joystick_event(factored_stick(action), 0.5F);
        return all;
    }();
    return events;
}

ContinuousAction event_stick(Event event) {
    const auto events = factored_events();
    return factored_stick(std::ranges::find(events, event) - events.begin());
}

}  // namespace cale
