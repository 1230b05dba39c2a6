#include "cale/joystick_log.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "cale/joystick.h"

namespace cale {
namespace {

constexpr std::size_t kBytes = 3;  // x, y and the button

std::array<std::uint8_t, kBytes> bytes_of(const StickPosition& position) {
    const auto byte = [](double value) {
        return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0)));
    };
    return {byte(128 + 127 * position.x), byte(128 + 127 * position.y), byte(255 * position.button)};
}

}  // namespace

void write_joystick_log(const JoystickLog& log, std::span<std::uint8_t> bytes) {
    auto next = bytes.begin();
    const auto write = [&](const StickPosition& position) {
        next = std::ranges::copy(bytes_of(position), next).out;
    };
    write(position_of(log.command));
    write(log.position);
    for (std::size_t frame = 0; next != bytes.end(); ++frame) {
        const auto event = frame < log.events.size() ? static_cast<Event>(log.events[frame]) : Event::noop;
        write(position_of(event_stick(event)));
    }
}

}  // namespace cale
