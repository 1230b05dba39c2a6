#include "sweep/local_runner.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <deque>
#include <exception>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <sys/types.h>

#include "cale/fields.h"
#include "cale/text.h"
#include "storage/run_lock.h"
#include "sweep/child.h"
#include "sweep/config_mismatch.h"
#include "sweep/run_folder.h"
#include "sweep/sweep_console.h"
#include "terminal/console.h"
#include "terminal/exit_code.h"
#include "terminal/stop_signals.h"
#include "train/resume.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kPollInterval = std::chrono::milliseconds(100);
// Interrupts within this time of the first are one. Where runs were interrupted, too, SIGTERM must come to
// them within half a second, later than which it kills them (StopSignals).
constexpr auto kOneStop = std::chrono::milliseconds(100);
constexpr auto kWait = std::chrono::seconds(1);
constexpr auto kPause = std::chrono::seconds(10);

std::atomic<int> stops = 0;  // counted in a signal handler
std::atomic<int> interrupts = 0;
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler may not wait");

void count_signal(int number) {
    ++stops;
    if (number == SIGINT) ++interrupts;
}

/// A run, and what became of it so far.
struct Job {
    const PlannedRun* planned = nullptr;
    fs::path folder{};
    RunStatus status{};
    int failures = 0;             // in a row, without a newer checkpoint
    std::int64_t started_at = 0;  // agent step of the checkpoint that it was resumed from
    std::int64_t log_begin = 0;   // where its program began to write into output.log, in bytes
    Clock::time_point started{}, not_before{};
    pid_t process = 0;
    bool waits = false;  // for another process
    // How the settings that its program read differ from the planned ones; none: not known yet.
    std::optional<std::string> mismatch{};
    std::size_t slot = 0;
};

/// Its state as it is shown: a run that came to the step at which it was to pause is not finished.
std::string_view shown_state(const Job& job) {
    return job.status.state == RunPhase::finished && job.planned->until > 0 ? "paused"
                                                                            : name_of(job.status.state);
}

class LocalRunner {
  public:
    LocalRunner(std::span<const PlannedRun> runs, const fs::path& folder, const Slots& slots,
                const LocalOptions& options)
        : slots_(slots.slots), options_(options), console_(options.out, options.live_table) {
        for (std::size_t slot = slots_.size(); slot > 0; --slot) free_slots_.push_back(slot - 1);
        jobs_.resize(runs.size());
        for (std::size_t i = 0; i < runs.size(); ++i) {
            auto& job = jobs_[i];
            job.planned = &runs[i];
            job.folder = folder / runs[i].run.name;
            job.status = status_of(runs[i], job.folder);
            if (job.status.state != RunPhase::finished && job.status.state != RunPhase::refused)
                queue_.push_back(&job);
        }
    }

    int run() {
        stops = 0;
        interrupts = 0;
        const SignalHandler handler(count_signal);
        for (const auto& job : jobs_) {
            if (job.status.state == RunPhase::refused) say("REFUSED", job, job.status.message);
        }
        while (true) {
            reap();
            if (stops > 0) stop();
            if (stops == 0) start_waiting();
            if (active_.empty() && (stops > 0 || queue_.empty())) break;
            show();
            std::this_thread::sleep_for(kPollInterval);
        }
        console_.finish(rows());
        if (stops > 0) return kInterrupted;
        return count(RunPhase::failed) + count(RunPhase::refused) > 0 ? kFailed : kDone;
    }

  private:
    // ---- processes ----

    void start_waiting() {
        // A run that is locked stays in the queue, behind those that wait.
        for (auto tries = queue_.size(); tries > 0 && !free_slots_.empty() && stops == 0; --tries) {
            Job& job = *queue_.front();
            queue_.pop_front();
            if (Clock::now() < job.not_before) {
                queue_.push_back(&job);
                continue;
            }
            try {
                start(job);
            } catch (const fs::filesystem_error& error) {
                const bool in_the_way =
                    error.code() == std::errc::not_a_directory || error.code() == std::errc::file_exists;
                cannot_start(
                    job, fmt::format("cannot write '{}': {}", error.path1().string(), error.code().message()),
                    /*try_again=*/!in_the_way);
            } catch (const std::exception& error) {
                cannot_start(job, error.what(), /*try_again=*/true);
            }
        }
    }

