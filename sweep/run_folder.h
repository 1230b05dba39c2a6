// The status of a run, read from its folder alone: after a sweep was killed, or a machine switched off, the
// next sweep needs nothing else.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "storage/descriptor.h"

namespace cale {

/// waiting: no checkpoint yet. interrupted: it has a checkpoint to resume from. running: a living process is
/// working in the folder. refused: the folder holds another run (see config_mismatch()).
enum class RunPhase { waiting, interrupted, running, finished, failed, refused };
std::span<const std::string_view> names_of(RunPhase);

/// Where a run ends.
struct RunEnd {
    std::int64_t total_steps = 0;  // agent steps
    bool evaluates = true;         // whether an evaluation follows them
};

/// How far a run is.
struct RunStatus {
    RunPhase state = RunPhase::waiting;
    std::int64_t step = 0;                // agent steps, as its newest row or checkpoint says
    double steps_per_second = 0;          // of its newest row
    std::optional<double> mean_return{};  // of its newest 100 episodes, at its newest row
    std::string message{};                // why it failed or is refused
};

/// Returns whether the run's newest checkpoint has all steps and, where an evaluation follows them, that is
/// written and metadata.json does not say that the run is unfinished. One that pauses at `end` is finished,
/// too.
bool is_finished(const std::filesystem::path& folder, const RunEnd& end);

/// The status of the run in `folder`, which need not exist, whatever its settings.
RunStatus status_of(const std::filesystem::path& folder, const RunEnd& end);

/// Returns the name of something in the folder that no run has before its first checkpoint, or empty: a user
/// put it there, or it is a result.
std::string strange_file(const std::filesystem::path& folder);

/// Makes the folder, or empties one whose run came to no checkpoint, for the program to start in. What the
/// run wrote to its terminal (output.log) and the locks stay.
void prepare_for_start(const std::filesystem::path& folder);

/// Records in the folder that the run was given up, with the reason; forget_failure() removes the record.
void remember_failure(const std::filesystem::path& folder, std::string_view reason);
void forget_failure(const std::filesystem::path& folder);

/// Where the run's terminal output goes: output.log.
std::filesystem::path output_file(const std::filesystem::path& folder);

/// How many bytes have gone there; 0 where it is not there.
std::int64_t log_size(const std::filesystem::path& folder);

/// The last line that the run wrote to its terminal behind the first `from` bytes; empty where there is none.
std::string last_log_line(const std::filesystem::path& folder, std::int64_t from = 0);

/// A lock on starting the run of a folder. A process that inherits the descriptor holds the lock for as long
/// as it lives, even if the process that took it ends; the operating system then releases it. No effect on
/// file systems without locks. It is beside the lock of the training programs (storage/run_lock.h), which
/// they take only after their start-up.
class RunClaim {
  public:
    /// Returns none if a living process holds it, or trains in the folder. `folder` must exist. Throws
    /// std::system_error.
    static std::optional<RunClaim> take(const std::filesystem::path& folder);
    /// Returns whether take() would find another process there.
    static bool is_taken(const std::filesystem::path& folder);

  private:
    explicit RunClaim(Descriptor file) : file_(std::move(file)) {}
    Descriptor file_;  // a child inherits it
};

}  // namespace cale
