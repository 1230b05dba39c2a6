#include "bench/updates.h"

#include <cstdint>
#include <memory>
#include <utility>

#include <torch/types.h>

#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/random.h"
#include "agents/sac.h"
#include "agents/sacd.h"

namespace bench {
namespace {

using namespace cale;

constexpr std::int64_t kActions = 18;

Batch make_batch(std::int64_t size, bool continuous) {
    Batch batch;
    batch.observation = torch::randint(0, 256, {size, 4, 84, 84}, torch::kUInt8);
    batch.next_observation = torch::randint(0, 256, {size, 4, 84, 84}, torch::kUInt8);
    batch.action = continuous ? torch::rand({size, 3}) : torch::randint(0, kActions, {size}, torch::kInt64);
    batch.n_step_return = torch::randn({size});
    batch.discount = torch::full({size}, 0.99);
    return batch;
}

Update sac(EncoderKind encoder, Precision precision) {
    SacConfig config;
    config.network.encoder = encoder;
    const auto network = [&] {
        return SacNetwork(config.network.encoder_for({.precision = precision}), config.network.head(),
                          make_generator(1));
    };
    const auto learner = std::make_shared<ActorCriticState<SacNetwork>>(
        network(), network(), torch::zeros({1}).requires_grad_(), AdamConfig{});
    const auto size = config.replay.batch_size;
    return [=, batch = make_batch(size, true),
            noise = SacNoise{torch::randn({size, 3}), torch::randn({size, 3})}] {
        sac_update(*learner, batch, noise, config);
    };
}

Update sacd(EncoderKind encoder, Precision precision) {
    SacdConfig config;
    config.network.encoder = encoder;
    const auto network = [&] {
        return SacdNetwork(config.network.encoder_for({.precision = precision}), config.network.head(),
                           kActions, make_generator(1));
    };
    const auto learner = std::make_shared<ActorCriticState<SacdNetwork>>(
        network(), network(), torch::zeros({1}).requires_grad_(), AdamConfig{});
    return
        [=, batch = make_batch(config.replay.batch_size, false)] { sacd_update(*learner, batch, 2, config); };
}

/// `nature`: convolutions without padding, as Mnih et al. and the PyTorch peers have them; 58 % of the
/// multiplications.
QState q_learner(const QHeadConfig& head, bool nature, Precision precision) {
    const auto network = [&] {
        return QNetwork(EncoderConfig{.encoder = EncoderKind::phi_dqn,
                                      .padding = nature ? Padding::valid : Padding::same,
                                      .precision = precision},
                        head, make_generator(1));
    };
    return {network(), network(), AdamConfig{}};
}

Update dqn(bool nature, Precision precision) {
    const DqnConfig config;
    const auto learner = std::make_shared<QState>(q_learner({.num_actions = kActions}, nature, precision));
    return [=, batch = make_batch(config.replay.batch_size, false)] { dqn_update(*learner, batch, config); };
}

Update der(bool nature, Precision precision) {
    const DerConfig config;
    const auto learner = std::make_shared<QState>(
        q_learner({.num_actions = kActions, .num_atoms = config.num_atoms, .dueling = true, .noisy = true},
                  nature, precision));
    auto random = make_generator(1);
    const auto& head = learner->network->head;
    return [=, batch = make_batch(config.replay.batch_size, false),
            weights = torch::ones({config.replay.batch_size}),
            noise = DerNoise{head->draw_noise(random), head->draw_noise(random)}] {
        der_update(*learner, batch, weights, noise, config);
    };
}

Update ppo(PpoNetworkConfig network_config, Precision precision) {
    const PpoConfig config;
    network_config.encoder.precision = precision;
    PpoNetwork network(network_config, 0, make_generator(1));
    const auto learner = std::make_shared<OnPolicyState>(network, 0, config);
    const auto size = config.minibatch_size;
    const RolloutBatch minibatch{.observation = torch::randint(0, 256, {size, 4, 84, 84}, torch::kUInt8),
                                 .action = torch::rand({size, 3}),
                                 .old_log_prob = torch::randn({size}),
                                 .old_value = torch::randn({size}),
                                 .advantage = torch::randn({size}),
                                 .returns = torch::randn({size})};
    return [=] { ppo_update(*learner, minibatch, config); };
}

}  // namespace

std::vector<NamedUpdate> updates() {
    std::vector<NamedUpdate> all;
    for (const auto encoder : {EncoderKind::phi_sac, EncoderKind::phi_dqn, EncoderKind::impala,
                               EncoderKind::compact, EncoderKind::data_efficient}) {
        all.push_back({"sac_" + std::string(names_of(encoder)[static_cast<std::size_t>(encoder)]),
                       [=](Precision precision) { return sac(encoder, precision); }});
    }
    all.push_back(
        {"sacd_phi_dqn", [](Precision precision) { return sacd(EncoderKind::phi_dqn, precision); }});
    for (const bool nature : {false, true}) {
        const std::string suffix = nature ? "_nature" : "";
        all.push_back({"dqn" + suffix, [=](Precision precision) { return dqn(nature, precision); }});
        all.push_back({"der" + suffix, [=](Precision precision) { return der(nature, precision); }});
    }
    for (const auto& [name, network] : {
             std::pair{"phi_sac", PpoNetworkConfig{.encoder = {.encoder = EncoderKind::phi_sac}}},
             std::pair{"phi_dqn", PpoNetworkConfig{.encoder = {.encoder = EncoderKind::phi_dqn}}},
             // One torso, without padding: configs/ppo/discrete.yaml, and what the PyTorch peers have.
             std::pair{"nature", PpoNetworkConfig{.encoder = {.encoder = EncoderKind::phi_dqn,
                                                             .padding = Padding::valid},
                                 .torso = Torso::shared,
                                 .hidden_layers = 0}},
         }) {
        all.push_back({std::string("ppo_") + name + "_minibatch",
                       [network = network](Precision precision) { return ppo(network, precision); }});
    }
    return all;
}

}  // namespace bench
