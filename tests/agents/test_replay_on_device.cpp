// agent.replay_on_device changes where batches are put together, and nothing else.
#include <gtest/gtest.h>

#include "agent_worlds.h"

namespace cale {
namespace {

c10::DeviceType device_of_batches(Agent& agent) {
    return agent.replay()->empty_batch(1).observation.device().type();
}

template <class Config>
void expect_no_difference(std::unique_ptr<Agent> (*make)(const Config&, const AgentSpec&), Config config,
                          const AgentSpec& world) {
    const auto on_host = make(config, world);
    config.replay.replay_on_device = true;
    const auto on_device = make(config, world);
    drive(*on_host, world, 0, 60);
    drive(*on_device, world, 0, 60);
    EXPECT_GT(gradient_steps_of(*on_host), 10);
    expect_equal(on_device->state(), on_host->state());
    // With CALE_TEST_DEVICE=cuda these are two devices.
    EXPECT_EQ(device_of_batches(*on_device), world.device.type());
    EXPECT_EQ(device_of_batches(*on_host), torch::kCPU);
}

TEST(ReplayOnDevice, ChangesNoBitOfSac) {
    expect_no_difference(make_sac, small_sac(), joystick_world(2));
}

TEST(ReplayOnDevice, ChangesNoBitOfDer) {
    expect_no_difference(make_der, small_der(), discrete_world(2));
}

}  // namespace
}  // namespace cale
