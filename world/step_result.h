// What one step of an environment brought.
#pragma once

#include <array>
#include <cstdint>

namespace cale {

/// What one agent step brought.
struct StepResult {
    float reward = 0;           // of the step, neither clipped nor scaled
    bool terminal = false;      // no bootstrapping: game over, or a life lost where that counts
    bool truncated = false;     // cut off by a time limit, the game not being over
    bool episode_over = false;  // the environment must be reset: game over or truncated
    int frames = 1;             // emulated frames; 0 where a step only cuts off a resumed game in real time
    int lives = 0;              // of an Atari game, as all below: left after the step
    std::uint8_t event = 0;     // the number of the joystick Event; of the last one where the stick moves
    bool stick_moves = false;   // within the step
    std::array<std::uint8_t, 64> frame_events{};  // what the console saw in each frame
};

}  // namespace cale
