#include "terminal/standard_output.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <stdexcept>
#include <string>

namespace cale {

void flush_standard_output() {
    std::cout.flush();  // into stdout, with whose buffer it is synchronised
    const bool flushed = std::fflush(stdout) == 0;
    const std::string reason = flushed ? "part of it is lost; is the disk full?" : std::strerror(errno);
    if (flushed && std::ferror(stdout) == 0) return;
    throw std::runtime_error("cannot write to the standard output: " + reason);
}

}  // namespace cale
