#include "storage/run_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>

namespace cale {
namespace {

constexpr const char* kFile = ".lock";

/// Who holds the lock, as it wrote there: for the message only.
std::string holder(int descriptor) {
    std::array<char, 32> text{};
    const auto size = ::pread(descriptor, text.data(), text.size(), 0);
    const std::string_view digits(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
    const bool number =
        !digits.empty() && std::ranges::all_of(digits, [](char c) { return c >= '0' && c <= '9'; });
    return number ? fmt::format("process {}", digits) : "another process";
}

/// Returns the folder's file, which it has locked.
Descriptor lock_file_of(const std::filesystem::path& run_dir) {
    const auto path = run_dir / kFile;
    Descriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666));
    if (!file.is_open()) {
        throw std::system_error(errno, std::generic_category(),
                                fmt::format("cannot write '{}'", path.string()));
    }
    for (int waits = 0; ::flock(file.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK; ++waits) {
        if (waits < 10) {  // is_taken() of another process holds it for a moment
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
            continue;
        }
        throw FolderTaken(fmt::format(
            "{} is training in {}: wait for it or stop it, or give this run another folder with --run-dir",
            holder(file.get()), run_dir.string()));
    }
    return file;
}

/// Whether the folder's file is the one that is open, and not a later one.
bool is_in(const std::filesystem::path& run_dir, int descriptor) {
    struct stat open = {}, named = {};
    return ::fstat(descriptor, &open) == 0 && ::stat((run_dir / kFile).c_str(), &named) == 0 &&
           open.st_dev == named.st_dev && open.st_ino == named.st_ino;
}

}  // namespace

RunLock::RunLock(const std::filesystem::path& run_dir) : file_(lock_file_of(run_dir)) {
    // Where it was removed between its opening and its locking, another process may lock the next one.
    while (!is_in(run_dir, file_.get())) file_ = lock_file_of(run_dir);
    const auto pid = std::to_string(::getpid());
    // A message without a process id is no reason to stop.
    static_cast<void>(::ftruncate(file_.get(), 0) == 0 &&
                      ::pwrite(file_.get(), pid.data(), pid.size(), 0) == static_cast<ssize_t>(pid.size()));
}

bool RunLock::is_taken(const std::filesystem::path& run_dir) {
    const Descriptor file(::open((run_dir / kFile).c_str(), O_RDONLY | O_CLOEXEC));
    return file.is_open() && ::flock(file.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

}  // namespace cale
