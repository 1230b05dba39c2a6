#include "terminal/stop_signals.h"

namespace cale {
namespace {

volatile std::sig_atomic_t requested = 0;

}  // namespace

StopSignals::StopSignals() {
    requested = 0;
    struct sigaction action = {};
    action.sa_handler = [](int signal) {
        requested = signal;
        std::signal(SIGINT, SIG_DFL);
        std::signal(SIGTERM, SIG_DFL);
    };
    action.sa_flags = SA_RESTART;  // so that a checkpoint being written continues
    sigaction(SIGINT, &action, &before_interrupt_);
    sigaction(SIGTERM, &action, &before_terminate_);
}

StopSignals::~StopSignals() {
    sigaction(SIGINT, &before_interrupt_, nullptr);
    sigaction(SIGTERM, &before_terminate_, nullptr);
}

bool stop_requested() {
    return requested != 0;
}

std::string_view stop_signal() {
    if (!stop_requested()) return {};
    return requested == SIGINT ? "SIGINT" : "SIGTERM";
}

}  // namespace cale
