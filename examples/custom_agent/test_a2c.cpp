// The example's own test: it learns which of four quarters is lit.
#include "examples/custom_agent/a2c.h"

#include <gtest/gtest.h>

#include "agents/agent_worlds.h"

namespace cale {
namespace {

TEST(A2c, SolvesAToyWorld) {
    at::set_num_threads(1);
    A2cConfig config;
    config.learning_rate = 2e-3;
    config.entropy_coefficient = 0.1;
    const auto spec = discrete_world(16);
    EXPECT_GT(learned_after(*make_a2c(config, spec), spec, /*steps=*/1200), 0.8);
}

}  // namespace
}  // namespace cale
