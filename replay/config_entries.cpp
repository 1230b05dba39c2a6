#include "replay/config_entries.h"

#include <cstddef>
#include <sstream>
#include <stdexcept>

namespace cale {
namespace {

constexpr std::array<std::string_view, 2> kFalseTrue{"false", "true"};

}  // namespace

std::string ReplayConfigEntry::text(double number) const {
    if (number >= 0 && number < static_cast<double>(names.size()))
        return std::string(names[static_cast<std::size_t>(number)]);
    std::ostringstream out;
    out.precision(15);
    out << number;
    return out.str();
}

std::array<ReplayConfigEntry, 10> entries(const ReplayConfig& config) {
    const auto number = [](auto value) { return static_cast<double>(value); };
    const auto& shape = config.observation.shape;
    return {{{"agent.replay_capacity", number(config.capacity), {1, 1e9}},
             {"env.num_envs", number(config.num_envs), {1, 1024}},
             {"stack", number(config.observation.stack), {1, 64}},
             {"frame_height", number(shape.size() < 2 ? 1 : shape.front()), {1, 4096}},
             {"frame_width", number(shape.back()), {1, 4096}},
             {"action_size", number(config.action_size), {0, 1024}},
             {"agent.update_horizon", number(config.update_horizon), {1, 10'000}},
             {"agent.gamma", config.gamma, {0, 1}},
             {"agent.replay_terminal",
              number(static_cast<int>(config.replay_terminal)),
              {0, 1},
              names_of(config.replay_terminal)},
             {"agent.prioritised", number(config.prioritised), {0, 1}, kFalseTrue}}};
}

void validate(const ReplayConfig& config) {
    const auto& shape = config.observation.shape;
    if (shape.empty() || shape.size() > 2)
        throw std::invalid_argument("a frame has one or two dimensions, not " + std::to_string(shape.size()));
    for (const ReplayConfigEntry& entry : entries(config)) {
        if (entry.value >= entry.range.low && entry.value <= entry.range.high) continue;
        throw std::invalid_argument(std::string(entry.key) + " is " + entry.text(entry.value) +
                                    "; it must lie in [" + entry.text(entry.range.low) + ", " +
                                    entry.text(entry.range.high) + "]");
    }
}

}  // namespace cale
