// Stopping a run by a signal.
#pragma once

#include <array>
#include <csignal>
#include <string_view>

namespace cale {

/// While it exists, the first SIGINT, SIGTERM or SIGHUP makes stop_requested() true; the next SIGINT or
/// SIGTERM kills the process, while another SIGHUP is ignored. So is the first one where it was before, as
/// under nohup, and SIGPIPE, of a reader of the output that is gone. Only one may exist at a time.
class StopSignals {
  public:
    StopSignals();
    ~StopSignals();
    StopSignals(const StopSignals&) = delete;
    StopSignals& operator=(const StopSignals&) = delete;

  private:
    static constexpr std::array kSignals{SIGINT, SIGTERM, SIGHUP};
    std::array<struct sigaction, kSignals.size()> before_ = {};
    struct sigaction pipe_before_ = {};
};

/// Since the newest StopSignals began.
bool stop_requested();
/// Returns the name of the received signal, such as "SIGINT"; empty if none.
std::string_view stop_signal();

}  // namespace cale
