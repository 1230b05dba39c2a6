// Plays one game with a fixed action and prints its return.
#include <array>
#include <cstdint>
#include <cstdio>

#include <cale/env.h>

int main() {
    cale::EnvConfig config = cale::protocol_atari100k("breakout");
    config.max_frames_per_episode = 2000;
    cale::Env env(config, 1);
    std::array<std::uint8_t, cale::kFrameSize> observation{};
    env.reset(observation);
    float episode_return = 0;
    int steps = 0;
    for (cale::StepResult result; !result.episode_over; ++steps) {
        result = env.step({.radius = 1, .theta = 0, .fire = 1}, observation);
        episode_return += result.reward;
    }
    std::printf("%d steps, return %.0f\n", steps, episode_return);
    return steps > 0 && steps <= 500 ? 0 : 1;
}
