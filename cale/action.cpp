#include "cale/action.h"

#include <array>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>

namespace cale {
namespace {

constexpr std::array<std::string_view, kEventCount> kEventNames{
    "NOOP",     "FIRE",     "UP",          "RIGHT",      "LEFT",          "DOWN",
    "UPRIGHT",  "UPLEFT",   "DOWNRIGHT",   "DOWNLEFT",   "UPFIRE",        "RIGHTFIRE",
    "LEFTFIRE", "DOWNFIRE", "UPRIGHTFIRE", "UPLEFTFIRE", "DOWNRIGHTFIRE", "DOWNLEFTFIRE",
};

// By vertical, then horizontal direction: down, centre, up by left, centre, right.
constexpr Event kDirections[3][3] = {
    {Event::down_left, Event::down, Event::down_right},
    {Event::left, Event::noop, Event::right},
    {Event::up_left, Event::up, Event::up_right},
};

void check(std::string_view coordinate, float value, float low, float high, std::string_view interval) {
    // Written so that NaN, which compares false to everything, is refused too.
    if (value >= low && value <= high) return;
    std::ostringstream message;
    message.precision(9);
    message << "the action's " << coordinate << " is " << value << ": it must lie in " << interval;
    throw std::invalid_argument(message.str());
}

// -1, 0 or 1: which side of the centre zone the stick is on along one axis.
int side(float position, float threshold, EventMap map) {
    const float lower = map == EventMap::symmetric ? -threshold : threshold;
    return int{position > threshold} - int{position < lower};
}

}  // namespace

std::string_view event_name(Event event) {
    return kEventNames.at(static_cast<std::size_t>(event));
}

std::span<const std::string_view> names_of(EventMap) {
    static constexpr std::string_view kNames[] = {"symmetric", "ale_0_10"};
    return kNames;
}

void validate(const ContinuousAction& action) {
    constexpr float kPi = std::numbers::pi_v<float>;
    check("radius", action.radius, 0, 1, "[0, 1]");
    check("theta", action.theta, -kPi, kPi, "[-pi, pi]");
    check("fire", action.fire, 0, 1, "[0, 1]");
}

Event event_of(int horizontal, int vertical, bool fire) {
    const Event direction = kDirections[vertical + 1][horizontal + 1];
    if (!fire) return direction;
    if (direction == Event::noop) return Event::fire;
    // The eight directions with fire follow the eight without, in the same order.
    return static_cast<Event>(static_cast<int>(direction) + 8);
}

Event joystick_event(const ContinuousAction& action, float threshold, EventMap map) {
    return joystick_event_at(action.radius * std::cos(action.theta), action.radius * std::sin(action.theta),
                             action.fire, threshold, map);
}

Event joystick_event_at(float x, float y, float fire, float threshold, EventMap map) {
    return event_of(side(x, threshold, map), side(y, threshold, map), fire > threshold);
}

}  // namespace cale
