#include "sweep/slurm.h"

#include <cstdint>
#include <cstdlib>
#include <exception>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "cale/text.h"
#include "settings/config.h"
#include "settings/shell_text.h"
#include "storage/files.h"
#include "storage/run_lock.h"
#include "sweep/config_mismatch.h"
#include "sweep/run_folder.h"
#include "sweep/shell.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

/// Largest index of an array plus one, unless Slurm is configured otherwise.
constexpr std::size_t kUsualArraySize = 1001;

constexpr const char* kScript = R"(
# Slurm sends SIGTERM when the job is preempted or cancelled, and SIGUSR1 before its time is up. Either ends
# the run after a checkpoint; one whose time is up goes back into the queue.
time_is_up=
trap 'time_is_up=1; kill -TERM "$runner"' USR1
trap 'kill -TERM "$runner"' TERM
{command} --only "${{runs[$SLURM_ARRAY_TASK_ID]}}" &
runner=$!
while kill -0 "$runner" 2>/dev/null; do wait "$runner"; done  # a signal interrupts wait
wait "$runner"
code=$?
# One task has the array's own job number; requeueing by that number would put back every task, finished ones
# included.
task="${{SLURM_ARRAY_JOB_ID:+${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID}}"
if [ "$code" = 130 ] && [ -n "$time_is_up" ]; then scontrol requeue "${{task:-$SLURM_JOB_ID}}"; fi
exit "$code"
)";

fs::path index_file(const fs::path& folder) {
    return folder / "slurm.json";
}

/// Task i of the job trains the i-th of the runs.
struct JobArray {
    std::string job;
    std::vector<std::string> runs;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(JobArray, job, runs)

/// [{"job": "17", "runs": ["Pong__sac__1", ...]}, ...]
std::vector<JobArray> read_index(const fs::path& folder) {
    if (!fs::exists(index_file(folder))) return {};
    try {
        return nlohmann::json::parse(read_file(index_file(folder))).get<std::vector<JobArray>>();
    } catch (const nlohmann::json::exception&) {
        throw std::runtime_error(
            fmt::format("{} is damaged; delete it once no job of this sweep is left in squeue",
                        index_file(folder).string()));
    }
}

/// Returns the job's number in sbatch's answer, "17" or "17;cluster", among the notes that may stand beside
/// it; empty where there is none.
std::string job_in(const std::string& answer) {
    std::istringstream lines(answer);
    for (std::string line; std::getline(lines, line);)
        if (auto job = line.substr(0, line.find(';')); number_in<std::uint64_t>(job)) return job;
    return "";
}

std::size_t largest_array() {
    std::istringstream lines(answer_of("scontrol show config 2>/dev/null").text);
    for (std::string line; std::getline(lines, line);) {
        if (!line.starts_with("MaxArraySize")) continue;
        const auto size = std::atol(line.substr(line.find('=') + 1).c_str());
        if (size > 0) return static_cast<std::size_t>(size);
    }
    return kUsualArraySize;
}

/// Throws ConfigError for a name that no directive of Slurm's can have in quotes.
void check_quotable(const std::string& name, std::string_view what, std::string_view kind) {
    if (name.find_first_of("\"\n") == name.npos) return;
    throw ConfigError(fmt::format(
        "{} {}: a directive of Slurm's takes no {} with a quote or a line break in its name; choose "
        "another",
        what, printable(name), kind));
}

/// A folder as a part of a quoted path of a directive, where Slurm would replace %j and the like. Throws
/// ConfigError.
std::string directive_path(const std::string& path) {
    check_quotable(path, "--dir", "folder");
    std::string text;
    for (const char c : path) {
        text += c;
        if (c == '%') text += c;
    }
    return text;
}

/// Submits an array of these runs and records it. Returns the line that says so.
std::string submit_array(const std::vector<std::string>& names, const fs::path& folder,
                         const SlurmOptions& options, std::vector<JobArray>& index) {
    fs::create_directories(folder / "slurm");
    const auto file = folder / "slurm" / fmt::format("array_{}.sh", index.size() + 1);
    write_file_atomically(file, slurm_script(folder, names, options));
    const std::vector<std::string> command = {"sbatch", "--parsable", file.string()};
    const auto answer = answer_of(shell_text(command) + " 2>&1");
    if (answer.status != 0)
        throw std::runtime_error(
            fmt::format("sbatch refuses {}: {}", file.string(), without_line_end(answer.text)));
    const auto job = job_in(answer.text);
    if (job.empty())
        throw std::runtime_error(fmt::format(
            "sbatch does not say which job {} became: look with squeue, and scancel it before the next "
            "attempt; its answer was: {}",
            file.string(), printable(without_line_end(answer.text))));
    index.push_back({.job = job, .runs = names});
    try {
        write_file_atomically(index_file(folder), nlohmann::json(index).dump(1) + "\n");
    } catch (const std::exception& error) {
        throw std::runtime_error(fmt::format(
            "{} became job {}, which could not be recorded: scancel {} before the next attempt ({})",
            file.string(), job, job, error.what()));
    }
    return fmt::format("job array {}: {}, {}", job, counted(names.size(), "run"), file.string());
}

}  // namespace

