#include "replay/replay_memory.h"

#include <sstream>
#include <stdexcept>

#include "replay/config_entries.h"
#include "replay/frame_ring.h"
#include "replay/sum_tree.h"

namespace cale {

std::int64_t memory_needed(const ReplayConfig& config) {
    validate(config);
    return frame_capacity(config) * bytes_per_frame(config) + config.capacity * bytes_per_transition(config) +
           (config.prioritised ? SumTree::bytes(config.capacity) : 0);
}

void check_memory(const ReplayConfig& config, std::int64_t available) {
    const std::int64_t needed = memory_needed(config);
    if (needed <= available) return;
    const std::int64_t fits =
        config.capacity - (needed - available) / (bytes_per_frame(config) + bytes_per_transition(config)) - 1;
    std::ostringstream message;
    message.precision(3);
    message << "the replay needs " << static_cast<double>(needed) / 1e9 << " GB of memory and "
            << static_cast<double>(available) / 1e9 << " GB are available: lower agent.replay_capacity from "
            << config.capacity;
    if (fits > 0) message << " to " << fits << " or less";
    throw std::runtime_error(message.str());
}

}  // namespace cale
