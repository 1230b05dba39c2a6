// DQN (Mnih et al. 2015) with an encoder of one's own.
#pragma once

#include <cstdint>
#include <memory>

#include <agents/agent.h>
#include <agents/exploration.h>
#include <agents/off_policy.h>
#include <cale/fields.h>

namespace example {

/// Every member is a key `agent.<name>`, because fields() visits it.
struct PatchDqnConfig {
    static constexpr const char* kName = "patch_dqn";
    // It chooses among a set of actions; the joystick is for agents that say false.
    static constexpr bool kDiscrete = true;

    std::int64_t channels = 64;
    std::int64_t hidden_units = 256;
    cale::ReplaySettings replay{.reward_clip = 1};
    cale::EpsilonSettings epsilon;
    std::int64_t target_update_period = 8'000;
    double learning_rate = 1e-4;
};

template <class Visit>
void fields(PatchDqnConfig& config, Visit&& visit) {
    visit("channels", config.channels, cale::Range{1, 4096}, "numbers that a patch becomes");
    visit("hidden_units", config.hidden_units, cale::Range{1, 65'536}, "units of the hidden layer");
    fields(config.replay, visit);
    fields(config.epsilon, visit);
    visit("target_update_period", config.target_update_period, cale::Range{1, 1e9},
          "agent steps between copies of the network to the target");
    visit("learning_rate", config.learning_rate, cale::Range{0, 1}, "Adam's learning rate");
}

std::unique_ptr<cale::Agent> make_patch_dqn(const PatchDqnConfig& config, const cale::AgentSpec& spec);

}  // namespace example
