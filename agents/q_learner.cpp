#include "agents/q_learner.h"

#include <utility>

#include <torch/types.h>

#include "agents/random.h"

namespace cale {

QLearner::QLearner(QNetwork network_, QNetwork target_, const AdamConfig& adam_config)
    : network(std::move(network_)), target(std::move(target_)), adam(network->parameters(), adam_config) {}

void QLearner::step(const torch::Tensor& loss) {
    adam.zero_grad();
    loss.backward();
    adam.step();
}

void QLearner::copy_to_target() {
    hard_update(target->parameters(), network->parameters());
}

void QLearner::add_state(StateParts& parts) {
    parts.add("network/", *network);
    parts.add("target/", *target);
    parts.add("adam/", adam.state());
}

QNetwork make_q_network(EncoderConfig encoder, const QHeadConfig& head, const AgentSpec& spec,
                        const at::Generator& generator) {
    encoder.stack = spec.stack;
    encoder.frame_height = spec.frame_height;
    encoder.frame_width = spec.frame_width;
    return QNetwork(encoder, head, generator);
}

QLearner make_q_learner(const EncoderConfig& encoder, const QHeadConfig& head, const AdamConfig& adam_config,
                        const AgentSpec& spec, std::uint64_t seed) {
    const auto make_network = [&] {
        auto network = make_q_network(encoder, head, spec, make_generator(seed));
        network->to(spec.device);
        return network;
    };
    return {make_network(), make_network(), adam_config};  // the same seed makes the same network
}

}  // namespace cale
