#include "terminal/stop_signals.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <ctime>

namespace cale {
namespace {

std::atomic<int> requested = 0;  // read by other threads, too
std::atomic<std::int64_t> requested_at = 0;
std::atomic<int> stop_signals = 0;  // how many there are
static_assert(std::atomic<int>::is_always_lock_free && std::atomic<std::int64_t>::is_always_lock_free,
              "a signal handler may not wait");

std::int64_t milliseconds() {
    struct timespec now = {};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1000 * std::int64_t{now.tv_sec} + now.tv_nsec / 1'000'000;
}

void request_stop(int signal) {
    const int first = requested;
    if (first == 0) {
        requested_at = milliseconds();
        requested = signal;
        return;
    }
    // A terminal that is closed sends SIGHUP more than once. SIGTERM comes from the batch system, and again
    // from the sweep that the run belongs to: both leave time for a checkpoint, and end by SIGKILL what takes
    // longer. `timeout` signals its child and then its group.
    constexpr std::int64_t kOneStop = 500;
    const bool kills = signal == SIGINT || (signal == SIGTERM && first == SIGINT);
    if (!kills || milliseconds() - requested_at < kOneStop) return;
    std::signal(signal, SIG_DFL);
    std::raise(signal);
}

}  // namespace

SignalHandler::SignalHandler(void (*handler)(int signal)) {
    struct sigaction action = {};
    action.sa_handler = handler;
    action.sa_flags = SA_RESTART;  // so that a checkpoint being written continues
    for (std::size_t i = 0; i < kStopSignals.size(); ++i) {
        sigaction(kStopSignals[i], nullptr, &before_[i]);
        if (kStopSignals[i] == SIGHUP && before_[i].sa_handler == SIG_IGN) continue;
        sigaction(kStopSignals[i], &action, nullptr);
    }
    struct sigaction ignore = {};
    ignore.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &ignore, &pipe_before_);
}

SignalHandler::~SignalHandler() {
    for (std::size_t i = 0; i < kStopSignals.size(); ++i) sigaction(kStopSignals[i], &before_[i], nullptr);
    sigaction(SIGPIPE, &pipe_before_, nullptr);
}

StopSignals::StopSignals()
    : handler_([] {
          if (stop_signals++ == 0) requested = 0;  // before the first signal can come
          return request_stop;
      }()) {}

StopSignals::~StopSignals() {
    --stop_signals;
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
