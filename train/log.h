// The two tables of a run: episodes.csv, a row per finished episode, and
// progress.csv, a row per report.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "storage/append_file.h"

namespace cale {

/// The run's description in the first line of episodes.csv.
struct EpisodeLogHeader {
    std::string env_id{};  // "ALE/Pong-v5"
    std::string agent{};   // "sac"
    std::uint64_t seed = 0;
    std::vector<std::string> games{};  // that the environments play in turn; empty: one
};

/// Returns the game that environment `env` plays of several.
const std::string& game_of(const std::vector<std::string>& games, std::int64_t env);

/// An episode that ended: a row of episodes.csv.
struct Episode {
    double episode_return = 0;     // sum of rewards, undiscounted, neither clipped nor scaled
    std::int64_t length = 0;       // agent steps
    std::int64_t global_step = 0;  // agent steps of the run, all environments together, when it ended
    std::int64_t frame = 0;        // emulated frames of the run, all environments together, at that time
    std::int64_t env = 0;          // which environment
    bool truncated = false;        // cut off by the frame limit rather than over
};

/// episodes.csv, in the manner of Stable-Baselines3's Monitor files: a comment line of
/// JSON, then the columns r,l,t,global_step,frame,seed,env,truncated and, of a run of several games, game.
///
/// The same seed gives the same bytes. So `t` is not the wall clock but the game's: the
/// seconds that `frame` frames last on a console (60 a second), and `t_start` is 0. The
/// wall clock is in progress.csv.
class EpisodeLog {
  public:
    /// `offset`: where to continue after a resume (see offset()); what follows it is cut off.
    /// Throws CutFile, and leaves the file as it is, where what it holds is not what was written.
    /// Throws std::runtime_error, here and below, when the disk is full or the file unwritable.
    EpisodeLog(const std::filesystem::path& path, const EpisodeLogHeader& run,
               std::optional<std::int64_t> offset = std::nullopt);

    void write(const Episode& episode);
    /// The offset in bytes that a checkpoint records. sync() must be called before the checkpoint is
    /// complete.
    std::int64_t offset() const { return file_.size(); }
    void sync() { file_.sync(); }

  private:
    AppendFile file_;
    std::uint64_t seed_;
    std::vector<std::string> games_;
};

/// What progress.csv says at one moment of training.
struct Report {
    std::int64_t global_step = 0;
    std::int64_t frame = 0;
    double seconds = 0;                       // since the run began, without the time between sessions
    double steps_per_second = 0;              // agent steps, since the report before
    std::map<std::string, double> scalars{};  // "losses/qf_loss" -> value
};

/// progress.csv: global_step,frame,seconds,steps_per_second, then every scalar that any
/// report has named so far. A name that a report lacks leaves its cell empty; a name seen
/// for the first time adds a column, for which the file is rewritten (atomically).
class ProgressLog {
  public:
    /// `rows`: how many rows to keep after a resume (see rows()). Throws as EpisodeLog does.
    explicit ProgressLog(const std::filesystem::path& path, std::optional<std::int64_t> rows = std::nullopt);
    /// Throws CutFile where the file lacks some of its first `rows` rows.
    static void require(const std::filesystem::path& path, std::int64_t rows);
    /// Returns `rows`, or one more where the next row is of this agent step.
    static std::int64_t rows_to(const std::filesystem::path& path, std::int64_t rows, std::int64_t step);

    void write(const Report& report);
    /// The number of rows that a checkpoint records. Not an offset, because columns may be added.
    std::int64_t rows() const { return rows_; }
    /// The agent step of the last row; 0 where there is none.
    std::int64_t last_step() const { return last_step_; }
    void sync() { file_.sync(); }

  private:
    void add_columns(const std::vector<std::string>& unseen);

    AppendFile file_;
    std::vector<std::string> names_;  // of the scalars' columns
    std::int64_t rows_ = 0;
    std::int64_t last_step_ = 0;
};

/// The columns of a progress.csv by name; a cell that is empty is not a number.
/// Throws std::runtime_error, naming the file, where it cannot be read or a cell is something else.
std::map<std::string, std::vector<double>> read_progress(const std::filesystem::path& path);

}  // namespace cale
