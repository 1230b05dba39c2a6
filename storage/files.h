// Reading whole files, and writing them atomically.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace cale {

/// How many bytes are read from a file without a size, such as a pipe, and how long to wait for more.
struct StreamLimits {
    std::size_t bytes = 1 << 20;
    std::chrono::milliseconds silence = std::chrono::seconds(10);
};

/// Returns the contents of a file. A file that is not regular, such as a shell's <(command), is read to its
/// end within `limits`. Throws std::system_error (a std::runtime_error) whose text names the file and the
/// operating system's reason, and std::runtime_error if the limits are exceeded, or a pipe yields nothing.
std::string read_file(const std::filesystem::path& path, const StreamLimits& limits = {});

/// Replaces the file `path` by `bytes` atomically: even after a crash or a power cut it holds the old
/// contents or all of the new ones. They are written and synced under a temporary name in the same folder and
/// then renamed: the file's owner and permissions become those of a new one. Where `path` is a link, that is
/// done to what it points to. Throws std::runtime_error where it is a device or a pipe, and std::system_error
/// that names the file and the reason (disk full, ...); the temporary file is then removed and the old file
/// unchanged, unless it is the renaming that could not be synced.
void write_file_atomically(const std::filesystem::path& path, std::string_view bytes);

/// The same for contents in several pieces.
void write_file_atomically(const std::filesystem::path& path, std::span<const std::string_view> pieces);

/// Returns the path in its normal form, and without a slash at its end.
std::filesystem::path without_slash(const std::filesystem::path& path);

/// Syncs the folder of `path`: until then a rename can be lost in a power cut. Throws std::system_error.
void sync_name(const std::filesystem::path& path);

}  // namespace cale
