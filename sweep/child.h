// A run as a child process.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace cale {

/// How a child ended.
struct ChildEnd {
    int exit_code = -1;  // -1: a signal ended it
    int signal = 0;
};

/// "exit code 1", "killed by signal 9 (Killed)".
std::string text_of(const ChildEnd& end);

/// Where a child process writes, and runs.
struct ChildSettings {
    std::filesystem::path output;  // both streams are appended to it
    std::vector<int> cpus;         // it may use these; empty: any
};

/// Starts a program. The child has a process group of its own, so that Ctrl-C at the terminal reaches it
/// through its parent alone, and gets SIGTERM when the thread that called this dies, however it dies. It
/// inherits the descriptors that are open without O_CLOEXEC. Exit code 127: there is no such program,
/// or the caller died first.
/// Throws std::system_error.
pid_t start_child(const std::vector<std::string>& command, const ChildSettings& settings);

/// Returns how the child ended; none while it runs. Must not be called again after it has returned an end.
/// Throws std::system_error.
std::optional<ChildEnd> poll_child(pid_t child);

/// Returns the descriptor, or in its place one above the standard streams, which a child opens for itself:
/// where one of them is closed, a file may have its number. -1 stays -1.
int above_standard_streams(int descriptor);

}  // namespace cale