std::string slurm_script(const fs::path& folder, std::span<const std::string> names,
                         const SlurmOptions& options) {
    std::string script =
        "#!/bin/bash\n# Written by cale sweep --launcher slurm: a task for each of the runs below.\n";
    const auto directive = [&](const std::string& option) { script += fmt::format("#SBATCH {}\n", option); };
    check_quotable(options.name, "sweep", "sweep");
    directive(fmt::format("--job-name=\"{}\"", options.name));
    directive(fmt::format("--array=0-{}{}", names.size() - 1,
                          options.at_once > 0 ? fmt::format("%{}", options.at_once) : ""));
    directive("--ntasks=1");
    directive(fmt::format("--cpus-per-task={}", options.threads));
    directive(fmt::format("--mem={}M", (options.memory + (1 << 20) - 1) >> 20));
    directive(fmt::format("--output=\"{}/slurm/%A_%a.out\"", directive_path(folder.string())));
    directive("--open-mode=append");
    directive("--requeue");
    directive("--signal=B:USR1@120");
    for (const auto& option : options.options) directive(option);
    script += "\nruns=(\n";
    for (const auto& name : names) script += fmt::format("    {}\n", name);
    script += ")\n";
    return script + fmt::format(fmt::runtime(kScript), fmt::arg("command", shell_text(options.command)));
}

std::map<std::string, std::string> queued_runs(const fs::path& folder) {
    std::map<std::string, std::string> queued;
    const auto index = read_index(folder);
    if (index.empty() || answer_of("command -v squeue 2>/dev/null").status != 0) return queued;
    const auto answer = answer_of("squeue --noheader --array --me --format='%F %K %T' 2>&1");
    if (answer.status != 0)
        throw std::runtime_error(fmt::format("squeue: {}", without_line_end(answer.text)));
    std::istringstream lines(answer.text);
    for (std::string line, job, task, state; std::getline(lines, line);) {
        std::istringstream words(line);
        if (!(words >> job >> task >> state)) continue;  // a note of squeue's
        if (state == "COMPLETING" || state == "COMPLETED") continue;
        const auto number = number_in<std::size_t>(task);
        if (!number) continue;  // a job that is no array
        for (const auto& array : index)
            if (array.job == job && *number < array.runs.size()) queued[array.runs[*number]] = lower(state);
    }
    return queued;
}

std::vector<std::vector<std::string>> job_arrays(std::span<const PlannedRun> runs, const fs::path& folder) {
    const auto queued = queued_runs(folder);
    const auto most = largest_array();
    std::vector<std::vector<std::string>> arrays;
    for (const auto& planned : runs) {
        const auto state = status_of(planned, folder / planned.run.name).state;
        if (state == RunPhase::finished || state == RunPhase::running || state == RunPhase::refused ||
            queued.contains(planned.run.name))
            continue;
        if (arrays.empty() || arrays.back().size() == most) arrays.emplace_back();
        arrays.back().push_back(planned.run.name);
    }
    return arrays;
}

void require_sbatch() {
    if (answer_of("command -v sbatch 2>/dev/null").status != 0)
        throw ConfigError(
            "--launcher slurm: there is no sbatch on the PATH; start it on a machine of the cluster "
            "that submits jobs, or leave --launcher out to run here");
}

std::vector<std::string> submit(std::span<const PlannedRun> runs, const fs::path& folder,
                                const SlurmOptions& options) {
    require_sbatch();
    fs::create_directories(folder);
    std::optional<RunLock> lock;
    try {
        lock.emplace(folder);
    } catch (const FolderTaken&) {
        throw ConfigError(
            fmt::format("--launcher slurm: another cale sweep is submitting the runs of {}; wait for its end",
                        folder.string()));
    }
    auto index = read_index(folder);
    std::vector<std::string> lines;
    for (const auto& part : job_arrays(runs, folder)) {
        try {
            lines.push_back(submit_array(part, folder, options, index));
        } catch (const std::exception& error) {
            if (lines.empty()) throw;
            throw std::runtime_error(
                fmt::format("{}; submitted before it: {}", error.what(), fmt::join(lines, "; ")));
        }
    }
    return lines;
}

}  // namespace cale
