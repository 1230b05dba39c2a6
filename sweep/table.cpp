#include "sweep/table.h"

#include <algorithm>
#include <limits>
#include <map>
#include <string_view>

#include <fmt/format.h>

#include "cale/fields.h"
#include "cale/text.h"
#include "terminal/columns.h"
#include "terminal/console.h"

namespace cale {
namespace {

constexpr std::size_t kNarrowestName = 16;
/// state, step, steps/s, return and ETA with the spaces before them
constexpr std::size_t kOtherColumns = 2 + 11 + 2 + 17 + 2 + 8 + 2 + 9 + 2 + 8;

/// Whether a character of UTF-8 begins there.
bool begins_character(const std::string& text, std::size_t at) {
    return at >= text.size() || !continues_character(text[at]);
}

/// The first bytes that `width` has room for, in whole characters.
std::string cut(const std::string& text, std::size_t width) {
    auto end = std::min(width, text.size());
    while (!begins_character(text, end)) --end;
    return text.substr(0, end);
}

/// "Breakout__sac__enco...=standard__1"
std::string shortened(const std::string& text, std::size_t width) {
    if (text.size() <= width) return text;
    if (width < 8) return cut(text, width);
    const auto of_end = (width - 3) / 2;
    auto end = text.size() - of_end;
    while (!begins_character(text, end)) ++end;
    return cut(text, width - 3 - of_end) + "..." + text.substr(end);
}

/// Whether it still makes steps.
bool trains(const RunRow& row) {
    return row.status.state == RunPhase::running && row.status.step < row.end.total_steps;
}

double seconds_left(const RunRow& row) {
    const auto left = static_cast<double>(row.end.total_steps - row.status.step);
    return row.status.steps_per_second > 0 ? left / row.status.steps_per_second
                                           : std::numeric_limits<double>::infinity();
}

}  // namespace

std::string summary(std::span<const RunRow> rows) {
    std::map<std::string, int> counts;
    double speed = 0, steps_left = 0;
    for (const auto& row : rows) {
        ++counts[row.state];
        if (trains(row)) speed += row.status.steps_per_second;
        if (row.status.state != RunPhase::finished && row.status.state != RunPhase::failed &&
            row.status.state != RunPhase::refused)
            steps_left += static_cast<double>(row.end.total_steps - row.status.step);
    }
    auto text = counted(rows.size(), "run") + ":";
    const char* comma = "";
    const auto add = [&](std::string_view state, int count) {
        text += fmt::format("{} {} {}", comma, count, state);
        comma = ",";
    };
    for (const auto state : {RunPhase::finished, RunPhase::failed, RunPhase::refused, RunPhase::running,
                             RunPhase::interrupted, RunPhase::waiting}) {
        if (const auto found = counts.extract(std::string(name_of(state)))) add(found.key(), found.mapped());
    }
    for (const auto& [state, count] : counts) add(state, count);  // a batch system's own
    if (speed > 0)
        text += fmt::format("  |  {:.0f} steps/s, ETA {}", speed, duration_text(steps_left / speed));
    return text;
}

std::string table(std::span<const RunRow> rows, std::size_t width) {
    std::size_t widest = kNarrowestName;
    for (const auto& row : rows) widest = std::max(widest, row.name.size());
    const auto room = width > kOtherColumns + kNarrowestName ? width - kOtherColumns : kNarrowestName;
    const auto column = std::min(widest, room);
    std::string text;
    const auto add = [&](const std::string& name, const auto&... cells) {
        text += cut(fmt::format("{:<{}}  {:<11}  {:>17}  {:>8}  {:>9}  {:>8}", shortened(name, column),
                                column, cells...),
                    width) +
                "\n";
    };
    add("run", "state", "step", "steps/s", "return", "ETA");
    for (const auto& row : rows) {
        const bool running = row.status.state == RunPhase::running;
        const bool evaluates = running && !trains(row) && row.end.evaluates;
        add(row.name, evaluates ? "evaluating" : row.state,
            fmt::format("{}/{}", row.status.step, row.end.total_steps),
            trains(row) && row.status.steps_per_second > 0
                ? fmt::format("{:.1f}", row.status.steps_per_second)
                : "-",
            row.status.mean_return ? fmt::format("{:.1f}", *row.status.mean_return) : "-",
            trains(row) ? duration_text(seconds_left(row)) : "-");
        if (!row.status.message.empty() && row.status.state == RunPhase::failed)
            text += shortened("  " + printable(row.status.message), width) + "\n";
        // Every key of it is needed.
        if (row.status.state == RunPhase::refused) text += wrap(printable(row.status.message), 2, width);
    }
    return text;
}

}  // namespace cale
