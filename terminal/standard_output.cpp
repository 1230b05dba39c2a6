#include "terminal/standard_output.h"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <stdexcept>
#include <string>

#include <fcntl.h>
#include <unistd.h>

namespace cale {

void open_standard_streams() {
    int descriptor = 0;
    while (descriptor >= 0 && descriptor <= STDERR_FILENO) descriptor = ::open("/dev/null", O_RDONLY);
    if (descriptor > STDERR_FILENO) ::close(descriptor);
    std::signal(SIGXFSZ, SIG_IGN);
}

void flush_standard_output() {
    std::cout.flush();  // into stdout, with whose buffer it is synchronised
    const bool flushed = std::fflush(stdout) == 0;
    const std::string reason = flushed ? "part of it is lost; is the disk full?" : std::strerror(errno);
    if (flushed && std::ferror(stdout) == 0) return;
    throw std::runtime_error("cannot write to the standard output: " + reason);
}

}  // namespace cale
