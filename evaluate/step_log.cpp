#include "evaluate/step_log.h"

#include <iterator>

#include <fmt/format.h>

#include "storage/files.h"

namespace cale {

void StepLog::add(const StepCommand& command, const StepResult& result,
                  const std::optional<StickPosition>& position) {
    const auto into = std::back_inserter(rows_);
    fmt::format_to(into, "{},", ++steps_);
    if (command.stick) {
        fmt::format_to(into, ",{},{},{},", command.stick->radius, command.stick->theta, command.stick->fire);
    } else {
        fmt::format_to(into, "{},,,,", command.number);
    }
    if (position) {
        fmt::format_to(into, "{:.4f},{:.4f},{:.4f},", position->x, position->y, position->button);
    } else {
        rows_ += ",,,";
    }
    fmt::format_to(into, "{},{},", event_name(static_cast<Event>(result.event)), result.frames);
    for (int frame = 0; frame < result.frames; ++frame) {
        const auto seen = static_cast<Event>(result.frame_events[static_cast<std::size_t>(frame)]);
        fmt::format_to(into, "{}{}", frame > 0 ? " " : "", event_name(seen));
    }
    fmt::format_to(into, ",{:g},{},{},{}\n", result.reward, result.lives, result.terminal ? 1 : 0,
                   result.truncated ? 1 : 0);
}

void StepLog::write() const {
    write_file_atomically(
        file_,
        "step,action,r,theta,fire,x,y,button,event,frames,seen,reward,lives,terminal,truncated\n" + rows_);
}

}  // namespace cale
