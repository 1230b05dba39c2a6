// The example's own test: it learns which of four quarters is lit.
#include <gtest/gtest.h>

#include "agents/agent_worlds.h"
#include "examples/custom_encoder/patch_dqn.h"

namespace {

TEST(PatchDqn, SolvesAToyWorld) {
    example::PatchDqnConfig config;
    config.hidden_units = 32;
    config.learning_rate = 1e-3;
    config.target_update_period = 50;
    config.replay.min_replay = 50;
    config.replay.update_period = 1;
    config.replay.replay_capacity = 1000;
    config.epsilon.epsilon_decay_period = 200;
    const auto spec = cale::discrete_world();
    EXPECT_GT(cale::learned_after(*example::make_patch_dqn(config, spec), spec, /*steps=*/600), 0.8);
}

}  // namespace
