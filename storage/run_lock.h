// One process per run.
#pragma once

#include <filesystem>
#include <stdexcept>

#include "storage/descriptor.h"

namespace cale {

/// Another process has locked the folder.
struct FolderTaken : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Locks the run's folder against other processes while it exists: a system lock (flock) on its file `.lock`,
/// released when the process ends for any reason. No effect on file systems without locks.
class RunLock {
  public:
    /// Throws FolderTaken, naming the folder and, where it is known, the process that trains in it, or
    /// std::system_error, why the file cannot be written.
    explicit RunLock(const std::filesystem::path& run_dir);

    /// Returns whether a living process has locked the folder.
    static bool is_taken(const std::filesystem::path& run_dir);

  private:
    Descriptor file_;
};

}  // namespace cale
