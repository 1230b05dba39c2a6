#include "sweep/child.h"

#include <chrono>
#include <csignal>
#include <optional>
#include <thread>

#include <gtest/gtest.h>
#include <sys/types.h>

#include "support/temporary_folder.h"
#include "terminal/stop_signals.h"

namespace cale {
namespace {

ChildEnd end_of(pid_t child) {
    while (true) {
        if (const auto end = poll_child(child)) return *end;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

TEST(Child, ASignalThatComesBeforeItsProgramHasBegunIsTheProgramsOwn) {
    const test::TemporaryFolder folder;
    const SignalHandler handler([](int) {});  // a sweep's; the child has it, too, until its program begins
    for (int i = 0; i < 20; ++i) {
        const auto child =
            start_child({"/bin/sleep", "60"}, {.output = folder.path() / "output.log", .cpus = {}});
        ::kill(child, SIGTERM);
        EXPECT_EQ(end_of(child).signal, SIGTERM);
    }
}

TEST(Child, AHangUpThatIsIgnoredStaysSo) {
    const test::TemporaryFolder folder;
    auto* const before = std::signal(SIGHUP, SIG_IGN);  // as under nohup
    const auto child =
        start_child({"/bin/sleep", "60"}, {.output = folder.path() / "output.log", .cpus = {}});
    ::kill(child, SIGHUP);
    ::kill(child, SIGTERM);  // of two that wait the lower number comes first
    EXPECT_EQ(end_of(child).signal, SIGTERM);
    std::signal(SIGHUP, before);
}

}  // namespace
}  // namespace cale
