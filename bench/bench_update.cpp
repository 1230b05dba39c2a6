// Milliseconds per gradient step of every agent, on 84x84 frames and the batch of its configuration:
//   bench_update --benchmark_filter=sac_phi_sac
// The number of threads is the benchmark's argument.
#include <functional>
#include <memory>

#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/types.h>

#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/random.h"
#include "agents/sac.h"
#include "agents/sacd.h"

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

/// Makes an update that can be repeated.
using Update = std::function<void()>;

Update sac(EncoderKind encoder) {
    SacConfig config;
    config.network.encoder = encoder;
    const auto network = [&] {
        return SacNetwork(config.network.encoder_for({}), config.network.head(), make_generator(1));
    };
    const auto learner = std::make_shared<ActorCriticState<SacNetwork>>(
        network(), network(), torch::zeros({1}).requires_grad_(), AdamConfig{});
    const auto size = config.replay.batch_size;
    return [=, batch = make_batch(size, true),
            noise = SacNoise{torch::randn({size, 3}), torch::randn({size, 3})}] {
        sac_update(*learner, batch, noise, config);
    };
}

Update sacd(EncoderKind encoder) {
    SacdConfig config;
    config.network.encoder = encoder;
    const auto network = [&] {
        return SacdNetwork(config.network.encoder_for({}), config.network.head(), kActions,
                           make_generator(1));
    };
    const auto learner = std::make_shared<ActorCriticState<SacdNetwork>>(
        network(), network(), torch::zeros({1}).requires_grad_(), AdamConfig{});
    return
        [=, batch = make_batch(config.replay.batch_size, false)] { sacd_update(*learner, batch, 2, config); };
}

/// `nature`: convolutions without padding, as Mnih et al. and the PyTorch peers have them; 58 % of the
/// multiplications.
QState q_learner(const QHeadConfig& head, bool nature) {
    const auto network = [&] {
        return QNetwork(EncoderConfig{.encoder = EncoderKind::phi_dqn,
                                      .padding = nature ? Padding::valid : Padding::same},
                        head, make_generator(1));
    };
    return {network(), network(), AdamConfig{}};
}

Update dqn(bool nature) {
    const DqnConfig config;
    const auto learner = std::make_shared<QState>(q_learner({.num_actions = kActions}, nature));
    return [=, batch = make_batch(config.replay.batch_size, false)] { dqn_update(*learner, batch, config); };
}

Update der(bool nature) {
    const DerConfig config;
    const auto learner = std::make_shared<QState>(q_learner(
        {.num_actions = kActions, .num_atoms = config.num_atoms, .dueling = true, .noisy = true}, nature));
    auto random = make_generator(1);
    const auto& head = learner->network->head;
    return [=, batch = make_batch(config.replay.batch_size, false),
            weights = torch::ones({config.replay.batch_size}),
            noise = DerNoise{head->draw_noise(random), head->draw_noise(random)}] {
        der_update(*learner, batch, weights, noise, config);
    };
}

Update ppo(const PpoNetworkConfig& network_config) {
    const PpoConfig config;
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

void measure(benchmark::State& state, const std::function<Update()>& make) {
    at::globalContext().setFlushDenormal(true);
    at::set_num_threads(static_cast<int>(state.range(0)));
    const auto update = make();
    for (int warm_up = 0; warm_up < 3; ++warm_up) update();
    for (auto _ : state) update();
}

void add(const char* name, const std::function<Update()>& make) {
    benchmark::RegisterBenchmark(name, [make](benchmark::State& state) { measure(state, make); })
        ->Arg(1)
        ->Arg(2)
        ->Unit(benchmark::kMillisecond)
        ->UseRealTime();
}

}  // namespace

int main(int argc, char** argv) {
    add("sac_phi_sac", [] { return sac(EncoderKind::phi_sac); });
    add("sac_phi_dqn", [] { return sac(EncoderKind::phi_dqn); });
    add("sac_impala", [] { return sac(EncoderKind::impala); });
    add("sacd_phi_dqn", [] { return sacd(EncoderKind::phi_dqn); });
    add("dqn", [] { return dqn(/*nature=*/false); });
    add("dqn_nature", [] { return dqn(/*nature=*/true); });
    add("der", [] { return der(/*nature=*/false); });
    add("der_nature", [] { return der(/*nature=*/true); });
    add("ppo_phi_sac_minibatch", [] { return ppo({.encoder = {.encoder = EncoderKind::phi_sac}}); });
    add("ppo_phi_dqn_minibatch", [] { return ppo({.encoder = {.encoder = EncoderKind::phi_dqn}}); });
    // One torso, without padding: configs/ppo/discrete.yaml, and what the PyTorch peers have.
    add("ppo_nature_minibatch", [] {
        return ppo({.encoder = {.encoder = EncoderKind::phi_dqn, .padding = Padding::valid},
                    .torso = Torso::shared,
                    .hidden_layers = 0});
    });
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
