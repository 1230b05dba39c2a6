// The output of `cale bench`: how a run spent its time.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>

#include "agents/time_split.h"

namespace cale {

/// The parts of a TimeSplit by their names in progress.csv, "time/NAME".
inline constexpr std::array<std::pair<std::string_view, double TimeSplit::*>, 7> kTimeParts{
    {{"environment", &TimeSplit::environment},
     {"replay", &TimeSplit::replay},
     {"transfer", &TimeSplit::transfer},
     {"act", &TimeSplit::act},
     {"update", &TimeSplit::update},
     {"evaluation", &TimeSplit::evaluation},
     {"log", &TimeSplit::log}}};

/// Returns the seconds of all parts.
double total_seconds(const TimeSplit& split);

/// A line per part of TimeSplit, with its share of the wall time and its milliseconds per agent step, from
/// the progress.csv of a finished or running run. Throws std::runtime_error, naming the file, where it is
/// missing, has no row yet or comes from a version that did not write times.
std::string time_report(const std::filesystem::path& run_dir);

}  // namespace cale
