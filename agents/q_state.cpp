#include "agents/q_state.h"

#include <utility>

#include <torch/types.h>

#include "networks/layers.h"

namespace cale {

QNetwork make_q_network(const QSettings& settings, const AgentSpec& spec, QHeadConfig head,
                        const at::Generator& generator) {
    const auto& actions = std::get<Discrete>(spec.action_space);
    head.num_actions = actions.n;
    head.factors = actions.factors;
    head.hidden_units = settings.hidden_units;
    head.layer_norm = settings.layer_norm;
    head.dueling = settings.dueling;
    return QNetwork(EncoderConfig{.encoder = settings.encoder,
                                  .observation = spec.observation.tensor_shape(),
                                  .padding = settings.padding,
                                  .precision = spec.precision,
                                  .layer_norm = settings.layer_norm},
                    head, generator);
}

QState::QState(QNetwork online, QNetwork target_network, const AdamConfig& adam_config)
    : network(std::move(online)),
      target(std::move(target_network)),
      adam(network->parameters(), adam_config) {}

void QState::step(torch::Tensor& loss) {
    adam.zero_grad();
    loss.backward();
    adam.step();
    loss = loss.detach();
}

void QState::copy_to_target() {
    hard_update(target->parameters(), network->parameters());
}

void QState::add_state(StateParts& parts) {
    parts.add("network/", *network);
    parts.add("target/", *target);
    parts.add("adam/", adam.state());
}

}  // namespace cale
