#include "agents/advantages.h"

#include <torch/types.h>

#include "networks/layers.h"

namespace cale {

Advantages generalized_advantages(const torch::Tensor& reward, const torch::Tensor& terminal,
                                  const torch::Tensor& value, const torch::Tensor& next_value, double gamma,
                                  double lambda) {
    require_shape("generalized_advantages", "terminal", terminal, reward.sizes());
    require_shape("generalized_advantages", "value", value, reward.sizes());
    require_shape("generalized_advantages", "next_value", next_value, reward.sizes().slice(1));
    const auto advantage = torch::zeros_like(reward);
    auto following_value = next_value, following_advantage = torch::zeros_like(next_value);
    // Equation 16's sum as a recursion from its end: A_t = delta_t + gamma lambda A_{t+1}.
    for (std::int64_t t = reward.size(0) - 1; t >= 0; --t) {
        const auto not_done = 1 - terminal[t];
        const auto delta = reward[t] + gamma * following_value * not_done - value[t];
        following_advantage = delta + gamma * lambda * not_done * following_advantage;
        following_value = value[t];
        advantage[t] = following_advantage;
    }
    return {advantage, advantage + value};
}

}  // namespace cale