    /// What keeps a run from starting may keep all from it for a moment, as a disk that refuses to write:
    /// without a pause they would be given up at once.
    void cannot_start(Job& job, const std::string& reason, bool try_again) {
        job.not_before = Clock::now() + kPause;
        retry_or_give_up(job, reason, try_again);
    }

    void start(Job& job) {
        const auto& planned = *job.planned;
        fs::create_directories(job.folder);
        auto claim = RunClaim::take(job.folder);
        std::optional<RunLock> lock;  // so that no program that is started by hand begins meanwhile
        try {
            if (claim) lock.emplace(job.folder);
        } catch (const FolderTaken&) {
            claim.reset();
        }
        if (!claim) {
            if (!std::exchange(job.waits, true))
                say("waits", job, "another process is training in its folder");
            job.status = status_of(job.folder, planned.end);
            job.not_before = Clock::now() + kWait;
            queue_.push_back(&job);
            return;
        }
        // Another sweep may have been at work while this one waited.
        if (const auto reason = config_mismatch(planned, job.folder); !reason.empty()) {
            return refuse(job, reason);
        }
        if (is_finished(job.folder, planned.end)) {
            job.status.state = RunPhase::finished;
            job.status.step = newest_checkpoint_step(job.folder).value_or(planned.end.total_steps);
            return say(shown_state(job), job, "by another process");
        }
        const auto saved_step = newest_checkpoint_step(job.folder);
        if (!saved_step) prepare_for_start(job.folder);
        forget_failure(job.folder);

        const auto slot = free_slots_.back();
        const RunPlace place{
            .folder = job.folder, .threads = options_.threads, .device = slots_[slot].device};
        job.log_begin = log_size(job.folder);
        lock.reset();  // the program takes it
        job.process = start_child(command_of(planned, place, saved_step.has_value()),
                                  {.output = output_file(job.folder), .cpus = slots_[slot].cpus});
        free_slots_.pop_back();
        // Of a run that is resumed they were compared above, and are by the program.
        job.mismatch = saved_step ? std::optional<std::string>("") : std::nullopt;
        job.slot = slot;
        job.started = Clock::now();
        job.started_at = saved_step.value_or(0);
        job.status = {.state = RunPhase::running, .step = job.started_at};
        active_.push_back(&job);
        say(saved_step ? "resumed" : "starts", job,
            saved_step ? fmt::format("from step {}", *saved_step) : "");
        // The child has the claim now; this process lets go of it.
    }

    void refuse(Job& job, const std::string& reason) {
        job.status.state = RunPhase::refused;
        job.status.message = reason;
        say("REFUSED", job, reason);
    }

    /// A program reads its configuration's files when it starts, hours after the sweep may have read them.
    /// Returns how the settings that it read differ from the planned ones; nothing where they do not, or are
    /// not known yet.
    static std::string mismatch_of(Job& job) {
        if (!job.mismatch) job.mismatch = started_otherwise(*job.planned, job.folder);
        return job.mismatch.value_or("");
    }

    void reap() {
        std::vector<std::pair<Job*, ChildEnd>> ended;
        for (Job* job : active_) {
            if (!mismatch_of(*job).empty()) ::kill(job->process, SIGKILL);  // it has only begun
            if (const auto end = poll_child(job->process)) ended.emplace_back(job, *end);
        }
        for (const auto& [job, end] : ended) {
            std::erase(active_, job);
            free_slots_.push_back(job->slot);
            record_end(*job, end);
        }
    }

