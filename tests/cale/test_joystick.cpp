#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <variant>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/fields.h"
#include "cale/joystick.h"
#include "message_of.h"

namespace {

using cale::ContinuousAction;
using cale::Event;
using cale::Joystick;
using testing::HasSubstr;

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kDiagonal = 0.70710678F;

ContinuousAction at(Joystick joystick, std::vector<float> action) {
    return cale::stick(joystick, action);
}

Event event_of(Joystick joystick, std::vector<float> action, float threshold = 0.5F) {
    return joystick_event(at(joystick, std::move(action)), threshold);
}

TEST(Joystick, PolarCoordinatesAreTheActionItself) {
    const auto action = at(Joystick::polar, {0.3F, -2.0F, 0.7F});
    EXPECT_EQ(action.radius, 0.3F);
    EXPECT_EQ(action.theta, -2.0F);
    EXPECT_EQ(action.fire, 0.7F);
}

TEST(Joystick, ACartesianPositionWithinTheGateIsWhereTheStickIs) {
    for (const float x : {-0.6F, 0.0F, 0.2F})
        for (const float y : {-0.7F, -0.1F, 0.0F, 0.5F}) {
            const auto action = at(Joystick::cartesian, {x, y, 0.25F});
            EXPECT_NEAR(action.radius * std::cos(action.theta), x, 1e-6);
            EXPECT_NEAR(action.radius * std::sin(action.theta), y, 1e-6);
            EXPECT_EQ(action.fire, 0.25F);
        }
}

TEST(Joystick, BeyondTheGateItSlides) {
    const auto corner = at(Joystick::cartesian, {1, 1, 0});
    EXPECT_NEAR(corner.radius, 1, 1e-6);
    EXPECT_NEAR(corner.theta, kPi / 4, 1e-6);
    // The smaller coordinate stays, the larger one yields.
    const auto side = at(Joystick::cartesian, {-1, 0.3F, 0});
    EXPECT_NEAR(side.radius, 1, 1e-6);
    EXPECT_NEAR(side.radius * std::sin(side.theta), 0.3, 1e-6);
    EXPECT_LT(side.radius * std::cos(side.theta), -0.9F);
}

// Below sqrt(1/2) the events of (x, y) are those of each coordinate by itself, wherever in the square.
TEST(Joystick, ThresholdsActOnCartesianCoordinatesOneByOne) {
    const auto number = [](float value, float threshold) {
        return (value > threshold) - (value < -threshold);
    };
    for (const float threshold : {0.1F, 0.5F, 0.69F}) {
        for (float x = -1; x <= 1; x += 0.0613F)
            for (float y = -1; y <= 1; y += 0.0613F) {
                const auto inside =
                    cale::factored_stick((3 * (number(x, threshold) + 1) + number(y, threshold) + 1) * 2);
                EXPECT_EQ(event_of(Joystick::cartesian, {x, y, 0}, threshold), joystick_event(inside, 0.5F))
                    << x << " " << y << " at " << threshold;
            }
    }
}

TEST(Joystick, OfADirectionOnlyTheAngleCounts) {
    const auto action = at(Joystick::direction, {-0.5F, 0.5F, 0.8F, 0.1F});
    EXPECT_NEAR(action.theta, 0.75 * kPi, 1e-6);
    EXPECT_EQ(action.radius, 0.8F);
    EXPECT_EQ(action.fire, 0.1F);
    // LEFT from above and from below: neighbours, as they are not in (r, theta).
    EXPECT_EQ(event_of(Joystick::direction, {-1, 0.01F, 1, 0}), Event::left);
    EXPECT_EQ(event_of(Joystick::direction, {-1, -0.01F, 1, 0}), Event::left);
}

TEST(Joystick, FactoredActionsAreTheEighteenEvents) {
    EXPECT_THAT((std::set<Event>(cale::factored_events().begin(), cale::factored_events().end())),
                testing::SizeIs(18));
    EXPECT_EQ(cale::factored_events()[0], Event::down_left);
    EXPECT_EQ(cale::factored_events()[8], Event::noop);
    EXPECT_EQ(cale::factored_events()[9], Event::fire);
    EXPECT_EQ(cale::factored_events()[17], Event::up_right_fire);
    // At every threshold that a diagonal can pass.
    for (std::int64_t action = 0; action < 18; ++action)
        for (const float threshold : {0.05F, 0.3F, 0.7F})
            EXPECT_EQ(joystick_event(cale::factored_stick(action), threshold),
                      cale::factored_events()[static_cast<std::size_t>(action)]);
    EXPECT_NEAR(cale::factored_stick(17).radius * std::cos(cale::factored_stick(17).theta), kDiagonal, 1e-6);
    EXPECT_THROW(cale::factored_stick(18), std::out_of_range);
    EXPECT_THROW(cale::factored_stick(-1), std::out_of_range);
}

TEST(Joystick, SpacesHaveTheirCoordinatesNamesAndLandmarks) {
    for (const auto joystick : {Joystick::polar, Joystick::cartesian, Joystick::direction}) {
        const auto box = std::get<cale::Box>(cale::joystick_space(joystick));
        const auto size = static_cast<std::size_t>(box.size());
        ASSERT_EQ(size, cale::stick_coordinates(joystick).size());
        ASSERT_EQ(box.names.size(), size);
        // Each landmark lies in the box and reaches an event of its own.
        ASSERT_EQ(box.landmarks.size(), 18 * size);
        std::set<Event> reached;
        for (std::size_t i = 0; i < box.landmarks.size(); i += size)
            reached.insert(
                joystick_event(cale::stick(joystick, std::span(box.landmarks).subspan(i, size)), 0.5F));
        EXPECT_THAT(reached, testing::SizeIs(18)) << cale::name_of(joystick);
    }
    const auto discrete = std::get<cale::Discrete>(cale::joystick_space(Joystick::factored));
    EXPECT_EQ(discrete.n, 18);
    EXPECT_THAT(discrete.factors, testing::ElementsAre(3, 3, 2));
}

// What makes the difference for exploration: the share of uniformly random actions in each zone.
TEST(Joystick, UniformCartesianActionsReachTheDiagonals) {
    std::array<int, 18> polar{}, cartesian{};
    constexpr int kSteps = 200;
    const auto from_0_to_1 = [](int i) { return (static_cast<float>(i) + 0.5F) / kSteps; };
    for (int i = 0; i < kSteps; ++i)
        for (int j = 0; j < kSteps; ++j) {
            const float u = from_0_to_1(i), v = from_0_to_1(j);
            ++polar[static_cast<std::size_t>(event_of(Joystick::polar, {u, (2 * v - 1) * kPi, 0}))];
            ++cartesian[static_cast<std::size_t>(event_of(Joystick::cartesian, {2 * u - 1, 2 * v - 1, 0}))];
        }
    const auto share = [](const auto& counts, Event event) {
        return counts[static_cast<std::size_t>(event)] / static_cast<double>(kSteps * kSteps);
    };
    // docs/learning.md has the whole table
    EXPECT_NEAR(share(polar, Event::noop), 0.56, 0.01);
    EXPECT_NEAR(share(polar, Event::left), 0.096, 0.005);
    EXPECT_NEAR(share(polar, Event::up_left), 0.014, 0.003);
    EXPECT_NEAR(share(cartesian, Event::noop), 0.25, 0.01);
    EXPECT_NEAR(share(cartesian, Event::left), 0.125, 0.005);
    EXPECT_NEAR(share(cartesian, Event::up_left), 0.0625, 0.003);
}

TEST(Joystick, WhatIsOutsideIsNamed) {
    const auto refusal = [](Joystick joystick, std::vector<float> action) {
        return message_of<std::invalid_argument>([&] { cale::stick(joystick, action); });
    };
    const float nan = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THAT(refusal(Joystick::polar, {0.5F, 4, 0}), HasSubstr("theta is 4: it must lie in [-pi, pi]"));
    EXPECT_THAT(refusal(Joystick::polar, {nan, 0, 0}), HasSubstr("radius is nan"));
    EXPECT_THAT(refusal(Joystick::cartesian, {1.5F, 0, 0}), HasSubstr("x is 1.5: it must lie in [-1, 1]"));
    EXPECT_THAT(refusal(Joystick::cartesian, {0, nan, 0}), HasSubstr("y is nan"));
    EXPECT_THAT(refusal(Joystick::direction, {0, 0, -0.5F, 0}), HasSubstr("radius is -0.5"));
    EXPECT_THAT(refusal(Joystick::direction, {0, 0, 0}), HasSubstr("4 coordinates, not 3"));
    EXPECT_THAT(refusal(Joystick::cartesian, {0, 0, 0, 0}), HasSubstr("3 coordinates, not 4"));
}

}  // namespace
