#include "agents/exploration.h"

#include <algorithm>
#include <array>
#include <stdexcept>

#include <torch/types.h>

namespace cale {

std::span<const std::string_view> names_of(Exploration) {
    static constexpr std::array<std::string_view, 2> names{"standard", "epsilon_greedy"};
    return names;
}

double linearly_decaying_epsilon(std::int64_t decay_period, std::int64_t step, std::int64_t warmup_steps,
                                 double final) {
    const auto steps_left = static_cast<double>(decay_period + warmup_steps - step);
    const double bonus = (1 - final) * steps_left / static_cast<double>(decay_period);
    return final + std::clamp(bonus, 0.0, 1 - final);
}

void require_finite(const torch::Tensor& actions) {
    if (actions.isfinite().all().item<bool>()) return;
    throw std::runtime_error(
        "the actor's output is not finite: training has diverged, try a lower learning_rate");
}

torch::Tensor uniform_actions(const ActionBox& box, std::int64_t count, at::Generator random) {
    return box.centre + box.half_width * (2 * torch::rand({count, box.centre.size(0)}, random) - 1);
}

torch::Tensor epsilon_greedy(const torch::Tensor& actions, double epsilon, const ActionBox& box,
                             at::Generator random) {
    const auto chosen = torch::rand({actions.size(0), 1}, random) <= epsilon;
    return torch::where(chosen, uniform_actions(box, actions.size(0), random), actions);
}

torch::Tensor epsilon_greedy(const torch::Tensor& actions, double epsilon, std::int64_t num_actions,
                             at::Generator random) {
    const auto chosen = torch::rand({actions.size(0)}, random) <= epsilon;
    const auto uniform = torch::randint(0, num_actions, actions.sizes(), random, torch::kInt64);
    return torch::where(chosen, uniform, actions);
}

}  // namespace cale
