// Whether an agent's encoder can read what its world shows, before either is made.
#pragma once

#include "agents/agent.h"
#include "networks/encoders.h"

namespace cale {

/// Throws std::invalid_argument, in one sentence, where the agent has an encoder that convolves and the world
/// shows no images. Whether an image is large enough is known when the network is made.
template <class AgentConfig>
void check_encoder(const AgentConfig& agent, const AgentSpec& spec) {
    EncoderConfig encoder{.observation = spec.observation.tensor_shape()};
    if constexpr (requires { encoder.encoder = agent.network.encoder; })
        encoder.encoder = agent.network.encoder;
    else if constexpr (requires { encoder.encoder = agent.encoder; })
        encoder.encoder = agent.encoder;
    else
        return;
    trunk_layers(encoder);
}

}  // namespace cale
