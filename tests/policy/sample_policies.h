// Policies of every kind, small and untrained, made without LibTorch.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "cale/joystick.h"
#include "policy/encoder_layers.h"
#include "policy/inference_plan.h"
#include "policy/network_parameters.h"
#include "policy/policy_file.h"

namespace cale::test {

struct SampleNetwork {
    std::string name;
    NetworkSpec network;
};

/// Two frames of 21 x 18 pixels.
inline const std::vector<std::int64_t> kSmallFrames{2, 21, 18};
inline constexpr std::int64_t kSmallUnits = 20, kSmallActions = 5;

/// An actor behind this encoder, and behind what follows it.
inline NetworkSpec actor(const Layers& encoder, const Layers& branch,
                         Head::Kind head = Head::Kind::squashed_gaussian, std::int64_t hidden = 1,
                         Layer::Kind activation = Layer::Kind::relu) {
    const Head acting{.kind = head};
    return {kSmallFrames,
            chain({prefixed("encoder.", encoder), prefixed("encoder.", branch),
                   prefixed("actor.", hidden_layers(hidden, kSmallUnits, activation))}),
            {.kind = head, .num_actions = acting.continuous() ? 0 : kSmallActions}};
}

/// Action values behind this encoder.
inline NetworkSpec action_values(const Layers& encoder, bool dueling = false, std::int64_t atoms = 1) {
    return {kSmallFrames,
            chain({prefixed("encoder.", encoder),
                   prefixed("head.", hidden_layers(1, kSmallUnits, Layer::Kind::relu))}),
            {Head::Kind::values, kSmallActions, dueling, atoms}};
}

inline NetworkSpec with_observation(std::vector<std::int64_t> observation, NetworkSpec network) {
    network.observation = std::move(observation);
    return network;
}

/// An actor with another number of coordinates.
inline NetworkSpec along_axes(std::int64_t axes, NetworkSpec network) {
    network.head.axes = axes;
    return network;
}

inline NetworkSpec with_actions(std::int64_t count, NetworkSpec network) {
    network.head.num_actions = count;
    return network;
}

/// The same with noisy layers behind the encoder.
inline NetworkSpec noisy(NetworkSpec network) {
    for (auto& layer : network.layers)
        if (layer.kind == Layer::Kind::dense) layer.noisy = layer.name.starts_with("head.");
    network.head.noisy = true;
    return network;
}

/// Eighteen actions, each a choice among three, three and two.
inline NetworkSpec factored(NetworkSpec network) {
    network.head.factors = {3, 3, 2};
    return with_actions(18, std::move(network));
}

/// Layers in every order that readers have to care about: residual blocks of several kinds, numbers of
/// channels that fill no vector, a norm behind an image.
inline NetworkSpec mixture() {
    using Kind = Layer::Kind;
    const auto of = [](Kind kind) { return Layer::of(kind); };
    return with_observation({3, 20, 25}, {.layers = {Layer::conv("encoder.patches", 6, 4, 4, Padding::valid),
                                                     of(Kind::relu),
                                                     of(Kind::keep),
                                                     Layer::conv("encoder.mix", 6, 3, 1),
                                                     of(Kind::relu),
                                                     of(Kind::add_kept),
                                                     of(Kind::keep),
                                                     Layer::conv("encoder.direct", 6, 5, 1),
                                                     of(Kind::add_kept),
                                                     of(Kind::tanh),
                                                     of(Kind::keep),
                                                     of(Kind::relu),
                                                     of(Kind::add_kept),
                                                     Layer::conv("encoder.rows", 16, 3, 2, {}, true),
                                                     Layer::max_pool(2, 2),
                                                     Layer::conv("encoder.last", 5, 3, 1),
                                                     of(Kind::flatten),
                                                     Layer::layer_norm("encoder.norm"),
                                                     Layer::dense("actor.fc1", 12),
                                                     of(Kind::keep),
                                                     of(Kind::relu),
                                                     Layer::dense("actor.fc2", 12),
                                                     of(Kind::add_kept),
                                                     of(Kind::keep),
                                                     Layer::layer_norm("actor.norm"),
                                                     of(Kind::tanh),
                                                     of(Kind::add_kept)},
                                          .head = {Head::Kind::categorical, kSmallActions}});
}

/// Every encoder, branch and head that an agent has, and what they can be combined with.
inline std::vector<SampleNetwork> sample_networks() {
    const auto tanh_actor = tanh_branch("actor"), relu_actor = relu_branch("actor", false);
    const Layers shared{Layer::dense("fc", 512), Layer::of(Layer::Kind::relu)};
    constexpr auto tanh = Layer::Kind::tanh;
    using enum Head::Kind;
    return {{"sac", actor(phi_sac(), tanh_actor)},
            {"sac_dqn", actor(phi_dqn(), relu_actor)},
            {"sac_rows", actor(phi_dqn(Padding::same, true), relu_actor)},
            {"sac_impala", actor(impala(), relu_actor)},
            {"sac_mlp", actor(mlp(), relu_actor)},
            {"sacd", actor(phi_sac(), tanh_actor, categorical)},
            {"deep", actor(phi_sac(), tanh_actor, squashed_gaussian, 3)},
            {"flat", actor(phi_sac(), tanh_actor, squashed_gaussian, 0)},
            {"bare", actor(phi_sac(), {}, squashed_gaussian, 0)},
            {"ppo", actor(phi_sac(), tanh_actor, gaussian, 2, tanh)},
            {"ppo_discrete", actor(phi_sac(), tanh_actor, categorical, 2, tanh)},
            {"ppo_shared", actor(phi_sac(Padding::valid), shared, gaussian, 2, tanh)},
            {"ppo_ram", with_observation({4, 128}, actor(mlp(), relu_actor, gaussian, 2, tanh))},
            {"dqn", action_values(phi_dqn())},
            {"dqn_ram", with_observation({4, 128}, action_values(mlp()))},
            {"dueling", action_values(phi_dqn(), true)},
            {"der", action_values(phi_dqn(), true, 51)},
            {"der_impala", action_values(impala(), true, 51)},
            {"sac_ram",
             with_observation({2, 128}, actor(cale::flat(), {}, squashed_gaussian, 2, Layer::Kind::relu))},
            {"sac_compact", with_observation({2, 40, 33}, actor(compact(), tanh_actor))},
            {"sac_phi_dqn_2013", with_observation({2, 40, 33}, actor(phi_dqn_2013(), tanh_actor))},
            {"der_data_efficient", with_observation({2, 40, 33}, action_values(data_efficient(), true, 51))},
            {"sac_direction", along_axes(4, actor(phi_sac(), tanh_actor))},
            {"sac_paddle", along_axes(2, actor(phi_sac(), tanh_actor))},
            {"rainbow_factored",
             with_observation({4, 128}, with_actions(18, action_values(mlp(true), true, 51)))},
            {"noisy", noisy(action_values(phi_dqn()))},
            {"noisy_ram", noisy(with_observation({2, 16}, action_values(cale::flat(), true, 11)))},
            {"noisy_factored", noisy(with_observation({4, 128}, factored(action_values(mlp(true)))))},
            {"dueling_factored", factored(action_values(phi_sac(), true, 51))},
            {"mixture", mixture()}};
}

/// What it needs beside its weights. Two coordinates are those of `paddle`, four those of `direction`,
/// eighteen actions those of `factored`.
inline PolicyInfo sample_info(const NetworkSpec& network) {
    PolicyInfo info;
    info.game = "Breakout";
    info.agent = "sac";
    info.action_space = network.head.continuous() ? "continuous" : "minimal";
    for (std::int64_t i = 0; i < network.head.num_actions; ++i) info.actions.push_back(static_cast<Event>(i));
    if (network.head.continuous() && network.head.axes == 2) info.joystick = Joystick::paddle;
    if (network.head.continuous() && network.head.axes == 4) info.joystick = Joystick::direction;
    if (network.head.num_actions == kEventCount) {
        info.action_space = "continuous";
        info.joystick = Joystick::factored;
        info.actions.assign(factored_events().begin(), factored_events().end());
    }
    info.encoder = "phi_sac";
    set_observation(info, network.observation);
    info.evaluation_samples = is_noisy(network);
    info.epsilon = 0.25;
    info.provenance = {{"seed", "7"}, {"config", "env:\n  game: breakout\n"}};
    return info;
}

/// With random weights about as large as an initialiser's.
inline PolicyFile sample_policy(const NetworkSpec& network, std::uint32_t seed = 1) {
    PolicyFile policy{.info = sample_info(network), .network = network, .weights = {}, .golden = {}};
    std::mt19937 random(seed);
    for (const auto& [name, shape] : parameter_shapes(network)) {
        std::int64_t count = 1;
        for (const auto size : shape) count *= size;
        const float bound = 1.5f / std::sqrt(static_cast<float>(count / shape.front()));
        std::uniform_real_distribution<float> uniform(-bound, bound);
        auto& numbers = policy.weights[name];
        for (std::int64_t i = 0; i < count; ++i) numbers.push_back(uniform(random));
    }
    set_golden_pair(policy);
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
