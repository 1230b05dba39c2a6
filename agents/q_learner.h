// What DQN and DER update: a network for action values, its target, and the optimiser.
#pragma once

#include <cstdint>

#include "agents/agent.h"
#include "agents/state.h"
#include "networks/adam.h"
#include "networks/q_network.h"

namespace cale {

struct QLearner {
    QLearner(QNetwork network, QNetwork target, const AdamConfig& adam_config);

    /// One step along the gradient of `loss` [].
    void step(const torch::Tensor& loss);
    void copy_to_target();
    void add_state(StateParts& parts);

    QNetwork network, target;
    Adam adam;
};

/// On the spec's device; the target starts equal to the network.
QLearner make_q_learner(EncoderKind encoder, const QHeadConfig& head, const AdamConfig& adam_config,
                        const AgentSpec& spec, std::uint64_t seed);

}  // namespace cale
