// The output of `cale bench`: how a run spent its time.
#pragma once

#include <filesystem>
#include <string>

namespace cale {

/// A line per part of TimeSplit, with its share of the wall time and its milliseconds per agent step, from
/// the progress.csv of a finished or running run. Throws std::runtime_error, naming the file, where it is
/// missing, has no row yet or comes from a version that did not write times.
std::string time_report(const std::filesystem::path& run_dir);

}  // namespace cale
