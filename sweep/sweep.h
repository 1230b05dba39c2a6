// `cale sweep` in one call: from a sweep file to trained runs.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "sweep/machine.h"
#include "sweep/search.h"

namespace cale {

enum class Launcher { local, slurm };
enum class SweepTask { train, show_commands, show_status };

/// What `cale sweep` is asked for.
struct SweepOptions {
    std::filesystem::path file;
    std::vector<std::string> overrides;  // KEY=VALUE[,VALUE...], see read_sweep()
    std::filesystem::path folder;        // of the runs' folders; empty: runs/<name of the file>
    std::vector<std::string> only;       // patterns of the names of runs (*, ?); empty: all runs
    SearchMethod search = SearchMethod::none;
    SweepTask task = SweepTask::train;
    Launcher launcher = Launcher::local;
    Sharing sharing;
    int gpus = 0;     // that LibTorch can use on this machine
    int retries = 2;  // see LocalOptions
    bool live_table = true;
    std::vector<std::string> sbatch_options;
    std::filesystem::path cale;  // this program; the training programs lie beside it
};

/// Results go to `out`, progress goes to the standard error. Returns the exit code: 0 done, 1 some runs
/// failed or, whatever the task, are refused, 130 interrupted. Throws ConfigError for what the user wrote,
/// before anything is started, and std::runtime_error.
int run_sweep(const SweepOptions& options, std::FILE* out);

}  // namespace cale
