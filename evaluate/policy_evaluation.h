// Playing with a policy file: for `cale evaluate` and `cale play`.
#pragma once

#include <cstdint>
#include <string>

#include "cale/env.h"
#include "evaluate/evaluation.h"
#include "policy/torch/policy.h"

namespace cale {

/// Throws std::invalid_argument, with a remedy, if the policy cannot play in this environment: another action
/// space, or a game with different actions.
void require_playable(const PolicyInfo& policy, const EnvConfig& env);

/// Makes a lost life affect the policy's observations as in its training, whatever env.terminal_on_life_loss
/// is set to: either it clears the frame stack and cuts the agent step short, or neither. A lost life never
/// ends the game. Returns a sentence for the user if this changed `env`, else "".
std::string keep_life_loss(const PolicyInfo& policy, EnvConfig& env);

/// Returns whether the policy's sampled actions can differ from its greedy ones.
bool can_sample(const Policy& policy);
/// What a user is to know who asks for sampled actions where they cannot.
inline constexpr const char* kDrawsNothing =
    "--sampled: this policy has action values, which are no distribution, and no noise: it plays greedily";

/// Returns whether the policy is to draw its actions: as the user asks by `sampled` or `greedy`, else as its
/// training's evaluations did.
bool draws_actions(const Policy& policy, bool sampled, bool greedy);

/// Returns the policy's choices: greedy, or with `sampled` drawn from it, each game with its own generator
/// seeded by `seed` and the game's number. The choice for a game does not depend on the other games: greedy
/// actions are always computed eight rows at a time, because the sums of another batch size may round
/// differently.
Decide decide_by(const Policy& policy, bool sampled, std::uint64_t seed);

}  // namespace cale
