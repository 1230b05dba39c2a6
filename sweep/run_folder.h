// What a run's folder says about where the run stands. Nothing else is asked: a sweep that was killed, or
// a machine that was switched off, leaves all that the next sweep needs to know.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace cale {

/// waiting: nothing done that counts. interrupted: it has a checkpoint to go on from. running: a living
/// process is at work in the folder. refused: what is there is another run (see refusal()).
enum class RunPhase { waiting, interrupted, running, finished, failed, refused };
std::string_view name_of(RunPhase state);

struct RunStatus {
    RunPhase state = RunPhase::waiting;
    std::int64_t step = 0;                // agent steps, as its newest report or checkpoint says
    double steps_per_second = 0;          // of its newest report
    std::optional<double> mean_return{};  // of its newest 100 episodes, at its newest report
    std::string message{};                // why it failed or is refused
};

/// Whether the run has nothing left to do: its newest checkpoint has `total_steps` and, where it `evaluates`,
/// the evaluation at its end is written.
bool is_finished(const std::filesystem::path& folder, std::int64_t total_steps, bool evaluates);

/// The status of the run in `folder`, which need not exist, whatever its settings.
RunStatus status_of(const std::filesystem::path& folder, std::int64_t total_steps, bool evaluates);

/// Agent steps of the newest checkpoint; none where there is no checkpoint.
std::optional<std::int64_t> newest_checkpoint(const std::filesystem::path& folder);

/// Makes the folder, or empties one whose run came to no checkpoint, for the program to start in. What the
/// run wrote to its terminal (output.log) stays.
void prepare_for_start(const std::filesystem::path& folder);

/// Remembers in the folder that the run was given up, with the reason; forgotten by forget_failure().
void remember_failure(const std::filesystem::path& folder, std::string_view reason);
void forget_failure(const std::filesystem::path& folder);

/// Where the run's terminal output goes: output.log.
std::filesystem::path output_file(const std::filesystem::path& folder);

/// The last line that the run wrote to its terminal; empty where there is none.
std::string last_words(const std::filesystem::path& folder);

/// The right to run what is in a folder. A process that inherits the descriptor holds it for as long as it
/// lives, whatever becomes of the one that took it; the operating system takes it back. It is beside the lock
/// of the training programs (storage/run_lock.h), which they take only once they are up.
class RunClaim {
  public:
    /// None where a living process has it, or trains in the folder. `folder` must exist.
    /// Throws std::system_error.
    static std::optional<RunClaim> take(const std::filesystem::path& folder);
    /// Whether take() would find another there.
    static bool is_taken(const std::filesystem::path& folder);

    RunClaim(RunClaim&& other) noexcept;
    RunClaim& operator=(RunClaim&&) = delete;
    ~RunClaim();

  private:
    explicit RunClaim(int descriptor) : descriptor_(descriptor) {}
    int descriptor_;  // a child inherits it
};

}  // namespace cale
