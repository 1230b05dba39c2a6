#include "train/dormant_units.h"

#include <random>

#include <torch/types.h>
#include <torch/utils.h>

#include "policy/torch/actor_network.h"
#include "replay/replay.h"
#include "train/policy_snapshot.h"

namespace cale {

std::optional<double> dormant_share(Agent& agent, std::uint64_t seed) {
    constexpr std::int64_t observations = 64;
    constexpr double threshold = 0.025;

    auto* const replay = agent.replay();
    if (replay == nullptr || replay->size() == 0) return std::nullopt;
    const auto policy = agent.policy();  // a copy of the weights
    if (!policy) return std::nullopt;
    auto batch = replay->empty_batch(observations);
    std::mt19937_64 random(seed);
    replay->sample_into(batch, random);

    const torch::NoGradGuard no_grad;
    std::int64_t units = 0, dormant = 0;
    ActorNetwork(policy->network, numbers_of(policy->weights), torch::kCPU)
        .output(batch.observation.cpu(), [&](const torch::Tensor& activations) {
            const auto of_units = activations.abs().transpose(0, 1).flatten(1).mean(1);
            units += of_units.numel();
            dormant += (of_units <= threshold * of_units.mean()).sum().item<std::int64_t>();
        });
    if (units == 0) return std::nullopt;
    return static_cast<double>(dormant) / static_cast<double>(units);
}

}  // namespace cale
