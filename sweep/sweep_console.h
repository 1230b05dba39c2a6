// What a sweep shows while it runs: a line for whatever happens, and on a terminal the runs under way below.
#pragma once

#include <chrono>
#include <cstdio>
#include <span>
#include <string>

#include "sweep/table.h"

namespace cale {

/// Writes to a file that it does not own, which must outlive it.
class SweepConsole {
  public:
    /// Draws a live table if `out` is a terminal and it is wanted; else a summary every five minutes.
    SweepConsole(std::FILE* out, bool live_table);

    /// A line of its own, above the table.
    void say(const std::string& line);
    /// Whether the table or the summary wants to be shown again.
    bool due() const;
    /// Shows how the sweep stands, and those of its runs that are running.
    void show(std::span<const RunRow> runs);
    /// Takes the table away and leaves the summary.
    void finish(std::span<const RunRow> runs);

  private:
    void clear();

    std::FILE* out_;
    bool live_;
    int lines_drawn_ = 0;
    std::chrono::steady_clock::time_point next_{};
};

}  // namespace cale
