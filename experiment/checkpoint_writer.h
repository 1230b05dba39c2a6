// Checkpoints written beside the training.
#pragma once

#include <cstdint>
#include <filesystem>
#include <future>
#include <optional>

#include "experiment/checkpoint.h"

namespace cale {

/// Writes the checkpoints of a run on a thread of its own, one at a time. The thread that trains pays for the
/// snapshot; its results do not depend on how long the writing takes.
class CheckpointWriter {
  public:
    /// `keep`: how many checkpoints stay. `resumed`: the one that the run goes on from.
    CheckpointWriter(std::filesystem::path run_dir, std::int64_t keep,
                     std::optional<StoredCheckpoint> resumed);

    /// Begins to write, once the one before is written. Throws what finish() throws.
    void start(RunSnapshot snapshot);
    /// Throws what stopped the one under way, if it has been stopped: std::runtime_error, naming the file.
    void check();
    /// Returns when the disk has the newest. Throws as check() does.
    void finish();

  private:
    void write(RunSnapshot snapshot);

    std::filesystem::path run_dir_;
    std::int64_t keep_;
    std::optional<StoredCheckpoint> last_, before_last_;
    std::future<void> under_way_;  // last: it is waited for before the rest is destroyed
};

}  // namespace cale
