#include "agents/agent.h"

#include <stdexcept>

#include <torch/types.h>

namespace cale {

void set_spaces(AgentSpec& spec, const ActionSpace& actions, const ObservationSpace& observations) {
    spec.num_actions = num_actions(actions);
    spec.stack = observations.stack;
    spec.frame_height = observations.shape.size() == 2 ? observations.shape[0] : 1;
    spec.frame_width = observations.shape.back();
}

std::vector<std::int64_t> observation_shape(const AgentSpec& spec) {
    if (spec.frame_height == 1) return {spec.stack, spec.frame_width};
    return {spec.stack, spec.frame_height, spec.frame_width};
}

void require_continuous(std::string_view who, const AgentSpec& spec) {
    if (spec.num_actions == 0) return;
    throw std::invalid_argument(std::string(who) +
                                " acts on the continuous joystick; this world has discrete actions: set "
                                "env.action_space to continuous");
}

void require_discrete(std::string_view who, const AgentSpec& spec) {
    if (spec.num_actions > 0) return;
    throw std::invalid_argument(
        std::string(who) +
        " chooses among discrete actions; this world has the continuous joystick: set "
        "env.action_space to minimal or full");
}

void add_mean_action(std::map<std::string, double>& metrics, const torch::Tensor& action) {
    const auto coordinates = action.cpu();
    std::int64_t i = 0;
    for (const auto* tag : {"mean_radius", "mean_theta", "mean_fire"})
        metrics["charts/" + std::string(tag)] = coordinates[i++].item<double>();
}

}  // namespace cale
