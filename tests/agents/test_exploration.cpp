#include <stdexcept>
#include <variant>

#include <gtest/gtest.h>

#include "agents/exploration.h"
#include "cale/joystick.h"
#include "support/golden.h"

namespace {

TEST(SchedulesGolden, EpsilonDecaysAsInTheReference) {
    int rows = 0;
    for (const auto& file : golden::files_of_kind("schedules")) {
        for (const auto& row : golden::load(file)["epsilon"]) {
            ++rows;
            const double epsilon = cale::linearly_decaying_epsilon(
                row["decay_period"].as<std::int64_t>(), row["step"].as<std::int64_t>(),
                row["warmup_steps"].as<std::int64_t>(), row["final"].as<double>());
            const auto expected = row["epsilon"].as<double>();
            EXPECT_NEAR(epsilon, expected, 1e-6 * expected) << file << ", step " << row["step"];
        }
    }
    EXPECT_GT(rows, 0);
}

TEST(ExplorationBox, EventsAreThoseOfTheWorldsBox) {
    using cale::Joystick, cale::RandomActions;
    for (const auto joystick :
         {Joystick::polar, Joystick::cartesian, Joystick::direction, Joystick::paddle}) {
        const auto space = std::get<cale::Box>(joystick_space(joystick));
        const auto events = cale::exploration_box(space, RandomActions::events).landmarks;
        EXPECT_EQ(events.size(0), joystick == Joystick::paddle ? 6 : 18);
        ASSERT_EQ(events.size(1), space.size());
        for (std::int64_t i = 0; i < events.numel(); ++i)
            EXPECT_EQ(events.flatten()[i].item<float>(), space.landmarks[static_cast<std::size_t>(i)]);
    }
    const cale::Box plain{.low = {-1}, .high = {1}};
    EXPECT_FALSE(cale::exploration_box(plain, RandomActions::box).landmarks.defined());
    EXPECT_THROW(cale::exploration_box(plain, RandomActions::events), std::invalid_argument);
    EXPECT_THROW(cale::exploration_box(cale::Discrete{18}, RandomActions::events), std::invalid_argument);
}

}  // namespace
