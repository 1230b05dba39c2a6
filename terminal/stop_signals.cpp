#include "terminal/stop_signals.h"

#include <atomic>
#include <cstddef>

namespace cale {
namespace {

std::atomic<int> requested = 0;  // read by other threads, too
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler may not wait");

}  // namespace

StopSignals::StopSignals() {
    requested = 0;
    struct sigaction action = {};
    action.sa_handler = [](int signal) {
        requested = signal;
        // A terminal that is closed sends SIGHUP more than once.
        for (const int next : kSignals) std::signal(next, next == SIGHUP ? SIG_IGN : SIG_DFL);
    };
    action.sa_flags = SA_RESTART;  // so that a checkpoint being written continues
    for (std::size_t i = 0; i < kSignals.size(); ++i) {
        sigaction(kSignals[i], nullptr, &before_[i]);
        if (kSignals[i] == SIGHUP && before_[i].sa_handler == SIG_IGN) continue;
        sigaction(kSignals[i], &action, nullptr);
    }
    struct sigaction ignore = {};
    ignore.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &ignore, &pipe_before_);
}

StopSignals::~StopSignals() {
    for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
    sigaction(SIGPIPE, &pipe_before_, nullptr);
}

bool stop_requested() {
    return requested != 0;
}

std::string_view stop_signal() {
    const int signal = requested;
    if (signal == 0) return {};
    return signal == SIGINT ? "SIGINT" : signal == SIGHUP ? "SIGHUP" : "SIGTERM";
}

}  // namespace cale
