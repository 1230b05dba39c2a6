#include "play/keyboard.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "cale/env.h"

namespace cale {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;

/// The action while these keys are held.
ContinuousAction held(const std::vector<std::string>& keys) {
    Hands hands;
    for (const auto& key : keys) EXPECT_EQ(press(hands, key, true), Command::none) << key;
    return joystick(hands);
}

TEST(Keyboard, ArrowsAndLettersPushTheStickAllTheWay) {
    const std::vector<std::pair<std::vector<std::string>, float>> directions = {
        {{"Right"}, 0},
        {{"D"}, 0},
        {{"Up"}, kPi / 2},
        {{"W"}, kPi / 2},
        {{"Left"}, kPi},
        {{"A"}, kPi},
        {{"Down"}, -kPi / 2},
        {{"S"}, -kPi / 2},
        {{"Up", "D"}, kPi / 4},
        {{"W", "Left"}, 3 * kPi / 4},
        {{"S", "Right"}, -kPi / 4},
        {{"Down", "A"}, -3 * kPi / 4}};
    for (const auto& [keys, theta] : directions) {
        const auto action = held(keys);
        EXPECT_NEAR(action.radius, 1, 1e-6) << keys[0];
        EXPECT_NEAR(action.theta, theta, 1e-6) << keys[0];
        EXPECT_EQ(action.fire, 0) << keys[0];
        EXPECT_NO_THROW(validate(action)) << keys[0];
    }
}

TEST(Keyboard, ReachesAllEighteenEventsAtTheDefaultThreshold) {
    std::vector<bool> reached(kEventCount);
    for (const std::string vertical : {"", "Up", "Down"})
        for (const std::string horizontal : {"", "Left", "Right"})
            for (const std::string fire : {"", "Space"})
                reached[static_cast<std::size_t>(joystick_event(held({vertical, horizontal, fire}), 0.5F))] =
                    true;
    for (std::size_t event = 0; event < kEventCount; ++event) EXPECT_TRUE(reached[event]) << event;
}

TEST(Keyboard, OppositeKeysAndNoKeysLeaveTheStickInTheMiddle) {
    for (const auto& action : {held({}), held({"Left", "Right"}), held({"W", "S", "A", "D"})}) {
        EXPECT_EQ(action.radius, 0);
        EXPECT_EQ(action.fire, 0);
    }
}

TEST(Keyboard, KeysThatAreLetGoNoLongerCount) {
    Hands hands;
    press(hands, "Left", true);
    press(hands, "Space", true);
    EXPECT_EQ(joystick(hands).fire, 1);
    press(hands, "Left", false);
    press(hands, "Space", false);
    EXPECT_EQ(joystick(hands).radius, 0);
    EXPECT_EQ(joystick(hands).fire, 0);
}

TEST(Keyboard, AKeyThatIsTappedBetweenTwoStepsCountsInTheNextOne) {
    Hands hands;
    press(hands, "Space", true);
    press(hands, "Space", false);
    EXPECT_EQ(take_joystick(hands).fire, 1);
    EXPECT_EQ(take_joystick(hands).fire, 0);
    press(hands, "Left", true);
    EXPECT_EQ(take_joystick(hands).radius, 1);
    EXPECT_EQ(take_joystick(hands).radius, 1);  // as it is held
}

TEST(Keyboard, OfTwoKeysThatDoTheSameOneIsEnough) {
    Hands hands;
    for (const auto* const key : {"Up", "W", "Space", "Right Button", "Left Shift", "Right Shift"})
        press(hands, key, true);
    for (const auto* const key : {"W", "Right Button", "Left Shift"}) press(hands, key, false);
    EXPECT_NEAR(joystick(hands).radius, 0.5, 1e-6);
    EXPECT_NEAR(joystick(hands).theta, kPi / 2, 1e-6);
    EXPECT_EQ(joystick(hands).fire, 1);
}

TEST(Keyboard, DigitsSayHowFarTheKeysPushAndShiftHalvesIt) {
    EXPECT_NEAR(held({"3", "Left"}).radius, 0.3, 1e-6);
    EXPECT_NEAR(held({"3", "0", "Left"}).radius, 1, 1e-6);
    EXPECT_NEAR(held({"Left Shift", "Left"}).radius, 0.5, 1e-6);
    EXPECT_NEAR(held({"8", "Right Shift", "Up", "Left"}).radius, 0.4, 1e-6);
    // A digit stays in force when it is let go.
    Hands hands;
    press(hands, "2", true);
    press(hands, "2", false);
    press(hands, "Up", true);
    EXPECT_NEAR(joystick(hands).radius, 0.2, 1e-6);
}

TEST(Keyboard, CommandsAreGivenWhenTheirKeyGoesDown) {
    Hands hands;
    for (const auto& [key, command] : {std::pair{"P", Command::pause},
                                       {"R", Command::new_game},
                                       {"Escape", Command::quit},
                                       {"Q", Command::none}}) {
        EXPECT_EQ(press(hands, key, true), command) << key;
        EXPECT_EQ(press(hands, key, false), Command::none) << key;
    }
    EXPECT_EQ(joystick(hands).radius, 0);
}

TEST(Mouse, PlacesTheStickWhereItPointsAndAtTheRimBeyond) {
    const Dial dial{.x = 100, .y = 200, .radius = 50};
    Hands hands;
    hands.pointer = stick_at(125, 200, dial);
    EXPECT_NEAR(joystick(hands).radius, 0.5, 1e-6);
    EXPECT_NEAR(joystick(hands).theta, 0, 1e-6);
    hands.pointer = stick_at(100, 160, dial);  // above the middle
    EXPECT_NEAR(joystick(hands).radius, 0.8, 1e-6);
    EXPECT_NEAR(joystick(hands).theta, kPi / 2, 1e-6);
    hands.pointer = stick_at(-400, 700, dial);
    EXPECT_NEAR(joystick(hands).radius, 1, 1e-6);
    EXPECT_NEAR(joystick(hands).theta, -3 * kPi / 4, 1e-6);
    EXPECT_NO_THROW(validate(joystick(hands)));
    // It goes before the keys, but for fire.
    press(hands, "Right", true);
    press(hands, "Space", true);
    EXPECT_NEAR(joystick(hands).theta, -3 * kPi / 4, 1e-6);
    EXPECT_EQ(joystick(hands).fire, 1);
}

}  // namespace
}  // namespace cale
