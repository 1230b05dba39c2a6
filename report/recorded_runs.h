// Runs as a table: what is left of them to compare with, without their folders. `cale report` writes
// run_curves.csv, and data/cale_scores.csv is such a table of our own results.
#pragma once

#include <string>
#include <vector>

#include "report/comparison.h"
#include "report/csv.h"
#include "report/runs.h"

namespace cale {

/// Returns the runs of a comparison of training scores: a row for every tenth of a run's agent steps, and for
/// the last step, with the score as it stood then, and the rules by which the run was played; `run` numbers
/// the runs of a group. Empty for evaluations.
std::string recorded_runs_csv(const Comparison& comparison);

/// Returns the names of the groups of runs in such a table, each once, as they stand. Throws
/// std::runtime_error for a table that is cut or none of recorded runs.
std::vector<std::string> recorded_groups(const CsvTable& table);

/// Returns the runs of these groups, with Run::recorded_as set. Throws as recorded_groups() does, and where a
/// cell is no number or no game, the steps of a run do not ascend, or its agent, game or seed change.
std::vector<Run> read_recorded_runs(const CsvTable& table, const std::vector<std::string>& groups);

}  // namespace cale
