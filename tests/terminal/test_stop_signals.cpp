#include "terminal/stop_signals.h"

#include <chrono>
#include <csignal>
#include <thread>

#include <gtest/gtest.h>

namespace cale {
namespace {

TEST(StopSignals, TwoAtOnceAreOneStop) {
    const StopSignals signals;
    EXPECT_FALSE(stop_requested());
    // As `timeout` sends them: to its child, and then to its child's group.
    std::raise(SIGTERM);
    std::raise(SIGTERM);
    std::raise(SIGINT);
    EXPECT_TRUE(stop_requested());
    EXPECT_EQ(stop_signal(), "SIGTERM") << "the first";
}

TEST(StopSignalsDeath, ALaterInterruptKillsAndWhatIsSentMoreThanOnceDoesNot) {
    auto* const hang_up = std::signal(SIGHUP, SIG_DFL);  // under nohup it is ignored
    const auto stop_twice = [](int second, int first = SIGINT) {
        const StopSignals signals;
        std::raise(first);
        std::this_thread::sleep_for(std::chrono::milliseconds(600));
        std::raise(second);
    };
    EXPECT_EXIT(stop_twice(SIGINT), testing::KilledBySignal(SIGINT), "");
    EXPECT_EXIT(stop_twice(SIGTERM), testing::KilledBySignal(SIGTERM), "");
    stop_twice(SIGHUP);
    EXPECT_TRUE(stop_requested());
    EXPECT_EXIT(stop_twice(SIGINT, SIGTERM), testing::KilledBySignal(SIGINT), "");
    stop_twice(SIGTERM, SIGTERM);  // a batch system's, and that of the sweep that it stops as well
    EXPECT_EQ(stop_signal(), "SIGTERM");
    stop_twice(SIGTERM, SIGHUP);
    EXPECT_EQ(stop_signal(), "SIGHUP");
    std::signal(SIGHUP, hang_up);
}

TEST(StopSignals, OneInsideAnotherContinuesIt) {
    const StopSignals signals;
    std::raise(SIGTERM);
    { const StopSignals again; }
    EXPECT_EQ(stop_signal(), "SIGTERM");
    std::raise(SIGTERM);  // still caught
    {
        const StopSignals again;
        EXPECT_TRUE(stop_requested());
    }
}

TEST(StopSignals, AnIgnoredHangUpStaysIgnoredAnInterruptDoesNot) {
    auto* const hang_up = std::signal(SIGHUP, SIG_IGN);
    auto* const interrupt = std::signal(SIGINT, SIG_IGN);
    {
        const StopSignals signals;
        std::raise(SIGHUP);   // as under nohup
        std::raise(SIGPIPE);  // of a reader that is gone
        EXPECT_FALSE(stop_requested());
        std::raise(SIGINT);  // scripts ignore it for what they leave in the background
        EXPECT_EQ(stop_signal(), "SIGINT");
    }
    std::signal(SIGHUP, hang_up);
    std::signal(SIGINT, interrupt);
}

}  // namespace
}  // namespace cale
