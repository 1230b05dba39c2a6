#include "evaluate/event_counts.h"

#include <fmt/format.h>

namespace cale {

namespace {

/// Where the stick is for each Event, the button aside.
constexpr std::array<const char*, kEventCount> kZones{
    "centre",    "centre", "up",    "right", "left", "down",     "up_right", "up_left",    "down_right",
    "down_left", "up",     "right", "left",  "down", "up_right", "up_left",  "down_right", "down_left"};

constexpr bool has_fire(std::size_t event) {
    return event == static_cast<std::size_t>(Event::fire) ||
           event >= static_cast<std::size_t>(Event::up_fire);
}

}  // namespace

std::map<std::string, double> zone_shares(const EventCounts& before, const EventCounts& now) {
    std::map<std::string, double> shares;
    double steps = 0;
    for (std::size_t event = 0; event < now.size(); ++event) {
        const auto count = static_cast<double>(now[event] - before[event]);
        steps += count;
        shares[kZones[event]] += count;
        shares["fire"] += has_fire(event) ? count : 0;
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
