#include "evaluate/event_counts.h"

#include <fmt/format.h>

namespace cale {

std::string event_table(const EventCounts& counts) {
    std::string table = "event,count\n";
    for (std::size_t i = 0; i < counts.size(); ++i)
        table += fmt::format("{},{}\n", event_name(static_cast<Event>(i)), counts[i]);
    return table;
}

}  // namespace cale
