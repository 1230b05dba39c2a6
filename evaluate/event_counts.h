// How often each joystick event was chosen: the data of the paper's figure of action distributions.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>

#include "cale/action.h"
#include "world/step_result.h"

namespace cale {

/// By Event; in agent steps, or in frames where the joystick moves within a step.
using EventCounts = std::array<std::int64_t, kEventCount>;

/// Counts the joystick event of an agent step; where the joystick moves within it, that of each frame, as the
/// console saw it. Throws std::out_of_range for a number that is no event's.
void count_events(EventCounts& counts, const StepResult& result);

/// Returns the parts of the steps from `before` to `now` in each of the joystick's zones, by the names of
/// kZones, and with the button pressed, "fire". Empty without steps.
std::map<std::string, double> zone_shares(const EventCounts& before, const EventCounts& now);

/// A table `event,count` with a row for each of the 18 events.
std::string event_table(const EventCounts& counts);

}  // namespace cale
