// A sweep as text: one line that sums it up, and a table of its runs.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "sweep/run_folder.h"

namespace cale {

/// What the table shows of a run.
struct RunRow {
    std::string name;
    std::string state;  // name_of(RunPhase), or what a batch system says
    RunStatus status;
    RunEnd end{};
};

/// "24 runs: 12 finished, 2 running, 10 waiting  |  210 steps/s, ETA 12:34". The ETA counts the steps that
/// are left, at the speed of those that are running now.
std::string summary(std::span<const RunRow> rows);

/// A header and a line for each run: state, step, steps/s, return and ETA; below a run that failed or is
/// refused, why. No line is wider than `width` columns, but for a long word of a reason: long names lose
/// their middle.
std::string table(std::span<const RunRow> rows, std::size_t width);

}  // namespace cale
