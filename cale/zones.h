// The joystick's nine zones: the 18 events without the button.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "cale/action.h"

namespace cale {

/// Their names: the centre, then counter-clockwise from the right.
inline constexpr std::array<std::string_view, 9> kZones{
    "centre", "right", "up_right", "up", "up_left", "left", "down_left", "down", "down_right"};

/// Returns the zone that an event needs the stick in, as an index of kZones.
constexpr std::size_t zone_of(Event event) {
    // By Event: centre, centre, up, right, left, down, the diagonals; then the last eight with the button.
    constexpr std::array<std::size_t, kEventCount> zones{0, 0, 3, 1, 5, 7, 2, 4, 8,
                                                         6, 3, 1, 5, 7, 2, 4, 8, 6};
    return zones[static_cast<std::size_t>(event)];
}

/// Returns whether an event presses the button.
constexpr bool presses_fire(Event event) {
    return event == Event::fire || event >= Event::up_fire;
}

}  // namespace cale
