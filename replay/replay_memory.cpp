#include "replay/replay_memory.h"

#include <sstream>
#include <stdexcept>

#include "replay/config_entries.h"
#include "replay/frame_ring.h"
#include "replay/sum_tree.h"

namespace cale {

namespace {

std::int64_t frame_bytes(const ReplayConfig& config, bool mirrored) {
    return bytes_per_frame(config) + (mirrored ? config.observation.frame_size() : 0);
}

}  // namespace

std::int64_t memory_needed(const ReplayConfig& config, bool mirrored) {
    validate(config);
    return frame_capacity(config) * frame_bytes(config, mirrored) +
           config.capacity * bytes_per_transition(config) +
           (config.prioritised ? SumTree::bytes(config.capacity) : 0);
}

void check_memory(const ReplayConfig& config, std::int64_t available, bool mirrored) {
    const std::int64_t needed = memory_needed(config, mirrored);
    if (needed <= available) return;
    const std::int64_t fits =
        config.capacity -
        (needed - available) / (frame_bytes(config, mirrored) + bytes_per_transition(config)) - 1;
    std::ostringstream message;
    message.precision(3);
    message << "the replay needs " << static_cast<double>(needed) / 1e9 << " GB of memory and "
            << static_cast<double>(available) / 1e9 << " GB are available: lower agent.replay_capacity from "
            << config.capacity;
    if (fits > 0)
        message << " to " << fits << " or less";
    else
        message << ", env.num_envs from " << config.num_envs << " or agent.update_horizon from "
                << config.update_horizon;
    throw std::runtime_error(message.str());
}

}  // namespace cale
