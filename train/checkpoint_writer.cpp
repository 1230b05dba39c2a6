#include "train/checkpoint_writer.h"

#include <chrono>
#include <utility>

#include "storage/step_name.h"

namespace cale {

CheckpointWriter::CheckpointWriter(std::filesystem::path run_dir, Retention retention,
                                   std::optional<StoredCheckpoint> resumed)
    : run_dir_(std::move(run_dir)), retention_(retention), last_(std::move(resumed)) {}

void CheckpointWriter::start(RunSnapshot snapshot) {
    finish();
    under_way_ = std::async(
        std::launch::async, [this](RunSnapshot taken) { write(std::move(taken)); }, std::move(snapshot));
}

void CheckpointWriter::check() {
    if (under_way_.valid() && under_way_.wait_for(std::chrono::seconds(0)) == std::future_status::ready)
        under_way_.get();
}

void CheckpointWriter::finish() {
    if (under_way_.valid()) under_way_.get();
}

void CheckpointWriter::write(RunSnapshot snapshot) {
    // Of the same step once more the files are linked, and those of the checkpoint before are its own.
    const bool again = last_ && step_in(last_->folder) == snapshot.state.step;
    const auto& copied = again ? before_last_ : last_;
    const auto& linked = again ? last_ : before_last_;
    auto written = write_checkpoint(run_dir_, std::move(snapshot), copied ? &*copied : nullptr,
                                    linked ? &*linked : nullptr);
    if (!again) before_last_ = std::move(last_);
    last_ = std::move(written);
    delete_other_checkpoints(run_dir_, last_->folder, retention_);
}

}  // namespace cale
