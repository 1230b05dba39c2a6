// Files that are either whole or not there.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace cale {

/// How much is read of what has no size, such as a pipe, and how long is waited for its next bytes.
struct StreamLimits {
    std::size_t bytes = 1 << 20;
    std::chrono::milliseconds silence = std::chrono::seconds(10);
};

/// The contents of a file. What is no regular file, such as a shell's <(command), is read to its end within
/// `limits`. Throws std::system_error (a std::runtime_error) whose text names the file and the operating
/// system's reason, and std::runtime_error where the limits are reached, or nothing comes out of a pipe.
std::string read_file(const std::filesystem::path& path, const StreamLimits& limits = {});

/// Puts `bytes` in the place of `path`: whoever opens it, even after a crash or a power
/// cut, finds the old contents or all of the new ones. They are written and synced under
/// a temporary name in the same folder and then renamed.
/// Throws std::system_error that names `path` and the reason (disk full, ...), having
/// removed the temporary file and left the old one as it was.
void write_file_atomically(const std::filesystem::path& path, std::string_view bytes);

/// The same for contents that lie in several places.
void write_file_atomically(const std::filesystem::path& path, std::span<const std::string_view> pieces);

/// Returns when the disk knows `path` by its present name (a rename is lost in a power cut until
/// its folder is synced). Throws std::system_error.
void sync_name(const std::filesystem::path& path);

}  // namespace cale
