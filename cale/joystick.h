// Parametrisations of the continuous joystick: the coordinates, or the categories, in which an agent chooses
// an action, and their way to CALE's (r, theta, fire). The game sees no difference; exploration and learning
// do. Farebrother & Castro 2024, "CALE", section 3, has the polar one.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "cale/action.h"
#include "world/spaces.h"

namespace cale {

/// The coordinates of an action.
/// - polar: (r, theta, fire) in [0, 1] x [-pi, pi] x [0, 1], the paper's. LEFT lies at both ends of theta.
/// - cartesian: (x, y, fire) in [-1, 1] x [-1, 1] x [0, 1]. Beyond the gate, the circle of radius 1, the
///   stick slides along it: see stick().
/// - direction: (cos theta, sin theta, r, fire) in [-1, 1] x [-1, 1] x [0, 1] x [0, 1]: no seam. Of the first
///   two only the direction counts.
/// - factored: categories: x left, centre, right; y down, centre, up; fire off, on. The joystick at its rim,
///   or in its centre, reaches the 18 events.
/// - paddle: (position, fire) in [0, 1] x [0, 1], from the left end of a paddle's way to its right end. As a
///   joystick it lies on the horizontal axis. The coordinates of env.paddle=absolute.
enum class Joystick { polar, cartesian, direction, factored, paddle };
std::span<const std::string_view> names_of(Joystick);

/// One coordinate of a parametrisation and its interval.
struct StickCoordinate {
    std::string_view name;  // "x"
    float low, high;        // its limits
};
/// Returns the coordinates of a parametrisation; none for `factored`.
std::span<const StickCoordinate> stick_coordinates(Joystick joystick);

/// Returns the coordinates as a box, whose landmarks are the 18 actions of `factored` (of a paddle the 6 on
/// its axis); of `factored` its 18 actions.
ActionSpace joystick_space(Joystick joystick);

/// Returns the joystick for an action in the coordinates of `joystick`. A cartesian position beyond the gate
/// keeps its smaller coordinate, up to sqrt(1/2), and the larger one yields: below a threshold of sqrt(1/2)
/// the joystick events are those of (x, y) itself, but for the rounding of r cos theta and r sin theta, which
/// may carry a coordinate beside the threshold, within a few units in its last place, across it.
/// Throws std::invalid_argument, naming the coordinate, for NaN, for values outside their interval, and for
/// another number of coordinates.
ContinuousAction stick(Joystick joystick, std::span<const float> action);

/// The other way round: the coordinates of a joystick; none in `factored`.
std::vector<float> coordinates_of(Joystick joystick, const ContinuousAction& action);

/// Returns where a paddle is, 0 to 1, whose joystick is at x, -1 to 1. Exact at both ends.
inline double paddle_position(double x) {
    return (x + 1) / 2;
}

/// Returns the joystick for action number (3 x + y) 2 + fire of `factored`, with x and y 0, 1, 2 for left or
/// down, centre, right or up. Throws std::out_of_range.
ContinuousAction factored_stick(std::int64_t action);
/// Returns the events of the 18 actions of `factored`.
std::span<const Event> factored_events();
/// Returns the joystick that an event stands for: at its rim, or in its centre.
ContinuousAction event_stick(Event event);

}  // namespace cale
