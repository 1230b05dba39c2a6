// A sweep as job arrays of a Slurm cluster. What a job does is `cale sweep FILE --only RUN`, the local runner
// for one run: retries, resuming and locks are the same.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "sweep/plan.h"

namespace cale {

/// The job array that is submitted.
struct SlurmOptions {
    std::string name{};                  // of the job
    int at_once = 0;                     // tasks of the array that may run at the same time; 0: all
    int threads = 1;                     // cores of a task
    std::int64_t memory = 1;             // bytes of a task
    std::vector<std::string> options{};  // further ones of sbatch, such as --time=8:00:00
    std::vector<std::string> command{};  // cale sweep FILE ..., to which --only RUN is added
};

/// The batch script of one job array, whose task i trains the i-th of `names`. `folder` is the sweep's.
/// Slurm's time limit and preemption end a run at a checkpoint, and put it back into the queue.
std::string slurm_script(const std::filesystem::path& folder, std::span<const std::string> names,
                         const SlurmOptions& options);

/// Returns the states of the sweep's runs according to squeue: name and state, such as "pending". Runs
/// outside the queue are missing; empty if there is no squeue. Throws std::runtime_error with squeue's own
/// message, or where slurm.json is damaged.
std::map<std::string, std::string> queued_runs(const std::filesystem::path& folder);

/// Returns the names of the runs that are not finished, queued, running or refused, in arrays as large as the
/// cluster allows. Throws as queued_runs() does.
std::vector<std::vector<std::string>> job_arrays(std::span<const PlannedRun> runs,
                                                 const std::filesystem::path& folder);

/// Throws ConfigError where there is no sbatch.
void require_sbatch();

/// Submits job_arrays() and returns a line for each array. Which task is which run stands in
/// `folder`/slurm.json. Throws as require_sbatch() and queued_runs() do, ConfigError where another process
/// submits in this folder, std::runtime_error with sbatch's own sentence or the number of a job that could
/// not be recorded, naming the arrays submitted before.
std::vector<std::string> submit(std::span<const PlannedRun> runs, const std::filesystem::path& folder,
                                const SlurmOptions& options);

}  // namespace cale
