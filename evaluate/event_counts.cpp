#include "evaluate/event_counts.h"

#include <algorithm>

#include <fmt/format.h>

#include "cale/zones.h"

namespace cale {

void count_events(EventCounts& counts, const StepResult& result) {
    if (result.frames == 0) return;  // nothing was played: a resumed game in real time is cut off
    if (!result.stick_moves) {
        ++counts.at(result.event);
        return;
    }
    // In real time, a step that took long has more frames than are known.
    const auto known = std::min(static_cast<std::size_t>(result.frames), result.frame_events.size());
    for (std::size_t frame = 0; frame < known; ++frame) ++counts.at(result.frame_events[frame]);
}

std::map<std::string, double> zone_shares(const EventCounts& before, const EventCounts& now) {
    std::map<std::string, double> shares{{"fire", 0}};
    for (const auto zone : kZones) shares[std::string(zone)] = 0;
    double steps = 0;
    for (std::size_t i = 0; i < now.size(); ++i) {
        const auto event = static_cast<Event>(i);
        const auto count = static_cast<double>(now[i] - before[i]);
        steps += count;
        shares[std::string(kZones[zone_of(event)])] += count;
        if (presses_fire(event)) shares["fire"] += count;
    }
    if (steps <= 0) return {};
    for (auto& [zone, share] : shares) share /= steps;
    return shares;
}

std::string event_table(const EventCounts& counts) {
    std::string table = "event,count\n";
    for (std::size_t i = 0; i < counts.size(); ++i)
        table += fmt::format("{},{}\n", event_name(static_cast<Event>(i)), counts[i]);
    return table;
}

}  // namespace cale
