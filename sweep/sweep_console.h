// The console output of a sweep: a line per event, and on a terminal the running runs below.
#pragma once

#include <chrono>
#include <cstdio>
#include <span>
#include <string>
#include <string_view>

#include "sweep/table.h"

namespace cale {

/// Writes to a file that it does not own, which must outlive it. What cannot be written is lost.
class SweepConsole {
  public:
    /// Draws a live table if `out` is a terminal and `live_table` is true; else a summary every five minutes.
    SweepConsole(std::FILE* out, bool live_table);

    /// A line of its own, above the table.
    void say(const std::string& line);
    /// Returns whether the table or the summary must be shown again.
    bool due() const;
    /// Shows the progress of the sweep and its running runs.
    void show(std::span<const RunRow> runs);
    /// Removes the table and leaves the summary.
    void finish(std::span<const RunRow> runs);

  private:
    void clear();
    void write(std::string_view text);

    std::FILE* out_;
    bool live_;
    int lines_drawn_ = 0;
    std::chrono::steady_clock::time_point next_{};
};

}  // namespace cale
