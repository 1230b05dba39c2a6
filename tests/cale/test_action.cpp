#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/action.h"
#include "message_of.h"
#include "support/golden.h"

namespace {

using cale::ContinuousAction;
using cale::Event;
using cale::EventMap;
using testing::HasSubstr;

constexpr float kPi = std::numbers::pi_v<float>;

TEST(GoldenMapping, EveryRowAtEveryThreshold) {
    for (const auto& name : golden::files_with({"thresholds", "random", "boundary"})) {
        const auto file = golden::load(name);
        const auto thresholds = file["thresholds"].as<std::vector<float>>();
        EXPECT_GE(file["random"].size() + file["boundary"].size(), 200U) << name;
        for (const char* table : {"random", "boundary"}) {
            EXPECT_GT(file[table].size(), 0U) << name << " " << table;
            for (const auto& row : file[table]) {
                const auto coordinate = [&row](int column) {
                    return std::bit_cast<float>(row[column].as<std::uint32_t>());
                };
                const ContinuousAction action{coordinate(3), coordinate(4), coordinate(5)};
                for (std::size_t i = 0; i < thresholds.size(); ++i) {
                    const int expected = row[6 + i].as<int>();
                    EXPECT_EQ(static_cast<int>(cale::joystick_event(action, thresholds[i])), expected)
                        << table << " row " << row << " at " << thresholds[i];
                }
            }
        }
    }
}

TEST(Action, TheOldMapHasNoCentre) {
    const auto old = [](float radius, float theta, float fire) {
        return joystick_event({radius, theta, fire}, 0.5f, EventMap::ale_0_10);
    };
    // What the symmetric map calls noop, right, up and fire.
    EXPECT_EQ(old(0, 0, 0), Event::down_left);
    EXPECT_EQ(old(1, 0, 0), Event::down_right);
    EXPECT_EQ(old(1, kPi / 2, 0), Event::up_left);
    EXPECT_EQ(old(0, 0, 1), Event::down_left_fire);
    EXPECT_EQ(old(1, kPi / 4, 0), Event::up_right);
    EXPECT_EQ(old(0.5f, 0, 0.5f), Event::down);  // x is exactly at the threshold: neither side
}

TEST(Action, LimitsAreIncluded) {
    EXPECT_NO_THROW(cale::validate({0, -kPi, 0}));
    EXPECT_NO_THROW(cale::validate({1, kPi, 1}));
}

TEST(Action, WhatIsOutsideIsNamed) {
    const auto refusal = [](ContinuousAction action) {
        return message_of<std::invalid_argument>([&] { cale::validate(action); });
    };
    const float nan = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THAT(refusal({1.5f, 0, 0}), HasSubstr("radius is 1.5: it must lie in [0, 1]"));
    EXPECT_THAT(refusal({-0.25f, 0, 0}), HasSubstr("radius is -0.25"));
    EXPECT_THAT(refusal({nan, 0, 0}), HasSubstr("radius is nan"));
    EXPECT_THAT(refusal({0, std::nextafter(kPi, 4.0f), 0}), HasSubstr("theta is 3.1415"));
    EXPECT_THAT(refusal({0, nan, 0}), HasSubstr("theta is nan: it must lie in [-pi, pi]"));
    EXPECT_THAT(refusal({0, 0, 2}), HasSubstr("fire is 2"));
    EXPECT_THAT(refusal({0, 0, std::numeric_limits<float>::infinity()}), HasSubstr("fire is inf"));
}

TEST(Action, NamesAreAles) {
    EXPECT_EQ(cale::event_name(Event::noop), "NOOP");
    EXPECT_EQ(cale::event_name(Event::down_left), "DOWNLEFT");
    EXPECT_EQ(cale::event_name(Event::up_fire), "UPFIRE");
    EXPECT_EQ(cale::event_name(Event::down_left_fire), "DOWNLEFTFIRE");
    EXPECT_EQ(static_cast<int>(Event::down_left_fire), cale::kEventCount - 1);
    EXPECT_EQ(cale::names_of(EventMap::ale_0_10)[static_cast<std::size_t>(EventMap::ale_0_10)], "ale_0_10");
}

}  // namespace
