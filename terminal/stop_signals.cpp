#include "terminal/stop_signals.h"

#include <atomic>
#include <cstddef>

namespace cale {
namespace {

std::atomic<int> requested = 0;  // read by other threads, too
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler may not wait");

constexpr std::array kSignals{SIGINT, SIGTERM, SIGHUP};

void request_stop(int signal) {
    requested = signal;
    // A terminal that is closed sends SIGHUP more than once.
    for (const int next : kSignals) std::signal(next, next == SIGHUP ? SIG_IGN : SIG_DFL);
}

}  // namespace

SignalHandler::SignalHandler(void (*handler)(int signal)) {
    static_assert(kSignals.size() == std::tuple_size_v<decltype(before_)>);
    struct sigaction action = {};
    action.sa_handler = handler;
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

SignalHandler::~SignalHandler() {
    for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
    sigaction(SIGPIPE, &pipe_before_, nullptr);
}

StopSignals::StopSignals()
    : handler_([] {
          requested = 0;  // before the first signal can come
          return request_stop;
      }()) {}

bool stop_requested() {
    return requested != 0;
}

std::string_view stop_signal() {
    const int signal = requested;
    if (signal == 0) return {};
    return signal == SIGINT ? "SIGINT" : signal == SIGHUP ? "SIGHUP" : "SIGTERM";
}

}  // namespace cale
