// What happened to the joystick in an agent step, as bytes that an observation of the memory can hold: a
// stick that moves, or an action that arrives late, is no part of the console's memory.
#pragma once

#include <cstdint>
#include <span>

#include "cale/action.h"
#include "cale/stick_motion.h"

namespace cale {

/// The joystick in one agent step.
struct JoystickLog {
    ContinuousAction command{};              // the newest action
    StickPosition position{};                // where stick and button are after the newest frame
    std::span<const std::uint8_t> events{};  // what the console saw in each frame that was played
};

/// Returns how many bytes write_joystick_log() fills for agent steps of `frame_skip` frames.
constexpr std::int64_t joystick_log_size(std::int64_t frame_skip) {
    return 3 * (2 + frame_skip);
}

/// Writes (x, y, button) of the command, of the position, and of the event of each frame: 128 +
/// 127 x, 128 + 127 y and 255 times the button, rounded. Frames that were not played have the joystick at
/// rest. `bytes` must have joystick_log_size() bytes; more events than it has room for are left out.
void write_joystick_log(const JoystickLog& log, std::span<std::uint8_t> bytes);

}  // namespace cale
