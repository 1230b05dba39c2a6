// A World of equal environments, of which one fails.
#include "world/environments.h"

#include <array>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

namespace cale {
namespace {

/// An episode of three steps.
struct Counting {
    explicit Counting(std::uint32_t) {}
    static ActionSpace action_space() { return Discrete{7}; }
    static ObservationSpace observation_space() { return {.stack = 1, .shape = {1}}; }
    void reset() { steps = 0; }
    StepResult step(std::int64_t action) {
        if (action == 6) throw std::invalid_argument("action 6 fails");
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
    const std::array<std::int64_t, 3> actions = {6, 0, 0};
    EXPECT_THROW(world.step(actions, frames, last, results), std::invalid_argument);
    EXPECT_EQ(frames, (std::vector<std::uint8_t>{0, 1, 1}));
}

TEST(EnvironmentsTest, ImpossibleActionsNeverReachTheGame) {
    Environments<Counting> world(std::array<std::uint32_t, 2>{1, 2});
    std::vector<std::uint8_t> frames(2), last(2);
    std::vector<StepResult> results(2);
    world.reset(frames);
    for (const std::int64_t impossible : {-1, 7}) {
        const std::array<std::int64_t, 2> actions = {impossible, 0};
        EXPECT_THROW(world.step(actions, frames, last, results), std::invalid_argument);
    }
    EXPECT_EQ(frames, (std::vector<std::uint8_t>{0, 2}));
}

/// Takes what lies in its box, from -1 to 2.
struct Axis {
    explicit Axis(std::uint32_t) {}
    static ActionSpace action_space() { return Box{.low = {-1}, .high = {2}}; }
    static ObservationSpace observation_space() { return {.stack = 1, .shape = {1}}; }
    void reset() {}
    StepResult step(std::span<const float> action) { return {.reward = action[0]}; }
    void draw(std::span<std::uint8_t> frame) const { frame[0] = 0; }
    template <class Visit>
    void visit_state(Visit&&) {}
};

TEST(EnvironmentsTest, CoordinatesOutsideTheBoxAreRefused) {
    Environments<Axis> world(std::array<std::uint32_t, 1>{1});
    std::vector<std::uint8_t> frames(1), last(1);
    std::vector<StepResult> results(1);
    world.reset(frames);
    for (const float possible : {-1.0F, 0.5F, 2.0F}) {
        world.step(std::array{possible}, frames, last, results);
        EXPECT_EQ(results[0].reward, possible);
    }
    for (const float impossible : {-1.001F, 2.001F, std::numeric_limits<float>::quiet_NaN()})
        EXPECT_THROW(world.step(std::array{impossible}, frames, last, results), std::invalid_argument);
}

TEST(EnvironmentsTest, ContinuesWhereItWasRecorded) {
    Environments<Counting> world(std::array<std::uint32_t, 1>{1}), other(std::array<std::uint32_t, 1>{1});
    std::vector<std::uint8_t> frames(1), last(1);
    std::vector<StepResult> results(1);
    const std::array<std::int64_t, 1> action = {0};
    world.reset(frames);
    world.step(action, frames, last, results);
    other.resume(world.record());
    other.step(action, frames, last, results);
    EXPECT_EQ(frames[0], 2);
    auto records = world.record();
    records[0].clear();
    EXPECT_THROW(other.resume(records), std::runtime_error);
    other.step(action, frames, last, results);
    EXPECT_TRUE(results[0].episode_over);  // it stayed where it was
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
