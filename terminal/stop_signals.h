// Stopping a run by a signal.
#pragma once

#include <array>
#include <csignal>
#include <string_view>

namespace cale {

/// What stops a program, as the classes below and a sweep's runs have it.
inline constexpr std::array kStopSignals{SIGINT, SIGTERM, SIGHUP};

/// While it exists, SIGINT, SIGTERM and SIGHUP call `handler`. A SIGHUP that was ignored before, as under
/// nohup, stays so; a SIGINT does not, as scripts start all that they leave in the background with it
/// ignored. SIGPIPE, of a reader of the output that is gone, is ignored. One inside
/// another takes its place for as long as it exists.
class SignalHandler {
  public:
    explicit SignalHandler(void (*handler)(int signal));
    ~SignalHandler();
    SignalHandler(const SignalHandler&) = delete;
    SignalHandler& operator=(const SignalHandler&) = delete;

  private:
    std::array<struct sigaction, kStopSignals.size()> before_ = {};
    struct sigaction pipe_before_ = {};
};

/// While it exists, the first SIGINT, SIGTERM or SIGHUP makes stop_requested() true. From half a second later
/// SIGINT kills the process, as does SIGTERM where the first was SIGINT; all others are ignored. One inside
/// another continues it.
class StopSignals {
  public:
    StopSignals();
    ~StopSignals();
    StopSignals(const StopSignals&) = delete;
    StopSignals& operator=(const StopSignals&) = delete;

  private:
    SignalHandler handler_;
};

/// Since the newest StopSignals began that is not inside another.
bool stop_requested();
/// Returns the name of the received signal, such as "SIGINT"; empty if none.
std::string_view stop_signal();

}  // namespace cale
