// What a step of any environment brings.
#pragma once

#include <cstdint>

namespace cale {

/// What one agent step brought.
struct StepResult {
    float reward = 0;           // sum over the frames of the step, neither clipped nor scaled
    bool terminal = false;      // no bootstrapping: game over, or a life lost where that counts
    bool truncated = false;     // cut off by a limit of time, the game not being over
    bool episode_over = false;  // the environment must be reset: game over or truncated
    std::uint8_t event = 0;     // the ALE world: number of the joystick Event; 0 elsewhere
    int lives = 0;              // left after the step, where there are lives
    int frames = 0;             // emulated frames, 1 to frame_skip
};

}  // namespace cale
