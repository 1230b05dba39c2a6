// The network settings of SAC, SAC-D and PPO.
#pragma once

#include <cstdint>

#include "agents/agent.h"
#include "cale/fields.h"
#include "networks/encoders.h"
#include "networks/heads.h"

namespace cale {

/// Settings of an encoder and of its heads.
struct NetworkSettings {
    EncoderKind encoder = EncoderKind::phi_sac;
    PhiDqn phi_dqn = PhiDqn::conv2d;
    std::int64_t hidden_layers = 1;
    std::int64_t hidden_units = 512;
    bool layer_norm = false;

    /// Returns the encoder's configuration for this world.
    EncoderConfig encoder_for(const AgentSpec& spec) const {
        return {.encoder = encoder,
                .phi_dqn = phi_dqn,
                .observation = spec.observation.tensor_shape(),
                .precision = spec.precision,
                .layer_norm = layer_norm};
    }
    /// Returns the configuration of the actor and of every critic.
    HeadConfig head() const {
        return {.hidden_layers = hidden_layers, .hidden_units = hidden_units, .layer_norm = layer_norm};
    }
};

template <class Visit>
void fields(NetworkSettings& settings, Visit&& visit) {
    visit("encoder", settings.encoder, "how observations become features; for bytes mlp, or flat: no layer");
    visit("phi_dqn", settings.phi_dqn,
          "of that encoder: conv2d: as meant; row1d: row by row, as Dopamine's CALE agents run it");
    visit("hidden_layers", settings.hidden_layers, Range{0, 16},
          "hidden layers of the actor and of every critic");
    visit("hidden_units", settings.hidden_units, Range{1, 65'536}, "units of a hidden layer");
    visit("layer_norm", settings.layer_norm,
          "normalise behind every dense layer but the last ones (Ba et al. 2016)");
}

}  // namespace cale
