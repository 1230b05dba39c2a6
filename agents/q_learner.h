// What DQN and DER update: a network for action values, its target, and the optimiser.
#pragma once

#include <cstdint>

#include "agents/agent.h"
#include "agents/state.h"
#include "networks/adam.h"
#include "networks/q_network.h"

namespace cale {

/// The target follows only when it is told to.
struct QLearner {
    /// Takes the networks as they are.
    QLearner(QNetwork network, QNetwork target, const AdamConfig& adam_config);

    /// One step along the gradient of `loss` [].
    void step(const torch::Tensor& loss);
    /// target = network.
    void copy_to_target();
    /// Adds network/, target/ and adam/.
    void add_state(StateParts& parts);

    QNetwork network, target;  // the one that acts, and the one that values what follows
    Adam adam;                 // the network's optimiser
};

/// Action values of the spec's frames, whatever `encoder` says of them; on the CPU.
QNetwork make_q_network(EncoderConfig encoder, const QHeadConfig& head, const AgentSpec& spec,
                        const at::Generator& generator);

/// On the spec's device and for its frames, whatever `encoder` says of them; the target starts equal to the
/// network.
QLearner make_q_learner(const EncoderConfig& encoder, const QHeadConfig& head, const AdamConfig& adam_config,
                        const AgentSpec& spec, std::uint64_t seed);

}  // namespace cale
