#include "agents/action_metrics.h"

namespace cale {

void add_mean_action(std::map<std::string, double>& metrics, const torch::Tensor& action) {
    const auto coordinates = action.cpu();
    std::int64_t i = 0;
    for (const auto* tag : {"mean_radius", "mean_theta", "mean_fire"})
        metrics["charts/" + std::string(tag)] = coordinates[i++].item<double>();
}

}  // namespace cale
