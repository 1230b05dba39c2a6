#include "sweep/sweep_console.h"

#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <unistd.h>

#include "cale/text.h"
#include "terminal/columns.h"

namespace cale {
namespace {

constexpr auto kDrawInterval = std::chrono::seconds(1);
constexpr auto kSummaryInterval = std::chrono::minutes(5);
constexpr std::size_t kUsualWidth = 120;
constexpr std::size_t kUsualHeight = 40;

}  // namespace

SweepConsole::SweepConsole(std::FILE* out, bool live_table)
    : out_(out), live_(live_table && ::isatty(::fileno(out)) == 1) {
    if (!live_) next_ = std::chrono::steady_clock::now() + kSummaryInterval;
}

void SweepConsole::say(const std::string& line) {
    clear();
    write(printable(line) + "\n");
    if (live_) next_ = {};
}

bool SweepConsole::due() const {
    return std::chrono::steady_clock::now() >= next_;
}

void SweepConsole::show(std::span<const RunRow> runs) {
    next_ = std::chrono::steady_clock::now() + (live_ ? kDrawInterval : kSummaryInterval);
    if (!live_) return write(summary(runs) + "\n");
    const auto size = terminal_size(out_).value_or(TerminalSize{kUsualWidth, kUsualHeight});
    const std::size_t width = size.columns - 1;  // some terminals wrap a full line
    const std::size_t height = size.rows;
    std::vector<RunRow> running;
    for (const auto& run : runs) {
        // Two lines are above them, and the cursor's line is below.
        if (run.status.state == RunPhase::running && running.size() + 4 < std::max<std::size_t>(height, 6))
            running.push_back(run);
    }
    const auto text = summary(runs).substr(0, width) + "\n" + table(running, width);
    clear();
    write(text);
    lines_drawn_ = static_cast<int>(std::count(text.begin(), text.end(), '\n'));
}

void SweepConsole::finish(std::span<const RunRow> runs) {
    say(summary(runs));
}

void SweepConsole::clear() {
    if (lines_drawn_ > 0) write(fmt::format("\033[{}A\033[J", lines_drawn_));
    lines_drawn_ = 0;
}

void SweepConsole::write(std::string_view text) {
    std::fwrite(text.data(), 1, text.size(), out_);
    std::fflush(out_);
}

}  // namespace cale
