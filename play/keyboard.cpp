#include "play/keyboard.h"

#include <algorithm>
#include <cmath>

namespace cale {
namespace {

struct HeldKey {
    std::string_view name;
    bool Hands::*held;
};

constexpr HeldKey kHeldKeys[] = {
    {"Up", &Hands::up},
    {"W", &Hands::up},
    {"Down", &Hands::down},
    {"S", &Hands::down},
    {"Left", &Hands::left},
    {"A", &Hands::left},
    {"Right", &Hands::right},
    {"D", &Hands::right},
    {"Space", &Hands::fire},
    {"Left Shift", &Hands::half},
    {"Right Shift", &Hands::half},
};

ContinuousAction action_at(const Stick& stick, bool fire) {
    const double radius = std::min(1.0, std::hypot(stick.x, stick.y));
    return {.radius = static_cast<float>(radius),
            .theta = std::atan2(static_cast<float>(stick.y), static_cast<float>(stick.x)),
            .fire = fire ? 1.0F : 0.0F};
}

}  // namespace

Command press(Hands& hands, std::string_view key, bool down) {
    for (const auto& [name, held] : kHeldKeys) {
        if (name == key) hands.*held = down;
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
    if (hands.pointer) return action_at(*hands.pointer, hands.fire);
    const double x = int{hands.right} - int{hands.left}, y = int{hands.up} - int{hands.down};
    const double far = std::hypot(x, y);
    if (far == 0) return {.fire = hands.fire ? 1.0F : 0.0F};
    const double reach = hands.half ? hands.reach / 2 : hands.reach;
    return action_at({.x = x / far * reach, .y = y / far * reach}, hands.fire);
}

std::string_view keyboard_help() {
    return "arrows or WASD   the stick\n"
           "Space            fire\n"
           "mouse on dial    hold the left button to place the stick, the right one to fire\n"
           "1 ... 9, 0       how far the keys push the stick: 0.1 ... 0.9, 1\n"
           "Shift            half as far while held\n"
           "P, R, Esc        pause, new game, quit\n";
}

}  // namespace cale
