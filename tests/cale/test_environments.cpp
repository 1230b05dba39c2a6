// A World of equal environments, of which one fails.
#include "world/environments.h"

#include <array>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

namespace cale {
namespace {

/// An episode of three steps; action 7 is invalid.
struct Counting {
    explicit Counting(std::uint32_t) {}
    static ActionSpace action_space() { return Discrete{7}; }
    static ObservationSpace observation_space() { return {.stack = 1, .shape = {1}}; }
    void reset() { steps = 0; }
    StepResult step(std::int64_t action) {
        if (action == 7) throw std::invalid_argument("there is no action 7");
        return {.episode_over = ++steps == 3};
    }
    void draw(std::span<std::uint8_t> frame) const { frame[0] = static_cast<std::uint8_t>(steps); }
    template <class Visit>
    void visit_state(Visit&& visit) {
        visit("steps", steps);
    }
    std::int32_t steps = 0;
};

TEST(EnvironmentsTest, AllFinishTheStepInWhichOneFails) {
    Environments<Counting> world(std::array<std::uint32_t, 3>{1, 2, 3});
    std::vector<std::uint8_t> frames(3), last(3);
    std::vector<StepResult> results(3);
    world.reset(frames);
    const std::array<std::int64_t, 3> actions = {7, 0, 0};
    EXPECT_THROW(world.step(actions, frames, last, results), std::invalid_argument);
    EXPECT_EQ(frames, (std::vector<std::uint8_t>{0, 1, 1}));
}

TEST(EnvironmentsTest, ArraysOfOtherSizesAreRefused) {
    Environments<Counting> world(std::array<std::uint32_t, 2>{1, 2});
    std::vector<std::uint8_t> frames(2), last(2), too_few(1);
    std::vector<StepResult> results(2), too_many(3);
    const std::vector<std::int64_t> actions(2), one_action(1);
    EXPECT_THROW(world.reset(too_few), std::invalid_argument);
    world.reset(frames);
    EXPECT_THROW(world.step(actions, too_few, last, results), std::invalid_argument);
    EXPECT_THROW(world.step(actions, frames, too_few, results), std::invalid_argument);
    EXPECT_THROW(world.step(actions, frames, last, too_many), std::invalid_argument);
    EXPECT_THROW(world.step(one_action, frames, last, results), std::invalid_argument);
    EXPECT_NO_THROW(world.step(actions, frames, last, results));
}

TEST(EnvironmentsTest, StatesOfAnotherNumberOfEnvironmentsAreRefused) {
    Environments<Counting> world(std::array<std::uint32_t, 2>{1, 2});
    auto records = world.record();
    records.pop_back();
    EXPECT_THROW(world.resume(records), std::runtime_error);
}

}  // namespace
}  // namespace cale
