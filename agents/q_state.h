// The settings that DQN and DER share, and the state that a gradient step changes.
#pragma once

#include <concepts>
#include <cstdint>

#include "agents/agent.h"
#include "agents/exploration.h"
#include "agents/off_policy.h"
#include "agents/state.h"
#include "cale/fields.h"
#include "networks/adam.h"
#include "networks/q_network.h"

namespace cale {

/// The defaults are Dopamine's for 200 million frames.
struct QSettings {
    EncoderKind encoder = EncoderKind::phi_dqn;
    Padding padding = Padding::same;
    std::int64_t hidden_units = 512;
    bool layer_norm = false;
    bool dueling = false;
    bool double_dqn = false;
    ReplaySettings replay{.reward_clip = 1};
    std::int64_t target_update_period = 8'000;
    EpsilonSettings epsilon;
    double learning_rate = 6.25e-5;
    double adam_epsilon = 1.5e-4;
    double weight_decay = 0;
};

template <class Visit>
void fields(QSettings& settings, Visit&& visit) {
    visit("encoder", settings.encoder, "how observations become features; for bytes mlp, or flat: no layer");
    visit("padding", settings.padding,
          "of phi_sac and phi_dqn; same: with zeros, as Dopamine; valid: without, as Mnih et al.");
    visit("hidden_units", settings.hidden_units, Range{1, 65'536}, "units of the hidden layer");
    visit("layer_norm", settings.layer_norm,
          "normalise behind the hidden layer, and behind those of mlp (Ba et al. 2016)");
    visit("dueling", settings.dueling, "a state's value and the actions' advantages apart");
    visit("double_dqn", settings.double_dqn,
          "the online network chooses the action that the target evaluates");
    fields(settings.replay, visit);
    visit("target_update_period", settings.target_update_period, Range{1, 1e9},
          "agent steps between copies of the network to the target");
    fields(settings.epsilon, visit);
    visit("learning_rate", settings.learning_rate, Range{0, 1}, "Adam's learning rate");
    visit("adam_epsilon", settings.adam_epsilon, Range{1e-12, 1}, "Adam's epsilon, outside the root");
    visit("weight_decay", settings.weight_decay, Range{0, 1}, "of AdamW; 0: Adam");
}

/// Returns a network for the spec's observations and actions, on the CPU. `head` says how action values are
/// represented; the rest of it is set here, as `settings` and the spec have it.
QNetwork make_q_network(const QSettings& settings, const AgentSpec& spec, QHeadConfig head,
                        const at::Generator& generator);

/// Returns the network of an agent with these settings; head_of(config) says how action values are
/// represented.
template <std::derived_from<QSettings> Config>
QNetwork make_network(const Config& config, const AgentSpec& spec, const at::Generator& generator) {
    return make_q_network(config, spec, head_of(config), generator);
}

/// A network for action values, its target, and the optimiser.
struct QState {
    /// Takes the networks as they are.
    QState(QNetwork network, QNetwork target, const AdamConfig& adam_config);
    /// A network of initial_network() and an equal target.
    template <std::derived_from<QSettings> Config>
    QState(const Config& config, const AgentSpec& spec)
        : QState(initial_network(config, spec), initial_network(config, spec),
                 {.learning_rate = config.learning_rate,
                  .epsilon = config.adam_epsilon,
                  .weight_decay = config.weight_decay}) {}

    /// One step along the gradient of `loss` [], which afterwards is without its graph.
    void step(torch::Tensor& loss);
    /// target = network.
    void copy_to_target();
    /// Adds network/, target/ and adam/.
    void add_state(StateParts& parts);

    QNetwork network, target;  // the one that acts, and the one that values what follows
    Adam adam;                 // the network's optimiser
};

}  // namespace cale
