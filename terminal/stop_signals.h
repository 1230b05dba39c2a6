// How a run is asked to end.
#pragma once

#include <csignal>
#include <string_view>

namespace cale {

/// While it lives, the first SIGINT or SIGTERM makes stop_requested() true; the next one, of either, kills.
/// One at a time.
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
/// The name of the signal that came: "SIGINT" or "SIGTERM". Empty where none did.
std::string_view stop_signal();

}  // namespace cale
