// A frame of a film: the game, and beside it what the agent sees and does.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "cale/action.h"
#include "cale/env.h"

namespace cale {

/// An RGB picture.
struct Image {
    int width = 0;
    int height = 0;
    std::vector<std::uint8_t> rgb;  // height x width x RGB
};

/// The contents of a frame of a film.
struct Scene {
    std::span<const std::uint8_t> screen{};  // screen_height x screen_width x RGB
    int screen_width = 160;
    int screen_height = 210;
    std::span<const std::uint8_t>
        observation{};                         // 84 x 84 grey, or 128 bytes: the newest that the agent sees
    std::optional<ContinuousAction> action{};  // none: a discrete agent, whose event alone is shown
    std::optional<StickPosition> stick{};      // where a stick that moves is; none: where the action is
    bool paddle = false;                       // the action places a paddle: only x and fire count
    double threshold = 0.5;                    // tau
    Event event = Event::noop;
    double episode_return = 0;
    std::optional<double> value{};  // the agent's value of its action
};

/// The game three times as large; beside it what the agent sees, and its joystick: the stick in the
/// unit disc with the lines beyond which it counts, or the way of a paddle, the fire button, the event, the
/// return so far, the value. A stick that moves has a ring in its commanded position. Every scene of the same
/// screen size gives an image of the same, even, size. Throws std::invalid_argument for a screen or an
/// observation of another size.
Image compose_frame(const Scene& scene);
/// The same with the screen of `env`, whatever `scene` has for one.
Image compose_frame(const Env& env, Scene scene);

/// Where compose_frame draws the disc of the joystick for a screen of this width, in the image's pixels.
struct Dial {
    double x = 0;  // of its centre, from the upper left corner
    double y = 0;
    double radius = 0;
};
Dial joystick_dial(int screen_width);

}  // namespace cale
