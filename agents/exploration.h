// How an agent explores: its settings and the schedule of epsilon.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include <torch/types.h>

#include "cale/fields.h"
#include "networks/heads.h"

namespace cale {

/// Exploration by the policy's own noise, or by uniform actions with probability epsilon.
enum class Exploration { standard, epsilon_greedy };
std::span<const std::string_view> names_of(Exploration);

/// Where random actions come from: the whole box, or the world's landmarks in it (Box::landmarks), which of a
/// joystick are its 18 events, of a paddle 6.
enum class RandomActions { box, events };
std::span<const std::string_view> names_of(RandomActions);

/// Returns the box of a space, float32 on the CPU, for random actions as `choice` says. Throws
/// std::invalid_argument where that is `events` and the space has no landmarks.
ActionBox exploration_box(const ActionSpace& space, RandomActions choice);

/// The epsilons of an agent. The defaults are those of 200 million frames.
struct EpsilonSettings {
    double epsilon_train = 0.01;
    double epsilon_eval = 0.001;
    std::int64_t epsilon_decay_period = 250'000;
};

template <class Visit>
void fields(EpsilonSettings& settings, Visit&& visit) {
    visit("epsilon_train", settings.epsilon_train, Range{0, 1},
          "final epsilon in training, where the agent explores by it");
    visit("epsilon_eval", settings.epsilon_eval, Range{0, 1},
          "epsilon in evaluation; without effect where agent.exploration is standard");
    visit("epsilon_decay_period", settings.epsilon_decay_period, Range{1, 1e12},
          "agent steps from epsilon 1 to epsilon_train, after the warm-up if there is one");
}

/// The probability of a random action after `step` decisions: 1 for `warmup_steps`, then
/// linearly down to `final` within `decay_period` (Mnih et al. 2015).
double linearly_decaying_epsilon(std::int64_t decay_period, std::int64_t step, std::int64_t warmup_steps,
                                 double final);

}  // namespace cale
