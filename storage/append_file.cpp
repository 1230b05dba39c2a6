#include "storage/append_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

namespace cale {

AppendFile::AppendFile(std::filesystem::path path, std::optional<std::int64_t> keep)
    : path_(std::move(path)) {
    const int mode = keep ? 0 : O_CREAT | O_TRUNC;
    // O_RDWR: a pipe without a reader cannot be opened for writing alone.
    descriptor_ = ::open(path_.c_str(), O_RDWR | O_APPEND | O_CLOEXEC | mode, 0666);
    if (descriptor_ < 0 && keep && errno == ENOENT) {
        throw CutFile(
            fmt::format("{} is missing, which had {} bytes when the checkpoint was written: restore it, or "
                        "start a new run",
                        path_.string(), *keep));
    }
    if (descriptor_ < 0) fail("open");
    try {
        struct stat status {};
        if (::fstat(descriptor_, &status) != 0) fail("read the size of");
        if (S_ISFIFO(status.st_mode))
            throw std::runtime_error(fmt::format("{} is a pipe; remove it", path_.string()));
        if (!keep) return;
        if (status.st_size < *keep) {
            throw CutFile(
                fmt::format("{} has {} bytes, but {} when the checkpoint was written: it was cut or replaced "
                            "since; restore it, or start a new run",
                            path_.string(), status.st_size, *keep));
        }
        if (::ftruncate(descriptor_, *keep) != 0) fail("cut back");
    } catch (...) {
        ::close(descriptor_);
        throw;
    }
    size_ = *keep;
}

AppendFile::~AppendFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
}

AppendFile::AppendFile(AppendFile&& other) noexcept
    : path_(std::move(other.path_)), descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_) {}

AppendFile& AppendFile::operator=(AppendFile&& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(descriptor_, other.descriptor_);
    std::swap(size_, other.size_);
    return *this;
}

void AppendFile::write(std::string_view bytes) {
    while (!bytes.empty()) {
        const auto written = ::write(descriptor_, bytes.data(), bytes.size());
        if (written < 0) {
            if (errno == EINTR) continue;
            fail("write to");
        }
        size_ += written;
        bytes.remove_prefix(static_cast<std::size_t>(written));
    }
}

void AppendFile::sync() {
    if (::fsync(descriptor_) != 0) fail("sync");
}

void AppendFile::fail(std::string_view what) const {
    throw std::system_error(errno, std::generic_category(),
                            fmt::format("cannot {} '{}'", what, path_.string()));
}

}  // namespace cale
