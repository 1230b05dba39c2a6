// An append-only file with checked writes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string_view>

#include "storage/descriptor.h"

namespace cale {

/// A file does not hold what it held when a checkpoint was written. Programs leave with exit code 3.
struct CutFile : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Every write reaches the operating system before it returns, so that a killed run loses nothing and `tail
/// -f` shows the newest line. Errors (no such folder, no permission, disk full) throw std::system_error with
/// the file and the system's reason; a pipe std::runtime_error.
class AppendFile {
  public:
    /// An empty file; or, with `keep`, an existing one cut back to its first `keep` bytes.
    /// Throws CutFile if it has fewer, or is missing.
    explicit AppendFile(std::filesystem::path path, std::optional<std::int64_t> keep = std::nullopt);

    void write(std::string_view bytes);
    /// Returns when all that was written is on disk; of a new file not its name, see sync_name().
    void sync();
    /// Bytes in the file, without those of a write that failed.
    std::int64_t size() const { return size_; }
    const std::filesystem::path& path() const { return path_; }

  private:
    [[noreturn]] void fail(std::string_view what) const;

    std::filesystem::path path_;
    Descriptor file_{-1};
    std::int64_t size_ = 0;
};

}  // namespace cale
