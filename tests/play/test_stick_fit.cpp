// The motion of a joystick, found again from logs of sticks whose motion is known.
#include "play/stick_fit.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/golden.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

/// Told to be elsewhere every 20 frames, for 10 seconds; measured with an error of about `noise` radii.
StickLog log_of(const StickMotion& motion, double noise = 0) {
    StickLog log;
    for (std::uint64_t frame = 0; frame < 600; ++frame) {
        const auto uniform = [&](std::uint64_t which) {
            return 1.4 * (static_cast<double>(golden::bits(which, frame / 20) % 1000) / 1000 - 0.5);
        };
        log.commanded.push_back({uniform(1), uniform(2)});
    }
    log.measured = simulated(motion, log.commanded);
    for (std::size_t i = 0; i < log.measured.size(); ++i) {
        const auto error = [&](std::uint64_t which) {
            return noise * std::sqrt(12.0) *
                   (static_cast<double>(golden::bits(which, i) % 1000) / 1000 - 0.5);
        };
        log.measured[i].x += error(3);
        log.measured[i].y += error(4);
    }
    return log;
}

TEST(StickFit, FindsTheMotionWithoutMass) {
    for (const double speed : {0.03, 0.15, 0.6}) {
        for (const std::int64_t latency : {0, 5}) {
            const auto fit =
                fit_stick(log_of({.stick_speed = speed, .action_latency = {latency, latency}}, 0.01));
            EXPECT_FALSE(fit.best().motion.stick_damping) << speed;
            EXPECT_NEAR(*fit.best().motion.stick_speed / speed, 1, 0.03) << speed;
            EXPECT_EQ(fit.best().motion.action_latency.low, latency) << speed;
            EXPECT_NEAR(fit.best().error, 0.01 * std::sqrt(2.0), 0.002) << speed;
        }
    }
}

TEST(StickFit, FindsTheMotionWithMass) {
    for (const double damping : {0.3, 0.8, 1.5}) {
        const auto fit = fit_stick(
            log_of({.stick_speed = 0.1, .stick_damping = damping, .action_latency = {3, 3}}, 0.005));
        ASSERT_TRUE(fit.best().motion.stick_damping) << damping;
        EXPECT_NEAR(*fit.best().motion.stick_damping / damping, 1, 0.05) << damping;
        EXPECT_NEAR(*fit.best().motion.stick_speed / 0.1, 1, 0.05) << damping;
        EXPECT_EQ(fit.best().motion.action_latency.low, 3) << damping;
        EXPECT_GT(fit.without_mass.error, 2 * fit.with_mass.error) << damping;
    }
}

TEST(StickFit, TheTextIsAConfiguration) {
    const auto log = log_of({.stick_speed = 0.1, .stick_damping = 0.5, .action_latency = {2, 2}});
    const auto text = stick_fit_text(log, fit_stick(log));
    EXPECT_THAT(text, StartsWith("# Fitted to 600 frames of 1/60 s; error 0.000"));
    EXPECT_THAT(text, HasSubstr("\nenv:\n  stick_speed: 0.1\n  stick_damping: 0.5\n  action_latency: 2\n"));
}

TEST(StickFit, WarnsWhereTheSearchEnds) {
    auto log = log_of({.stick_speed = 0.3, .action_latency = {100, 100}});
    EXPECT_THAT(stick_fit_text(log, fit_stick(log)), HasSubstr("# Warning: action_latency is at the end of"));
    log = log_of({.stick_speed = 0.3});
    EXPECT_THAT(stick_fit_text(log, fit_stick(log)), ::testing::Not(HasSubstr("Warning")));
}

TEST(StickFit, WarnsWhereNoStickMovesSo) {
    auto log = log_of({.stick_speed = 0.1, .action_latency = {2, 2}});
    for (auto& [x, y] : log.measured) x = -x, y = -y;
    EXPECT_THAT(stick_fit_text(log, fit_stick(log)), HasSubstr("radii away from the log's"));
}

class StickLogs : public ::testing::Test {
  protected:
    std::string error_of(const std::string& text) {
        const auto file = folder_.write("log.csv", text);
        try {
            read_stick_log(file);
        } catch (const std::runtime_error& error) {
            const std::string what = error.what();
            return what.substr(what.find("log.csv"));
        }
        return "";
    }
    test::TemporaryFolder folder_;
};

TEST_F(StickLogs, AreResampledAtTheConsolesFrames) {
    // 100 rows a second, twice the console's rate and more; the stick follows at 2 radii per second.
    std::string text = "frame,seconds,command_x,command_y,x,y\n";
    for (int row = 0; row <= 100; ++row) {
        const double seconds = 5 + row / 100.0;
        text += fmt::format("{},{},{},0,{},0\n", row, seconds, row < 50 ? 1 : -1, std::min(1.0, row / 50.0));
    }
    const auto log = read_stick_log(folder_.write("log.csv", text));
    ASSERT_EQ(log.commanded.size(), 60u);
    EXPECT_NEAR(log.measured[0].x, 2 / 60.0, 1e-9);  // at the end of the first frame
    EXPECT_NEAR(log.measured[14].x, 0.5, 1e-9);
    EXPECT_EQ(log.commanded[29].x, 1);   // begins at 29/60 s
    EXPECT_EQ(log.commanded[30].x, -1);  // at 30/60
}

