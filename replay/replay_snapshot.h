// A replay on disk: a folder of files, most of which never change again
//
//     replay.zst                                     configuration, counters, unfinished windows, priorities
//     frames-000012.zst, ..., frames-open.zst        frames, each with the action chosen on it
//     transitions-000012.zst, ..., transitions-open.zst
//
// Frames and transitions are cut into chunks by their numbers, so that a full chunk has the same content in
// every later snapshot: it is written once. The newest, which is not full, is "open".
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "replay/frame_ring.h"
#include "replay/replay_buffer.h"

namespace cale {

/// The contents of a replay at one moment, for another thread to write while the replay remains in use. Only
/// the ReplayState is copied. The replay blocks before overwriting a frame or transition that has not been
/// written yet; because save() writes the oldest first, the wait is short.
class ReplaySnapshot {
  public:
    /// Puts the file of this name, as an earlier snapshot of the same replay wrote it, into the folder.
    /// Returns false where there is none: it is then written. Called for full chunks only.
    using TakeOver = std::function<bool(const std::string& file)>;

    /// Captures the current contents. The replay must outlive it. Throws std::logic_error while another
    /// snapshot still reads the replay.
    explicit ReplaySnapshot(Replay& replay);

    /// Writes the files into the folder, which must exist. Must be called at most once. Throws
    /// std::runtime_error, naming the file.
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

/// Replaces the contents of the replay by the saved ones; it then continues exactly from there. The old
/// contents stay in memory until the files have been verified. Throws std::runtime_error, naming the file,
/// and leaves the replay unchanged, for files that are missing, damaged, truncated, of another version or of
/// another configuration. Throws std::logic_error while a snapshot of the replay is being read.
void load_replay(Replay& replay, const std::filesystem::path& folder);

}  // namespace cale
