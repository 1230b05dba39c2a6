// A terminal that a test reads.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>

namespace test {

/// A pseudo terminal of `columns` columns.
class Terminal {
  public:
    explicit Terminal(unsigned short columns) : master_(::posix_openpt(O_RDWR | O_NOCTTY)) {
        ::grantpt(master_);
        ::unlockpt(master_);
        file_ = std::fopen(::ptsname(master_), "w");
        const winsize size{.ws_row = 24, .ws_col = columns, .ws_xpixel = 0, .ws_ypixel = 0};
        ::ioctl(master_, TIOCSWINSZ, &size);
    }
    ~Terminal() {
        std::fclose(file_);
        ::close(master_);
    }
    Terminal(const Terminal&) = delete;
    Terminal& operator=(const Terminal&) = delete;

    std::FILE* file() { return file_; }

    /// Returns what was written since the call before.
    std::string shown() {
        std::string text;
        char buffer[4096];
        pollfd ready{.fd = master_, .events = POLLIN, .revents = 0};
        while (::poll(&ready, 1, 200) > 0) {
            const auto count = ::read(master_, buffer, sizeof buffer);
            if (count <= 0) break;
            text.append(buffer, static_cast<std::size_t>(count));
        }
        return text;
    }

  private:
    int master_;
    std::FILE* file_;
};

}  // namespace test
