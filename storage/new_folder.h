// Folders that are made for a run.
#pragma once

#include <filesystem>

namespace cale {

/// A folder, and those above it that were not there. When this goes, those that it made go too, but for those
/// that have something in them by then.
class NewFolder {
  public:
    /// Throws std::filesystem::filesystem_error where it cannot be made. It may exist.
    explicit NewFolder(std::filesystem::path path);
    /// Makes `path`, or where that exists `path`_2, `path`_3, ...: nobody else gets the same.
    static NewFolder with_a_free_name(const std::filesystem::path& path);
    ~NewFolder();
    NewFolder(NewFolder&& other) noexcept;
    NewFolder& operator=(NewFolder&&) = delete;

    const std::filesystem::path& path() const { return path_; }

  private:
    NewFolder(std::filesystem::path path, std::filesystem::path topmost);

    std::filesystem::path path_;
    std::filesystem::path topmost_;  // of those that were made; empty: none
};

}  // namespace cale
