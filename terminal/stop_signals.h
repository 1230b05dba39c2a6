// Stopping a run by a signal.
#pragma once

#include <csignal>
#include <string_view>

namespace cale {

/// While it exists, the first SIGINT or SIGTERM makes stop_requested() true; the next one, of either, kills
/// the process. Only one may exist at a time.
class StopSignals {
  public:
    StopSignals();
    ~StopSignals();
    StopSignals(const StopSignals&) = delete;
    StopSignals& operator=(const StopSignals&) = delete;

  private:
    struct sigaction before_interrupt_ = {};
    struct sigaction before_terminate_ = {};
};

/// Since the newest StopSignals began.
bool stop_requested();
/// Returns the name of the received signal, "SIGINT" or "SIGTERM"; empty if none.
std::string_view stop_signal();

}  // namespace cale
