#include "agents/agent.h"

namespace cale {

void require_continuous(std::string_view who, const AgentSpec& spec) {
    if (std::holds_alternative<Box>(spec.action_space)) return;
    throw std::invalid_argument(std::string(who) +
                                " chooses coordinates; this world has numbered actions: set env.action_space "
                                "to continuous, and env.joystick to polar, cartesian or direction");
}

void require_discrete(std::string_view who, const AgentSpec& spec) {
    if (std::holds_alternative<Discrete>(spec.action_space)) return;
    throw std::invalid_argument(
        std::string(who) +
        " chooses among numbered actions; this world has the continuous joystick's coordinates: set "
        "env.action_space to minimal or full, or env.joystick to factored");
}

void require_finite(const torch::Tensor& numbers, std::string_view what) {
    if (numbers.isfinite().all().item<bool>()) return;
    throw Diverged(std::string(what) + " is not finite: training has diverged, try a lower learning_rate");
}

void add_mean_action(std::map<std::string, double>& metrics, const ActionSpace& space,
                     const torch::Tensor& action) {
    const auto& names = std::get<Box>(space).names;
    const auto coordinates = action.cpu();
    for (std::int64_t i = 0; i < coordinates.size(0); ++i) {
        const auto name = names.empty() ? "axis_" + std::to_string(i) : names[static_cast<std::size_t>(i)];
        metrics["charts/mean_" + name] = coordinates[i].item<double>();
    }
}

}  // namespace cale
