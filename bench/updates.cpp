#include "bench/updates.h"

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <torch/types.h>

#include "agents/captured_update.h"
#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/random.h"
#include "agents/sac.h"
#include "agents/sacd.h"
#include "cale/fields.h"

namespace bench {
namespace {

using namespace cale;

constexpr std::int64_t kActions = 18;

/// Every call of the result launches `update` as training does: on a CUDA device as one graph, after the
/// first few.
Update launched(const Computation& how, Update update) {
    const auto step = std::make_shared<CapturedUpdate>(how.device, at::Generator());
    return [step, update = std::move(update)] { (*step)(update); };
}

template <class Network>
Network on_device(Network network, const Computation& how) {
    network->to(how.device);
    return network;
}

torch::Tensor make_observations(std::int64_t size, const Computation& how) {
    return torch::randint(0, 256, {size, 4, 84, 84}, torch::dtype(torch::kUInt8).device(how.device));
}

Batch make_batch(std::int64_t size, bool continuous, const Computation& how) {
    Batch batch;
    batch.observation = make_observations(size, how);
    batch.next_observation = make_observations(size, how);
    batch.action = continuous
                       ? torch::rand({size, 3}, how.device)
                       : torch::randint(0, kActions, {size}, torch::dtype(torch::kInt64).device(how.device));
    batch.n_step_return = torch::randn({size}, how.device);
    batch.discount = torch::full({size}, 0.99, how.device);
    return batch;
}

Update sac(EncoderKind encoder, const Computation& how) {
    SacConfig config;
    config.network.encoder = encoder;
    const auto network = [&] {
        return on_device(SacNetwork(config.network.encoder_for({.precision = how.precision}),
                                    config.network.head(), make_generator(1)),
                         how);
    };
    const auto learner = std::make_shared<ActorCriticState<SacNetwork>>(
        network(), network(), torch::zeros({1}, how.device).requires_grad_(), AdamConfig{});
    const auto size = config.replay.batch_size;
    const auto noise = [&] { return torch::randn({size, 3}, how.device); };
    return launched(how, [=, batch = make_batch(size, true, how), noise = SacNoise{noise(), noise()}] {
        sac_update(*learner, batch, noise, config);
    });
}

Update sacd(EncoderKind encoder, const Computation& how) {
    SacdConfig config;
    config.network.encoder = encoder;
    const auto network = [&] {
        return on_device(SacdNetwork(config.network.encoder_for({.precision = how.precision}),
                                     config.network.head(), kActions, make_generator(1)),
                         how);
    };
    const auto learner = std::make_shared<ActorCriticState<SacdNetwork>>(
        network(), network(), torch::zeros({1}, how.device).requires_grad_(), AdamConfig{});
    return launched(how, [=, batch = make_batch(config.replay.batch_size, false, how)] {
        sacd_update(*learner, batch, 2, config);
    });
}

/// `nature`: convolutions without padding, as Mnih et al. and the PyTorch peers have them; 58 % of the
/// multiplications.
QState q_learner(const QHeadConfig& head, bool nature, const Computation& how) {
    const auto network = [&] {
        return on_device(QNetwork(EncoderConfig{.encoder = EncoderKind::phi_dqn,
                                                .padding = nature ? Padding::valid : Padding::same,
                                                .precision = how.precision},
                                  head, make_generator(1)),
                         how);
    };
    return {network(), network(), AdamConfig{}};
}

Update dqn(bool nature, const Computation& how) {
    const DqnConfig config;
    const auto learner = std::make_shared<QState>(q_learner({.num_actions = kActions}, nature, how));
    return launched(how, [=, batch = make_batch(config.replay.batch_size, false, how)] {
        dqn_update(*learner, batch, config);
    });
}

Update der(bool nature, const Computation& how) {
    const DerConfig config;
    const auto learner = std::make_shared<QState>(
        q_learner({.num_actions = kActions, .num_atoms = config.num_atoms, .dueling = true, .noisy = true},
                  nature, how));
    auto random = make_generator(1);
    const auto& head = learner->network->head;
    const auto noise = [&] { return to(head->draw_noise(random), how.device); };
    return launched(
        how, [=, batch = make_batch(config.replay.batch_size, false, how),
              weights = torch::ones({config.replay.batch_size}, how.device),
              noise = DerNoise{noise(), noise()}] { der_update(*learner, batch, weights, noise, config); });
}

Update ppo(PpoNetworkConfig network_config, const Computation& how) {
    const PpoConfig config;
    network_config.encoder.precision = how.precision;
    const auto network = on_device(PpoNetwork(network_config, 0, make_generator(1)), how);
    const auto learner = std::make_shared<OnPolicyState>(network, 0, config);
    const auto size = config.minibatch_size;
    const auto numbers = [&] { return torch::randn({size}, how.device); };
    const RolloutBatch minibatch{.observation = make_observations(size, how),
                                 .action = torch::rand({size, 3}, how.device),
                                 .old_log_prob = numbers(),
                                 .old_value = numbers(),
                                 .advantage = numbers(),
                                 .returns = numbers()};
    return launched(how, [=] { ppo_update(*learner, minibatch, config); });
}

}  // namespace

std::vector<NamedUpdate> updates() {
    std::vector<NamedUpdate> all;
    for (const auto encoder :
         {EncoderKind::phi_sac, EncoderKind::phi_dqn, EncoderKind::impala, EncoderKind::compact,
          EncoderKind::data_efficient, EncoderKind::phi_dqn_2013}) {
        all.push_back({"sac_" + std::string(name_of(encoder)),
                       [=](const Computation& how) { return sac(encoder, how); }});
    }
    all.push_back({"sacd_phi_dqn", [](const Computation& how) { return sacd(EncoderKind::phi_dqn, how); }});
    for (const bool nature : {false, true}) {
        const std::string suffix = nature ? "_nature" : "";
        all.push_back({"dqn" + suffix, [=](const Computation& how) { return dqn(nature, how); }});
        all.push_back({"der" + suffix, [=](const Computation& how) { return der(nature, how); }});
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
                       [network = network](const Computation& how) { return ppo(network, how); }});
    }
    return all;
}

}  // namespace bench
