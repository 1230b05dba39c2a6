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
#include <memory>
#include <string>

#include "replay/frame_ring.h"
#include "replay/replay_buffer.h"

namespace cale {

/// What a replay held at one moment, for another thread to write while the replay goes on. Nothing but the
/// ReplayState is copied. The replay waits where it would overwrite a frame or transition that is yet to be
/// written; as save() goes from the oldest to the newest, the wait is short.
class ReplaySnapshot {
  public:
    /// Whether the file of this name, which an earlier snapshot of the same replay wrote, is in the folder
    /// now and need not be written again. Asked for full chunks only.
    using TakeOver = std::function<bool(const std::string& file)>;

    /// Of what is stored now. The replay must outlive it. Throws std::logic_error while there is another.
    explicit ReplaySnapshot(Replay& replay);

    /// Writes the files into the folder, which exists; once only. Throws std::runtime_error, naming the file.
    void save(const std::filesystem::path& folder, const TakeOver& take_over = {});

  private:
    struct Release {
        void operator()(FrameRing* ring) const;
    };
    ReplayConfig config_;
    ReplayState state_;
    FrameId frames_begin_;
    std::unique_ptr<FrameRing, Release> ring_;
};

/// Writes everything that is stored: the transitions, the counters, the unfinished windows and the
/// priorities. Throws std::runtime_error, naming the file.
void save_replay(Replay& replay, const std::filesystem::path& folder);

/// Makes the contents of the replay those that were saved, so that it resumes exactly there. What it held is
/// in memory until the files proved good. Throws std::runtime_error, naming the file, and leaves the replay
/// as it was: for files that are missing, damaged, truncated, of another version or of another configuration.
/// Throws std::logic_error while a snapshot of the replay is read.
void load_replay(Replay& replay, const std::filesystem::path& folder);

}  // namespace cale
