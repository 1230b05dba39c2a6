// One process per run.
#pragma once

#include <filesystem>

namespace cale {

/// Locks the run's folder against other processes while it exists: a system lock (flock) on its file `.lock`,
/// released when the process ends for any reason. No effect on file systems without locks.
class RunLock {
  public:
    /// Throws std::runtime_error, naming the folder and the process that trains in it, or why the file cannot
    /// be written.
    explicit RunLock(const std::filesystem::path& run_dir);
    ~RunLock();
    RunLock(const RunLock&) = delete;
    RunLock& operator=(const RunLock&) = delete;

    /// Returns whether a living process has locked the folder.
    static bool is_taken(const std::filesystem::path& run_dir);

  private:
    int descriptor_;
};

}  // namespace cale
