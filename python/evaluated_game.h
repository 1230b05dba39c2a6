// One game played by a policy without learning: what `cale evaluate` does (evaluate/evaluation.cpp), without
// LibTorch.
#pragma once

#include <atomic>
#include <cstdint>

#include "cale/env.h"
#include "policy/policy_lite.h"

namespace cale::python {

/// How a policy's games are played.
struct GamePlan {
    EnvConfig env{};
    double epsilon = 0;      // probability of a uniformly random action instead of the policy's
    bool sampled = false;    // whether actions are drawn from the policy
    std::uint64_t seed = 1;  // with a game's number it determines the game
    const std::atomic<bool>* stop = nullptr;  // once it is true, a game ends at its next step
};

/// What became of a game.
struct PlayedGame {
    double episode_return = 0;  // undiscounted, neither clipped nor scaled
    std::int64_t length = 0;    // agent steps
    std::int64_t frames = 0;    // emulated
};

/// Plays game number `number` from its beginning to its end. Its environment and its random actions are those
/// of `cale evaluate` with the same seed. Throws what the environment throws, and std::runtime_error where
/// the plan's `stop` ends it.
PlayedGame play_game(const lite::Policy& policy, const GamePlan& plan, std::int64_t number);

/// Throws std::invalid_argument for an environment whose actions or observations are not the policy's.
void require_playable(const PolicyInfo& policy, const EnvConfig& env);

/// The coordinates of the continuous joystick in which Python has a policy's actions: those of an environment
/// with its settings, but for cartesian ones and directions, whose way through (r, theta, fire) and back
/// rounds.
Joystick written_coordinates(const PolicyInfo& policy);

}  // namespace cale::python
