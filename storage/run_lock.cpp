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

/// Returns the descriptor of the folder's file, which it has locked.
int lock_file_of(const std::filesystem::path& run_dir) {
    const auto file = run_dir / kFile;
    const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor < 0) {
        throw std::system_error(errno, std::generic_category(),
                                fmt::format("cannot write '{}'", file.string()));
    }
    for (int waits = 0; ::flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK; ++waits) {
        if (waits < 10) {  // is_taken() of another process holds it for a moment
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
            continue;
        }
        const auto who = holder(descriptor);
        ::close(descriptor);
        throw FolderTaken(fmt::format(
            "{} is training in {}: wait for it or stop it, or give this run another folder with --run-dir",
            who, run_dir.string()));
    }
    return descriptor;
}

/// Whether the folder's file is the one that is open, and not a later one.
bool is_in(const std::filesystem::path& run_dir, int descriptor) {
    struct stat open = {}, named = {};
    return ::fstat(descriptor, &open) == 0 && ::stat((run_dir / kFile).c_str(), &named) == 0 &&
           open.st_dev == named.st_dev && open.st_ino == named.st_ino;
}

}  // namespace

RunLock::RunLock(const std::filesystem::path& run_dir) : descriptor_(lock_file_of(run_dir)) {
    // Where it was removed between its opening and its locking, another process may lock the next one.
    while (!is_in(run_dir, descriptor_)) {
        ::close(descriptor_);
        descriptor_ = lock_file_of(run_dir);
    }
    const auto pid = std::to_string(::getpid());
    // A message without a process id is no reason to stop.
    static_cast<void>(::ftruncate(descriptor_, 0) == 0 &&
                      ::pwrite(descriptor_, pid.data(), pid.size(), 0) == static_cast<ssize_t>(pid.size()));
}

RunLock::~RunLock() {
    ::close(descriptor_);
}

bool RunLock::is_taken(const std::filesystem::path& run_dir) {
    const int descriptor = ::open((run_dir / kFile).c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) return false;
    const bool taken = ::flock(descriptor, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    ::close(descriptor);
    return taken;
}

}  // namespace cale
