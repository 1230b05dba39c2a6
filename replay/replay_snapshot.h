// A replay on the disk: a folder of files, most of which never change again
//
//     replay.zst                                     configuration, counters, unfinished windows, priorities
//     frames-000012.zst, ..., frames-open.zst        frames, each with the action chosen on it
//     transitions-000012.zst, ..., transitions-open.zst
//
// Frames and transitions are cut into chunks by their numbers, so that a full chunk has the same content in
// every later snapshot: it is written once. The newest, which is not full, is "open".
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "replay/replay_storage.h"

namespace cale {

/// The largest priority: what float32 can say. The sum of as many as there may be is far from overflowing.
inline constexpr double kMaxPriority = std::numeric_limits<float>::max();

/// What of a replay is neither frame nor transition.
struct ReplayState {
    FrameId frames_end = 0;
    std::int64_t transitions_begin = 0;
    std::int64_t transitions_end = 0;
    std::vector<std::vector<StoredStep>> windows{};  // the unfinished one of each environment
    std::vector<double> priorities{};                // of each slot, if prioritised
    double largest_priority = 1;
};

/// What a replay held at one moment, for another thread to write while the replay goes on. Nothing but the
/// ReplayState is copied. The replay waits where it would overwrite a frame or transition that is yet to be
/// written; as save() goes from the oldest to the newest, the wait is short.
class ReplaySnapshot {
  public:
    /// Whether the file of this name, which an earlier snapshot of the same replay wrote, is in the folder
    /// now and need not be written again. Asked for full chunks only.
    using TakeOver = std::function<bool(const std::string& file)>;

    /// Throws std::logic_error while there is another snapshot of the storage, which must outlive this one.
    ReplaySnapshot(const ReplayConfig& config, ReplayStorage& storage, ReplayState state);

    /// Writes the files into the folder, which exists; once only. Throws std::runtime_error, naming the file.
    void save(const std::filesystem::path& folder, const TakeOver& take_over = {});

  private:
    struct LetGo {
        void operator()(ReplayStorage* storage) const;
    };
    ReplayConfig config_;
    ReplayState state_;
    FrameId frames_begin_;
    std::unique_ptr<ReplayStorage, LetGo> storage_;
};

/// Reads what save() wrote into an empty storage, and returns the rest. Nothing is allocated for what a file
/// claims. Throws std::runtime_error, naming the file: missing, damaged, of another version or configuration.
ReplayState load_replay(const std::filesystem::path& folder, const ReplayConfig& config,
                        ReplayStorage& storage);

}  // namespace cale
