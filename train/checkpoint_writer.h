// Checkpoints written beside the training.
#pragma once

#include <filesystem>
#include <future>
#include <optional>

#include "train/checkpoint.h"

namespace cale {

/// Writes the checkpoints of a run on a thread of its own, one at a time. The thread that trains pays for the
/// snapshot; its results do not depend on how long the writing takes.
class CheckpointWriter {
  public:
    /// `resumed`: the checkpoint that the run is resumed from.
    CheckpointWriter(std::filesystem::path run_dir, Retention retention,
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
    Retention retention_;
    std::optional<StoredCheckpoint> last_, before_last_;
    std::future<void> under_way_;  // last: it is waited for before the rest is destroyed
};

}  // namespace cale
