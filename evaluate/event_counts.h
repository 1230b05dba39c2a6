// How often each joystick event was chosen: the data of the paper's figure of action distributions.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "cale/action.h"

namespace cale {

/// By Event; in agent steps.
using EventCounts = std::array<std::int64_t, kEventCount>;

/// A table `event,count` with a row for each of the 18 events.
std::string event_table(const EventCounts& counts);

}  // namespace cale
