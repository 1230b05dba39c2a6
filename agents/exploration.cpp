#include "agents/exploration.h"

#include <algorithm>
#include <stdexcept>

namespace cale {

std::span<const std::string_view> names_of(Exploration) {
    static constexpr std::string_view names[] = {"standard", "epsilon_greedy"};
    return names;
}

double linearly_decaying_epsilon(std::int64_t decay_period, std::int64_t step, std::int64_t warmup_steps,
                                 double final) {
    const auto steps_left = static_cast<double>(decay_period + warmup_steps - step);
    const double bonus = (1 - final) * steps_left / static_cast<double>(decay_period);
    return final + std::clamp(bonus, 0.0, 1 - final);
}

std::span<const std::string_view> names_of(RandomActions) {
    static constexpr std::string_view names[] = {"box", "events"};
    return names;
}

ActionBox exploration_box(const ActionSpace& space, RandomActions choice) {
    auto box = action_box(space);
    if (choice == RandomActions::box) return box;
    const auto* const limits = std::get_if<Box>(&space);
    if (limits == nullptr || limits->landmarks.empty())
        throw std::invalid_argument(
            "agent.random_actions: this world's actions have no events: set it to box");
    box.landmarks = torch::tensor(at::ArrayRef<float>(limits->landmarks)).view({-1, box_size(space)});
    return box;
}

}  // namespace cale
