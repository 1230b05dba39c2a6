// Maps the held keys and the mouse to the continuous joystick.
#pragma once

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "cale/action.h"
#include "report/scene.h"

namespace cale {

/// The position of the stick in its disc: x to the right, y upwards, at most 1 from the centre.
struct Stick {
    double x = 0;
    double y = 0;
};

/// The state of the player's controls.
struct Hands {
    std::set<std::string, std::less<>> held{};    // keys of the joystick; two may do the same
    std::set<std::string, std::less<>> tapped{};  // those pressed since take_joystick(), held still or not
    double reach = 1;                             // how far the keys push it, 0 to 1
    std::optional<Stick> pointer{};               // where the mouse holds it; the keys do not count then
};

/// What a key can do besides moving the joystick.
enum class Command { none, quit, pause, new_game };

/// Handles a key that was pressed or released, the mouse's button among them. Keys have SDL's names:
///   Up, Down, Left, Right; W, S, A, D    the stick
///   Space                                fire
///   Right Button                         of the mouse, fire
///   Left Shift, Right Shift              half as far
///   1 ... 9, 0                           the keys push the stick 0.1 ... 0.9, 1 from the middle
///   P, R, Escape                         pause, new game, quit
/// Any other does nothing.
Command press(Hands& hands, std::string_view key, bool down);

/// Where a pointer at (x, y), from the upper left corner of the picture, holds the stick; at the rim where it
/// points outside the dial.
Stick stick_at(double x, double y, const Dial& dial);

/// (r, theta, fire): opposite keys cancel out, fire is 0 or 1.
ContinuousAction joystick(const Hands& hands);
/// joystick() for the next step: keys that were pressed and let go since the last call count, too.
ContinuousAction take_joystick(Hands& hands);

/// The keys, a line each, to be read before playing. `pauses`: whether the game can be stopped and begun
/// anew.
std::string keyboard_help(bool pauses = true);

}  // namespace cale
