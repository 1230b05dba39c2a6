#include "storage/files.h"

#include <array>
#include <cerrno>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <system_error>

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include "storage/descriptor.h"

namespace cale {
namespace {

[[noreturn]] void fail(const char* verb, const std::filesystem::path& path, int error = errno) {
    throw std::system_error(error, std::generic_category(),
                            std::string("cannot ") + verb + " '" + path.string() + "'");
}

/// A file under a temporary name beside `target`, removed unless it was published.
class TemporaryFile {
  public:
    explicit TemporaryFile(const std::filesystem::path& target) : file_(create(target)) {}
    TemporaryFile(const TemporaryFile&) = delete;
    TemporaryFile& operator=(const TemporaryFile&) = delete;
    ~TemporaryFile() {
        if (!published_) ::unlink(name_.c_str());
    }

    bool write(std::string_view bytes) { return write_all(file_, bytes); }

    bool publish(const std::filesystem::path& target) {
        if (::fsync(file_.get()) != 0 || file_.close() != 0) return false;
        published_ = ::rename(name_.c_str(), target.c_str()) == 0;
        return published_;
    }

  private:
    int create(const std::filesystem::path& target) {
        for (int attempt = 0;; ++attempt) {
            name_ = target.string() + ".tmp-" + std::to_string(::getpid()) + "-" + std::to_string(attempt);
            const int fd = ::open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
            if (fd >= 0) return fd;
            if (errno != EEXIST) fail("write", target);
        }
    }

    std::string name_;
    Descriptor file_;
    bool published_ = false;
};

std::string read_stream(const Descriptor& file, const std::filesystem::path& path, const struct stat& status,
                        const StreamLimits& limits) {
    const auto refuse = [&](const std::string& why) {
        throw std::runtime_error("cannot read '" + path.string() + "': it is no regular file, and " + why);
    };
    const bool is_pipe = S_ISFIFO(status.st_mode);
    std::string bytes;
    std::array<char, 4096> block{};
    while (true) {
        const ssize_t count = ::read(file.get(), block.data(), block.size());
        if (count < 0 && errno == EINTR) continue;
        if (count < 0 && errno != EAGAIN) fail("read", path);
        if (count > 0) {
            bytes.append(block.data(), static_cast<std::size_t>(count));
            if (bytes.size() > limits.bytes)
                refuse("more comes out of it than " + std::to_string(limits.bytes) + " bytes");
            continue;
        }
        // A pipe that holds nothing may yet get a writer; without one it looks as at its end.
        if (count == 0 && (!is_pipe || !bytes.empty())) return bytes;
        pollfd waiting{.fd = file.get(), .events = POLLIN, .revents = 0};
        const int answer = ::poll(&waiting, 1, static_cast<int>(limits.silence.count()));
        if (answer < 0 && errno != EINTR) fail("read", path);
        if (answer == 0) refuse("nothing came out of it in time");
        if (answer > 0 && count == 0 && (waiting.revents & POLLIN) == 0) refuse("nothing came out of it");
    }
}

}  // namespace

std::filesystem::path without_slash(const std::filesystem::path& path) {
    const auto normal = path.lexically_normal();
    return normal.has_filename() ? normal : normal.parent_path();
}

void sync_name(const std::filesystem::path& path) {
    const auto parent = path.parent_path();
    const Descriptor folder(
        ::open(parent.empty() ? "." : parent.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (!folder.is_open()) fail("write", path);
    // Some file systems cannot sync a folder, and say EINVAL.
    if (::fsync(folder.get()) != 0 && errno != EINVAL) fail("write", path);
}

std::string read_file(const std::filesystem::path& path, const StreamLimits& limits) {
    // Without O_NONBLOCK, opening a FIFO without a writer would block here.
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    struct stat status {};
    if (!file.is_open() || ::fstat(file.get(), &status) != 0) fail("read", path);
    if (S_ISDIR(status.st_mode)) fail("read", path, EISDIR);
    if (!S_ISREG(status.st_mode)) return read_stream(file, path, status, limits);
    std::string bytes;
    bytes.resize(static_cast<std::size_t>(status.st_size));
    std::size_t size = 0;
    // The size is a hint only: the file may grow or shrink meanwhile.
    while (true) {
        if (size == bytes.size()) bytes.resize(size + 4096);
        const ssize_t count = ::read(file.get(), bytes.data() + size, bytes.size() - size);
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) fail("read", path);
        if (count == 0) break;
        size += static_cast<std::size_t>(count);
    }
    bytes.resize(size);
    return bytes;
}

void write_file_atomically(const std::filesystem::path& path, std::string_view bytes) {
    write_file_atomically(path, std::span(&bytes, 1));
}

namespace {

/// Where the links lead, which may be to nothing yet.
std::filesystem::path target_of(std::filesystem::path path) {
    constexpr int kMostLinks = 40;  // as Linux has it; a circle is replaced
    std::error_code ignored;
    for (int i = 0; i < kMostLinks && std::filesystem::is_symlink(path, ignored); ++i)
        path = path.parent_path() / std::filesystem::read_symlink(path);
    return path;
}

}  // namespace

void write_file_atomically(const std::filesystem::path& path, std::span<const std::string_view> pieces) {
    namespace fs = std::filesystem;
    std::error_code ignored;
    // What a link points to is written, not the link replaced; a device is not replaced either.
    const auto target = target_of(path);
    if (fs::exists(target, ignored) && !fs::is_regular_file(target, ignored) &&
        !fs::is_directory(target, ignored))
        throw std::runtime_error("cannot write '" + path.string() + "': it is no regular file");
    {
        TemporaryFile file(target);
        for (const auto piece : pieces) {
            if (!file.write(piece)) fail("write", path);
        }
        if (!file.publish(target)) fail("write", path);
    }
    sync_name(target);
}

}  // namespace cale
