// A new folder for results.
#pragma once

#include <filesystem>
#include <vector>

namespace cale {

/// Creates a folder and its missing parents. The destructor removes those that it created and that are still
/// empty.
class NewFolder {
  public:
    /// Throws std::filesystem::filesystem_error if it cannot be created. It may exist.
    explicit NewFolder(const std::filesystem::path& path);
    /// Creates `path`, or if there is such a folder `path`_2, `path`_3, ...: no other process gets the same
    /// one. Must have no slash at its end. Throws std::filesystem::filesystem_error.
    static NewFolder with_a_free_name(const std::filesystem::path& path);
    ~NewFolder();
    NewFolder(NewFolder&& other) noexcept;
    NewFolder& operator=(NewFolder&&) = delete;

    const std::filesystem::path& path() const { return path_; }

  private:
    NewFolder(std::filesystem::path path, std::vector<std::filesystem::path> created);

    std::filesystem::path path_;
    std::vector<std::filesystem::path> created_;  // from the top
};

}  // namespace cale
