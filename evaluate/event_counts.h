// How often each joystick event was chosen: the data of the paper's figure of action distributions.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>

#include "cale/action.h"

namespace cale {

/// By Event; in agent steps.
using EventCounts = std::array<std::int64_t, kEventCount>;

/// Returns the parts of the steps from `before` to `now` in each of the joystick's zones, by the names of
/// kZones, and with the button pressed, "fire". Empty without steps.
std::map<std::string, double> zone_shares(const EventCounts& before, const EventCounts& now);

/// A table `event,count` with a row for each of the 18 events.
std::string event_table(const EventCounts& counts);

}  // namespace cale
