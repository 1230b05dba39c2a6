// The example's own test: it learns which of four quarters is lit.
#include "examples/custom_agent/a2c.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "agents/agent_worlds.h"

namespace cale {
namespace {

TEST(A2c, SolvesAToyWorld) {
    at::set_num_threads(1);
    A2cConfig config;
    config.learning_rate = 2e-3;
    auto spec = test::small_world(16);
    spec.num_actions = 4;
    const auto agent = make_a2c(config, spec);
    EXPECT_GT(test::success_after(*agent, spec, /*steps=*/600), 0.8);
}

}  // namespace
}  // namespace cale
