// One process per run.
#pragma once

#include <filesystem>

namespace cale {

/// While it lives, no other process can lock the run's folder: the system's lock (flock) on the file `.lock`
/// in it, which goes with the process however that ends. Where a file system has no locks there is none.
class RunLock {
  public:
    /// Throws std::runtime_error, naming the folder and the process that trains in it, or why the file cannot
    /// be written.
    explicit RunLock(const std::filesystem::path& run_dir);
    ~RunLock();
    RunLock(const RunLock&) = delete;
    RunLock& operator=(const RunLock&) = delete;

    /// Whether a process that lives has locked the folder.
    static bool is_taken(const std::filesystem::path& run_dir);

  private:
    int descriptor_;
};

}  // namespace cale
