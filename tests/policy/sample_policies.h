// Policies of every kind, small and untrained, made without LibTorch.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "policy/policy_file.h"
#include "policy/program.h"

namespace cale::test {

using Net = PolicyNetwork;

struct SampleNetwork {
    std::string name;
    PolicyNetwork network;
};

/// Two frames of 21 x 18 pixels.
inline PolicyNetwork small(PolicyNetwork network) {
    network.stack = 2;
    network.frame_height = 21;
    network.frame_width = 18;
    network.hidden_units = 20;
    if (!network.continuous()) network.num_actions = 5;
    return network;
}

/// Every encoder, branch and head that an agent has, and what they can be combined with.
inline std::vector<SampleNetwork> sample_networks() {
    const Net sac{};
    Net sac_dqn = sac, sac_rows = sac, sac_impala = sac, sacd = sac, deep = sac, flat = sac;
    sac_dqn.encoder = sac_rows.encoder = Net::Encoder::phi_dqn;
    sac_rows.phi_dqn = Net::Rows::row1d;
    sac_impala.encoder = Net::Encoder::impala;
    sacd.head = Net::Head::categorical;
    deep.hidden_layers = 3;
    flat.hidden_layers = 0;

    Net ppo = sac, ppo_discrete = sac, ppo_shared = sac;
    for (auto* network : {&ppo, &ppo_discrete, &ppo_shared}) {
        network->head = Net::Head::gaussian;
        network->activation = Net::Activation::tanh;
        network->hidden_layers = 2;
    }
    ppo_discrete.head = Net::Head::categorical;
    ppo_shared.encoder = Net::Encoder::phi_sac;
    ppo_shared.branch = Net::Branch::shared;
    ppo_shared.padding = Net::Padding::valid;

    Net dqn = sac, dueling = sac, der = sac, der_impala = sac;
    for (auto* network : {&dqn, &dueling, &der, &der_impala}) {
        network->encoder = Net::Encoder::phi_dqn;
        network->branch = Net::Branch::none;
        network->head = Net::Head::values;
    }
    dueling.dueling = der.dueling = der_impala.dueling = true;
    der.num_atoms = der_impala.num_atoms = 51;
    der_impala.encoder = Net::Encoder::impala;

    std::vector<SampleNetwork> samples;
    for (const auto& [name, network] : {std::pair{"sac", sac},
                                        {"sac_dqn", sac_dqn},
                                        {"sac_rows", sac_rows},
                                        {"sac_impala", sac_impala},
                                        {"sacd", sacd},
                                        {"deep", deep},
                                        {"flat", flat},
                                        {"ppo", ppo},
                                        {"ppo_discrete", ppo_discrete},
                                        {"ppo_shared", ppo_shared},
                                        {"dqn", dqn},
                                        {"dueling", dueling},
                                        {"der", der},
                                        {"der_impala", der_impala}})
        samples.push_back({name, small(network)});
    return samples;
}

/// What it needs beside its weights.
inline PolicyInfo sample_info(const PolicyNetwork& network) {
    PolicyInfo info;
    info.game = "Breakout";
    info.agent = "sac";
    info.action_space = network.continuous() ? "continuous" : "minimal";
    for (std::int64_t i = 0; i < network.num_actions; ++i) info.actions.push_back(static_cast<Event>(i));
    info.encoder = "phi_sac";
    info.stack = network.stack;
    info.frame_height = network.frame_height;
    info.frame_width = network.frame_width;
    info.epsilon = 0.25;
    info.provenance = {{"seed", "7"}, {"config", "env:\n  game: breakout\n"}};
    return info;
}

/// The golden pair that this library makes of the policy's weights.
inline void set_golden(PolicyFile& policy) {
    policy.golden.observation = golden_observation(policy.info);
    const lite::Program program(policy);
    std::vector<float> memory(program.memory_size);
    const auto output = program.run(policy.golden.observation, memory);
    policy.golden.output.assign(output.begin(), output.end());
}

/// With random weights about as large as an initialiser's.
inline PolicyFile sample_policy(const PolicyNetwork& network, std::uint32_t seed = 1) {
    PolicyFile policy{.info = sample_info(network), .network = network, .weights = {}, .golden = {}};
    std::mt19937 random(seed);
    for (const auto& [name, type, shape] : parameters_of(network)) {
        std::int64_t count = 1;
        for (const auto size : shape) count *= size;
        const float bound = 1.5f / std::sqrt(static_cast<float>(count / shape.front()));
        std::uniform_real_distribution<float> uniform(-bound, bound);
        auto& numbers = policy.weights[name];
        for (std::int64_t i = 0; i < count; ++i) numbers.push_back(uniform(random));
    }
    set_golden(policy);
    return policy;
}

inline std::vector<std::uint8_t> random_pixels(std::size_t count, std::uint32_t seed) {
    std::mt19937 random(seed);
    std::vector<std::uint8_t> pixels(count);
    for (auto& pixel : pixels) pixel = static_cast<std::uint8_t>(random() >> 24);
    return pixels;
}

/// The text of the std::exception that `action` throws; "no error" if it throws none.
template <class Action>
std::string message_of(Action&& action) {
    try {
        action();
    } catch (const std::exception& error) {
        return error.what();
    }
    return "no error";
}

}  // namespace cale::test
