#include "sweep/child.h"

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "terminal/stop_signals.h"

namespace cale {
namespace {

constexpr int kNoProgram = 127;

/// Between fork and exec: nothing here may allocate. `signals` is the mask to begin with.
[[noreturn]] void become(char* const* arguments, int output, const cpu_set_t* cpus, pid_t parent,
                         const sigset_t& signals) {
    // The handlers are still the parent's, which would take note here of a signal that is for the program.
    for (const int signal : kStopSignals)
        if (std::signal(signal, SIG_DFL) == SIG_IGN) std::signal(signal, SIG_IGN);
    ::sigprocmask(SIG_SETMASK, &signals, nullptr);
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (::getppid() != parent) ::_exit(kNoProgram);  // it died before the line above
    if (cpus != nullptr) ::sched_setaffinity(0, sizeof(*cpus), cpus);
    const int nothing = ::open("/dev/null", O_RDONLY);
    ::dup2(nothing, STDIN_FILENO);
    ::dup2(output, STDOUT_FILENO);
    ::dup2(output, STDERR_FILENO);
    if (nothing > STDERR_FILENO) ::close(nothing);
    ::execv(arguments[0], arguments);
    ::_exit(kNoProgram);
}

}  // namespace

int above_standard_streams(int descriptor) {
    if (descriptor < 0 || descriptor > STDERR_FILENO) return descriptor;
    const bool closes = (::fcntl(descriptor, F_GETFD) & FD_CLOEXEC) != 0;
    const int other = ::fcntl(descriptor, closes ? F_DUPFD_CLOEXEC : F_DUPFD, STDERR_FILENO + 1);
    ::close(descriptor);
    return other;
}

std::string text_of(const ChildEnd& end) {
    if (end.exit_code == kNoProgram) return "the program could not be started";
    if (end.exit_code >= 0) return fmt::format("exit code {}", end.exit_code);
    return fmt::format("killed by signal {} ({})", end.signal, ::strsignal(end.signal));
}

pid_t start_child(const std::vector<std::string>& command, const ChildSettings& settings) {
    std::vector<char*> arguments;
    arguments.reserve(command.size() + 1);
    for (const auto& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
    arguments.push_back(nullptr);
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    for (const int cpu : settings.cpus) CPU_SET(static_cast<std::size_t>(cpu), &cpus);

    const int output = above_standard_streams(
        ::open(settings.output.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
    if (output < 0)
        throw std::system_error(errno, std::generic_category(),
                                fmt::format("cannot write '{}'", settings.output.string()));
    const pid_t parent = ::getpid();
    sigset_t stops, before;
    sigemptyset(&stops);
    for (const int signal : kStopSignals) sigaddset(&stops, signal);
    ::pthread_sigmask(SIG_BLOCK, &stops, &before);
    const pid_t child = ::fork();
    if (child == 0) become(arguments.data(), output, settings.cpus.empty() ? nullptr : &cpus, parent, before);
    const int error = errno;
    ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
    ::close(output);
    if (child < 0) throw std::system_error(error, std::generic_category(), "cannot start a process");
    return child;
}

std::optional<ChildEnd> poll_child(pid_t child) {
    int status = 0;
    const pid_t answer = ::waitpid(child, &status, WNOHANG);
    if (answer == 0 || (answer < 0 && errno == EINTR)) return std::nullopt;
    if (answer < 0) throw std::system_error(errno, std::generic_category(), "cannot wait for a run");
    if (WIFEXITED(status)) return ChildEnd{.exit_code = WEXITSTATUS(status)};
    return ChildEnd{.signal = WTERMSIG(status)};
}

}  // namespace cale
