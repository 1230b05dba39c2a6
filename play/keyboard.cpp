#include "play/keyboard.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>

namespace cale {
namespace {

enum class Control { up, down, left, right, fire, half };

struct HeldKey {
    std::string_view name;
    Control control;
};

constexpr HeldKey kHeldKeys[] = {
    {"Up", Control::up},           {"W", Control::up},
    {"Down", Control::down},       {"S", Control::down},
    {"Left", Control::left},       {"A", Control::left},
    {"Right", Control::right},     {"D", Control::right},
    {"Space", Control::fire},      {"Right Button", Control::fire},
    {"Left Shift", Control::half}, {"Right Shift", Control::half},
};

bool holds(const Hands& hands, Control control) {
    return std::ranges::any_of(kHeldKeys, [&](const HeldKey& key) {
        return key.control == control && hands.held.contains(key.name);
    });
}

ContinuousAction action_at(const Stick& stick, bool fire) {
    const double radius = std::min(1.0, std::hypot(stick.x, stick.y));
    return {.radius = static_cast<float>(radius),
            .theta = std::atan2(static_cast<float>(stick.y), static_cast<float>(stick.x)),
            .fire = fire ? 1.0F : 0.0F};
}

}  // namespace

Command press(Hands& hands, std::string_view key, bool down) {
    if (std::ranges::find(kHeldKeys, key, &HeldKey::name) != std::end(kHeldKeys)) {
        if (down) {
            hands.held.emplace(key);
            hands.tapped.emplace(key);
        } else {
            hands.held.erase(std::string(key));
        }
    }
    if (!down) return Command::none;
    if (key.size() == 1 && key[0] >= '0' && key[0] <= '9')
        hands.reach = key[0] == '0' ? 1 : (key[0] - '0') / 10.0;
    if (key == "P") return Command::pause;
    if (key == "R") return Command::new_game;
    if (key == "Escape") return Command::quit;
    return Command::none;
}

Stick stick_at(double x, double y, const Dial& dial) {
    const Stick stick{.x = (x - dial.x) / dial.radius, .y = (dial.y - y) / dial.radius};
    const double beyond = std::max(1.0, std::hypot(stick.x, stick.y));
    return {.x = stick.x / beyond, .y = stick.y / beyond};
}

ContinuousAction joystick(const Hands& hands) {
    const bool fire = holds(hands, Control::fire);
    if (hands.pointer) return action_at(*hands.pointer, fire);
    const double x = int{holds(hands, Control::right)} - int{holds(hands, Control::left)};
    const double y = int{holds(hands, Control::up)} - int{holds(hands, Control::down)};
    const double far = std::hypot(x, y);
    if (far == 0) return {.fire = fire ? 1.0F : 0.0F};
    const double reach = holds(hands, Control::half) ? hands.reach / 2 : hands.reach;
    return action_at({.x = x / far * reach, .y = y / far * reach}, fire);
}

ContinuousAction take_joystick(Hands& hands) {
    Hands touched = hands;
    touched.held.merge(touched.tapped);
    hands.tapped.clear();
    return joystick(touched);
}

std::string keyboard_help(bool pauses) {
    const std::string keys =
        "arrows or WASD   the stick\n"
        "Space            fire\n"
        "mouse on dial    hold the left button to place the stick, the right one to fire\n"
        "1 ... 9, 0       how far the keys push the stick: 0.1 ... 0.9, 1\n"
        "Shift            half as far while held\n";
    return keys + (pauses ? "P, R, Esc        pause, new game, quit\n" : "Esc              quit\n");
}

}  // namespace cale
