// Stepping must not ask for memory: this binary counts what goes through operator new.
#include <atomic>
#include <cstdlib>
#include <new>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include "cale/vector_env.h"

namespace {
std::atomic<int> allocations{0};
}

[[gnu::noinline]] void* operator new(std::size_t size) {
    ++allocations;
    if (void* memory = std::malloc(size > 0 ? size : 1)) return memory;
    throw std::bad_alloc();
}
[[gnu::noinline]] void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
    ++allocations;
    return std::malloc(size > 0 ? size : 1);
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
    std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
    std::free(memory);
}

namespace {

constexpr int kWarmUp = 10;
constexpr int kSteps = 200;  // no episode of Pong ends so soon

template <class Step>
int allocations_of(const Step& step) {
    for (int i = 0; i < kWarmUp; ++i) step();
    const int before = allocations;
    for (int i = 0; i < kSteps; ++i) step();
    return allocations - before;
}

TEST(EmulatorAllocation, AStepOfAnEnvironmentTakesNoMemory) {
    std::vector<std::uint8_t> frame(cale::kFrameSize);
    cale::Env continuous(cale::protocol_200m("pong"), 1);
    continuous.reset(frame);
    EXPECT_EQ(allocations_of([&] { continuous.step({.radius = 1, .theta = 1.5F, .fire = 1}, frame); }), 0);

    auto config = cale::protocol_200m("pong");
    config.action_space = cale::ActionSet::minimal;
    cale::Env discrete(config, 1);
    discrete.reset(frame);
    EXPECT_EQ(allocations_of([&] { discrete.step(std::int64_t{2}, frame); }), 0);
}

TEST(EmulatorAllocation, AStepOfManyEnvironmentsTakesNoMemory) {
    for (const int threads : {1, 2}) {
        SCOPED_TRACE(threads);
        auto config = cale::protocol_200m("pong");
        config.num_envs = 3;
        config.env_threads = threads;
        const std::vector<std::uint32_t> seeds{1, 2, 3};
        cale::VectorEnv envs(config, seeds);
        std::vector<std::uint8_t> frames(3 * cale::kFrameSize), final_frames(3 * cale::kFrameSize);
        const std::vector<cale::ContinuousAction> actions(3, {.radius = 1, .theta = 1.5F, .fire = 1});
        std::vector<cale::StepResult> results(3);
        envs.reset(frames);
        EXPECT_EQ(allocations_of([&] { envs.step(actions, frames, final_frames, results); }), 0);
    }
}

TEST(EmulatorAllocation, NeitherDoSticksThatMoveNorPaddlesNorWhatIsSeenLate) {
    auto moving = cale::protocol_200m("pong");
    moving.motion.stick_speed = 0.1;
    moving.motion.action_latency = {.low = 0, .high = 3};
    moving.motion.actuation_noise = 0.1;
    auto late = cale::protocol_200m("pong");
    late.motion.observation_latency = {.low = 2, .high = 2};
    auto memory = cale::protocol_200m("pong");
    memory.obs = cale::Obs::ram;
    memory.observe_joystick = true;
    auto paddle = cale::protocol_200m("pong");
    paddle.paddle = cale::Paddle::absolute;
    const std::vector<std::uint32_t> seeds{1};
    for (auto config : {moving, late, memory, paddle}) {
        config.num_envs = 1;
        cale::VectorEnv envs(config, seeds);
        const auto size = static_cast<std::size_t>(envs.observation_space().frame_size());
        std::vector<std::uint8_t> frames(size), final_frames(size);
        const std::vector<float> action(static_cast<std::size_t>(cale::box_size(envs.action_space())), 0.5F);
        const cale::Actions actions = std::span<const float>(action);
        std::vector<cale::StepResult> results(1);
        envs.reset(frames);
        EXPECT_EQ(allocations_of([&] { envs.step(actions, frames, final_frames, results); }), 0);
    }
}

TEST(EmulatorAllocation, IsCounted) {
    const int before = allocations;
    const std::vector<int> memory(100);
    EXPECT_NE(memory.data(), nullptr);
    EXPECT_GT(allocations, before);
}

}  // namespace