    void record_end(Job& job, const ChildEnd& end) {
        job.status = status_of(job.folder, job.planned->end);
        if (const auto reason = mismatch_of(job); !reason.empty()) return refuse(job, reason);
        if (end.exit_code == kDone) {
            job.status.state = RunPhase::finished;
            const auto seconds = std::chrono::duration<double>(Clock::now() - job.started).count();
            auto text = fmt::format("in {}", duration_text(seconds));
            if (job.planned->until > 0) text = fmt::format("at step {} ", job.status.step) + text;
            if (job.status.mean_return) text += fmt::format(", return {:.1f}", *job.status.mean_return);
            return say(shown_state(job), job, text);
        }
        if (stops > 0) return say("stopped", job, fmt::format("at step {}", job.status.step));
        const auto last_line = last_log_line(job.folder, job.log_begin);
        const bool hopeless =
            end.exit_code == kUsage || end.exit_code == kCannotResume || end.exit_code == kDiverged;
        if (newest_checkpoint_step(job.folder).value_or(0) > job.started_at) job.failures = 0;
        retry_or_give_up(job,
                         text_of(end) + (end.exit_code >= 0 && !last_line.empty() ? ": " + last_line : ""),
                         !hopeless);
    }

    void retry_or_give_up(Job& job, const std::string& reason, bool try_again) {
        ++job.failures;
        if (try_again && job.failures <= options_.retries) {
            queue_.push_back(&job);
            return say("crashed", job,
                       fmt::format("{}; retrying ({} of {})", reason, job.failures, options_.retries));
        }
        job.status.state = RunPhase::failed;
        job.status.message = reason;
        say("FAILED", job, reason);
        try {
            remember_failure(job.folder, reason);
        } catch (const std::exception& error) {
            say("FAILED", job, error.what());  // a full disk, which the reason may have been
        }
    }

    /// All runs get SIGTERM once; a Ctrl-C after that kills them.
    void stop() {
        if (!stop_at_) stop_at_ = Clock::now() + kOneStop;
        if (Clock::now() < *stop_at_) return;
        if (!kill_at_) {
            kill_at_ = interrupts + 1;
            const bool one = active_.size() == 1;
            if (!active_.empty())
                console_.say(fmt::format("Stopping {}, which write{} a checkpoint first. Ctrl-C {}kills {}.",
                                         counted(active_.size(), "run"), one ? "s" : "",
                                         interrupts > 0 ? "again " : "", one ? "it" : "them"));
            for (const Job* job : active_) ::kill(job->process, SIGTERM);
        }
        if (interrupts >= *kill_at_ && !std::exchange(killed_, true)) {
            for (const Job* job : active_) ::kill(job->process, SIGKILL);
        }
    }

    // ---- what is shown ----

    std::vector<RunRow> rows() const {
        std::vector<RunRow> result;
        for (const auto& job : jobs_) {
            result.push_back({.name = job.planned->run.name,
                              .state = std::string(shown_state(job)),
                              .status = job.status,
                              .end = job.planned->end});
        }
        return result;
    }

    std::size_t count(RunPhase state) const {
        return static_cast<std::size_t>(
            std::ranges::count(jobs_, state, [](const Job& job) { return job.status.state; }));
    }

    void say(std::string_view what, const Job& job, const std::string& more = "") {
        const auto width = std::to_string(jobs_.size()).size();
        console_.say(fmt::format("[{:>{}}/{}] {:<9}  {}{}{}", count(RunPhase::finished), width, jobs_.size(),
                                 what, job.planned->run.name, more.empty() ? "" : "  ", more));
    }

    void show() {
        if (!console_.due()) return;
        for (Job* job : active_) {
            job->status = status_of(job->folder, job->planned->end);
            job->status.state = RunPhase::running;
        }
        console_.show(rows());
    }

    const std::vector<Slot>& slots_;
    const LocalOptions& options_;
    SweepConsole console_;
    std::vector<Job> jobs_;
    std::deque<Job*> queue_;
    std::vector<Job*> active_;
    std::vector<std::size_t> free_slots_;
    std::optional<Clock::time_point> stop_at_{};
    std::optional<int> kill_at_{};  // how many interrupts kill the runs
    bool killed_ = false;
};

}  // namespace

int run_locally(std::span<const PlannedRun> runs, const fs::path& folder, const Slots& slots,
                const LocalOptions& options) {
    return LocalRunner(runs, folder, slots, options).run();
}

}  // namespace cale
