// Which joystick event an action of the continuous joystick stands for, as a picture.
#pragma once

#include <string>
#include <vector>

#include "cale/action.h"
#include "cale/joystick.h"
#include "report/picture.h"

namespace cale {

/// A part of the unit disc of (r, theta) in which all actions stand for the same event.
struct JoystickRegion {
    Event event = Event::noop;     // with fire at 0
    std::vector<Point> outline{};  // x to the right, y up, radius 1
};

/// The up to nine regions for a threshold in [0, 1], rows from the top, each from the left. Those that
/// no action reaches are missing: the corners from sqrt(1/2) on. The event is joystick_event()'s.
std::vector<JoystickRegion> joystick_regions(double threshold);

/// The part of uniformly random actions in the coordinates of `joystick` that stand for each event, by Event.
std::vector<double> event_shares_of_random_actions(double threshold, Joystick joystick = Joystick::polar);

/// The disc without fire and with it, every region with its event and its part of random actions.
Picture joystick_map(double threshold, Joystick joystick = Joystick::polar);

/// The same for a terminal.
std::string joystick_map_text(double threshold, Joystick joystick = Joystick::polar);

}  // namespace cale
