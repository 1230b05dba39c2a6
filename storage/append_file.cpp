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
    file_ = Descriptor(::open(path_.c_str(), O_RDWR | O_APPEND | O_CLOEXEC | mode, 0666));
    if (!file_.is_open() && keep && errno == ENOENT) {
        throw CutFile(
            fmt::format("{} is missing, which had {} bytes when the checkpoint was written: restore it, or "
                        "start a new run",
                        path_.string(), *keep));
    }
    if (!file_.is_open()) fail("open");
    struct stat status {};
    if (::fstat(file_.get(), &status) != 0) fail("read the size of");
    if (S_ISFIFO(status.st_mode))
        throw std::runtime_error(fmt::format("{} is a pipe; remove it", path_.string()));
    if (!keep) return;
    if (status.st_size < *keep) {
        throw CutFile(
            fmt::format("{} has {} bytes, but {} when the checkpoint was written: it was cut or replaced "
                        "since; restore it, or start a new run",
                        path_.string(), status.st_size, *keep));
    }
    if (::ftruncate(file_.get(), *keep) != 0) fail("cut back");
    size_ = *keep;
}

void AppendFile::write(std::string_view bytes) {
    if (!write_all(file_, bytes)) fail("write to");
    size_ += static_cast<std::int64_t>(bytes.size());
}

void AppendFile::sync() {
    if (::fsync(file_.get()) != 0) fail("sync");
}

void AppendFile::fail(std::string_view what) const {
    throw std::system_error(errno, std::generic_category(),
                            fmt::format("cannot {} '{}'", what, path_.string()));
}

}  // namespace cale
