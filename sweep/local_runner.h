// Runs of a sweep on this machine, several at once.
#pragma once

#include <cstdio>
#include <filesystem>
#include <span>

#include "sweep/machine.h"
#include "sweep/plan.h"

namespace cale {

/// How runs are trained on this machine.
struct LocalOptions {
    int threads = 1;         // of a run
    int retries = 2;         // how often a failed run is retried without further progress
    bool live_table = true;  // on a terminal; otherwise a line per event
    std::FILE* out = stderr;
};

/// Trains what is not finished yet, each run in the subfolder of `folder` with its name, and returns
/// 0 when all are finished, 1 when some failed or are refused (see config_mismatch()), 130 when it was
/// interrupted.
///
/// A run that fails is retried from its newest checkpoint, after the waiting runs; one that rejects its
/// command line or its checkpoints, or diverged (exit codes 2, 3 and 4), is not. A run in whose folder
/// another process is working is not started again; the sweep waits for it. SIGINT, SIGTERM and SIGHUP stop
/// the runs, which write a checkpoint first; a SIGINT after that kills them. Runs do not outlive the sweep:
/// if it is killed they also write a checkpoint and stop.
int run_locally(std::span<const PlannedRun> runs, const std::filesystem::path& folder, const Slots& slots,
                const LocalOptions& options);

}  // namespace cale
