// Checkpoints written in the background.
#pragma once

#include <filesystem>
#include <future>
#include <optional>

#include "train/checkpoint.h"

namespace cale {

/// Writes the checkpoints of a run on a background thread, one at a time. The training thread only makes the
/// snapshot; its results do not depend on the duration of the write.
class CheckpointWriter {
  public:
    /// `resumed`: the checkpoint that the run is resumed from.
    CheckpointWriter(std::filesystem::path run_dir, Retention retention,
                     std::optional<StoredCheckpoint> resumed);

    /// Waits for the previous checkpoint, then starts writing. Throws what finish() throws.
    void start(RunSnapshot snapshot);
    /// Throws the error of the checkpoint being written, if it failed: std::runtime_error, naming the file.
    void check();
    /// Returns when the newest checkpoint is on disk. Throws as check() does.
    void finish();

  private:
    void write(RunSnapshot snapshot);

    std::filesystem::path run_dir_;
    Retention retention_;
    std::optional<StoredCheckpoint> last_, before_last_;
    std::future<void> under_way_;  // last member: its destructor waits before the others run
};

}  // namespace cale
