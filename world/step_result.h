// What one step of an environment brought.
#pragma once

#include <cstdint>

namespace cale {

/// What one agent step brought.
struct StepResult {
    float reward = 0;           // of the step, neither clipped nor scaled
    bool terminal = false;      // no bootstrapping: game over, or a life lost where that counts
    bool truncated = false;     // cut off by a time limit, the game not being over
    bool episode_over = false;  // the environment must be reset: game over or truncated
    std::uint8_t event = 0;     // of an Atari game: the number of the joystick Event; 0 elsewhere
    int lives = 0;              // of an Atari game: left after the step
    int frames = 1;             // emulated frames, at least 1
};

}  // namespace cale
