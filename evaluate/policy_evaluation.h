// A policy file at the joystick: for `cale evaluate` and `cale play`.
#pragma once

#include <cstdint>
#include <string>

#include "cale/env.h"
#include "evaluate/evaluation.h"
#include "policy/torch/policy.h"

namespace cale {

/// Throws std::invalid_argument, saying what to do, where the policy cannot play in such an environment:
/// another action space, or a game whose actions are others.
void require_playable(const PolicyInfo& policy, const EnvConfig& env);

/// Has a lost life do to the policy's observations what it did in its training, whatever
/// env.terminal_on_life_loss is set to: clear the frame stack and cut the agent step short, or neither. No
/// game ends with a life either way. Returns a sentence for the user where that is not what `env` had; else
/// nothing.
std::string keep_life_loss(const PolicyInfo& policy, EnvConfig& env);

/// Chooses as the policy does: greedily, or with `sampled` by drawing from it, each game from a generator of
/// its own that follows from `seed` and the game's number. What it chooses for a game does not depend on the
/// games beside it: greedy actions are computed eight rows at a time, always, because the sums of a larger or
/// smaller batch may be rounded in another way.
Decide decide_by(const Policy& policy, bool sampled, std::uint64_t seed);

}  // namespace cale