TEST_F(StickLogs, OfTimesInMillisecondsAreReadFrameByFrame) {
    // A row for every frame, whose time is rounded: the command changes with the row, not a frame later.
    std::string text = "seconds,command_x,command_y,x,y\n";
    for (int row = 0; row <= 60; ++row)
        text += fmt::format("{:.3f},{},0,{},0\n", row / 60.0, row % 7 < 3 ? 1 : -1, row > 0 ? 0.5 : 0);
    const auto log = read_stick_log(folder_.write("log.csv", text));
    ASSERT_EQ(log.commanded.size(), 60u);
    for (std::size_t frame = 0; frame < 60; ++frame)
        EXPECT_EQ(log.commanded[frame].x, frame % 7 < 3 ? 1 : -1) << frame;
}

TEST_F(StickLogs, OfCommandsBetweenFramesHaveTheSameLatency) {
    // A stick that moves by 0.2 radii in a frame, two frames after its command; commands and rows come every
    // ten milliseconds.
    std::string text = "seconds,command_x,command_y,x,y\n";
    constexpr double kStep = 0.2 * 60 / 1000;
    std::vector<double> commanded;
    double x = 0;
    std::uint64_t number = 0, next = 500;
    for (std::uint64_t ms = 0; ms < 20'000; ++ms) {
        if (ms == next) next += 150 + 10 * (golden::bits(1, ++number) % 45);
        commanded.push_back(number % 2 == 0 ? 0 : number % 4 == 1 ? 1 : -1);
        if (ms % 10 == 0)
            text += fmt::format("{:.3f},{},0,{:.4f},0\n", 1e-3 * static_cast<double>(ms), commanded[ms], x);
        const double target = ms < 33 ? 0 : commanded[ms - 33];
        x += std::clamp(target - x, -kStep, kStep);
    }
    const auto best = fit_stick(read_stick_log(folder_.write("log.csv", text))).best();
    EXPECT_EQ(best.motion.action_latency.low, 2);
    EXPECT_FALSE(best.motion.stick_damping);
    EXPECT_NEAR(*best.motion.stick_speed / 0.2, 1, 0.03);
}

TEST_F(StickLogs, ThatCannotBeUsedAreNamed) {
    const std::string header = "seconds,command_x,command_y,x,y\n";
    EXPECT_THAT(error_of(header + "0,1,0,0,0\n0.1,1,0,0.1,0\n0.45,1,0,1,0\n0.6,1,0,1,0\n"),
                HasSubstr("log.csv:4: the stick moved by 0.9 radii in the 0.35 s before this row"));
    EXPECT_THAT(
        error_of("seconds,command_x,x,y\n0,0,0,0\n"),
        HasSubstr("log.csv: there is no column 'command_y'; it needs seconds,command_x,command_y,x,y"));
    EXPECT_THAT(error_of(header + "0,0,0,0,0\n0.4,0,0,0,0\n"), HasSubstr("shorter than half a second"));
    EXPECT_THAT(error_of(header), HasSubstr("shorter than half a second"));
    EXPECT_THAT(error_of(header + "0,0,0,0,0\n5000,1,0,1,0\n"), HasSubstr("lasts 5000 s"));
    EXPECT_THAT(error_of(header + "0,0,0,0,0\n1e300,1,0,1,0\n"), HasSubstr("lasts 1e+300 s"));
    EXPECT_THAT(error_of(header + "0,0,0,0,0\n1,0,0,0,0\n1,0,0,0,0\n"),
                HasSubstr("log.csv:4: the seconds must increase from row to row"));
    EXPECT_THAT(error_of(header + "0,0,0,0,0\n1,512,0,0,0\n"), HasSubstr("log.csv:3: (512, 0) is more than"));
    EXPECT_THAT(error_of(header + "0,0,0,0.9,0\n1,0,0,0,0\n"), HasSubstr("log.csv:2: the stick must begin"));
    EXPECT_THAT(error_of(header + "0,0,0,0,0\n1,0,0,0.5,0\n"),
                HasSubstr("the stick is never commanded to move by"));
    EXPECT_THAT(error_of(header + "0,1,0,0,0\n1,0,0,0,0\n"), HasSubstr("the stick is never moved by more"));
    EXPECT_THAT(error_of(header + "0,0,0,0,0\n1,0,left,0,0\n"), HasSubstr("line 3 is '1,0,left,0,0'"));
}

TEST(StickFigures, HaveTheirCurves) {
    const auto log = log_of({.stick_speed = 0.1});
    const auto svg = to_svg(stick_fit_picture(log, fit_stick(log)));
    for (const auto* word : {"commanded", "measured", "fitted", "radii"}) EXPECT_THAT(svg, HasSubstr(word));
    EnvConfig env;
    env.motion = {.stick_speed = 0.25, .button_frames = 4};
    const auto response = to_svg(step_response_picture(env, 12));
    for (const auto* word : {"threshold", "RIGHTFIRE", "NOOP", "stick_speed 0.25, button_frames 4"})
        EXPECT_THAT(response, HasSubstr(word));
}

TEST(StickFigures, TheStepResponseIsATableToo) {
    EnvConfig env;
    env.motion = {.stick_speed = 0.4, .button_frames = 2, .action_latency = {0, 1}};
    EXPECT_EQ(step_response_text(env, 4),
              "frame      x  button  event\n"
              "    1   0.00    0.00  NOOP\n"  // the longest latency
              "    2   0.40    0.50  NOOP\n"
              "    3   0.80    1.00  RIGHTFIRE\n"
              "    4   1.00    1.00  RIGHTFIRE\n"
              "    5   1.00    1.00  RIGHTFIRE\n"
              "    6   0.60    0.50  RIGHT\n"
              "    7   0.20    0.00  NOOP\n"
              "    8   0.00    0.00  NOOP\n");
    env.event_map = EventMap::ale_0_10;
    EXPECT_THAT(step_response_text(env, 4), HasSubstr("    1   0.00    0.00  DOWNLEFT\n"));
}

}  // namespace
}  // namespace cale
