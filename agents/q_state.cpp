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
                                  .observation = observation_shape(spec),
                                  .padding = settings.padding,
                                  .precision = spec.precision,
                                  .layer_norm = settings.layer_norm},
                    head, generator);
}

namespace {

QNetwork initial_network(const QSettings& settings, const AgentSpec& spec, const QHeadConfig& head) {
    auto network = make_q_network(settings, spec, head, initial_values(spec));
    network->to(spec.device);
    return network;
}

}  // namespace

QState::QState(QNetwork online, QNetwork target_network, const AdamConfig& adam_config)
    : network(std::move(online)),
      target(std::move(target_network)),
      adam(network->parameters(), adam_config) {}

QState::QState(const QSettings& settings, const AgentSpec& spec, const QHeadConfig& head)
    : QState(initial_network(settings, spec, head), initial_network(settings, spec, head),
             {.learning_rate = settings.learning_rate,
              .epsilon = settings.adam_epsilon,
              .weight_decay = settings.weight_decay}) {}

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
