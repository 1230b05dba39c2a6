#include "agents/on_policy_memory.h"

#include "agents/env_share.h"
#include "agents/memory.h"
#include "networks/layers.h"

namespace cale {

void check_memory(const OnPolicySettings& settings, const AgentSpec& spec, std::int64_t available) {
    const auto network = make_network(settings, spec, no_values());
    const auto beside_network = memory_beside(
        {parameter_bytes(*network), /*target=*/spec.overlap, "agent.hidden_units or agent.hidden_layers"},
        spec, available);
    const auto own = [&](std::int64_t steps) { return steps * spec.num_envs / EnvShare(spec).all; };
    const auto left = memory_beside_batch({*network, network->acting}, own(settings.minibatch_size), spec,
                                          beside_network, "agent.minibatch_size");
    // A second time where a checkpoint is written, and with overlap a third, to learn from.
    const auto rollout = (spec.overlap ? 3 : 2) * own(settings.rollout_steps) * spec.observation.stack *
                         spec.observation.frame_size();
    if (rollout > left) refuse_memory("the rollout", rollout, left, "lower agent.rollout_steps");
}

}  // namespace cale
