// Milliseconds per gradient step of every agent, on 84x84 frames and the batch of its configuration:
//   bench_update --benchmark_filter=sac_phi_sac
// The number of threads is the benchmark's argument.
#include <functional>
#include <memory>

#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/torch.h>

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

AgentSpec discrete_spec() {
    AgentSpec spec;
    spec.num_actions = kActions;
    return spec;
}

/// Makes an update that can be repeated.
using Update = std::function<void()>;

Update sac(EncoderKind encoder) {
    SacConfig config;
    config.network.encoder = encoder;
    const auto network = [&] {
        return SacNetwork(config.network.encoder_for({}), config.network.head(), make_generator(1));
    };
    const auto learner =
        std::make_shared<SacLearner>(network(), network(), torch::zeros({1}).requires_grad_(), AdamConfig{});
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
    const auto learner =
        std::make_shared<SacdLearner>(network(), network(), torch::zeros({1}).requires_grad_(), AdamConfig{});
    return
        [=, batch = make_batch(config.replay.batch_size, false)] { sacd_update(*learner, batch, 2, config); };
}

Update dqn() {
    const DqnConfig config;
    const auto learner = std::make_shared<QLearner>(
        make_q_learner(config.encoder, {.num_actions = kActions}, AdamConfig{}, discrete_spec(), 1));
    return [=, batch = make_batch(config.replay.batch_size, false)] { dqn_update(*learner, batch, config); };
}

Update der() {
    const DerConfig config;
    const auto learner = std::make_shared<QLearner>(make_q_learner(
        config.encoder,
        {.num_actions = kActions, .num_atoms = config.num_atoms, .dueling = true, .noisy = true},
        AdamConfig{}, discrete_spec(), 1));
    auto random = make_generator(1);
    const auto& head = learner->network->head;
    return [=, batch = make_batch(config.replay.batch_size, false),
            weights = torch::ones({config.replay.batch_size}),
            noise = DerNoise{head->draw_noise(random), head->draw_noise(random)}] {
        der_update(*learner, batch, weights, noise, config);
    };
}

Update ppo(EncoderKind encoder) {
    PpoConfig config;
    config.network.encoder = encoder;
    PpoNetwork network(PpoNetworkConfig{.encoder = config.network.encoder_for({})}, 0, make_generator(1));
    const auto learner = std::make_shared<PpoLearner>(network, 0, config);
    const auto size = config.minibatch_size;
    const PpoMinibatch minibatch{torch::randint(0, 256, {size, 4, 84, 84}, torch::kUInt8),
                                 torch::rand({size, 3}),
                                 torch::randn({size}),
                                 torch::randn({size}),
                                 torch::randn({size}),
                                 torch::randn({size})};
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
    add("dqn", [] { return dqn(); });
    add("der", [] { return der(); });
    add("ppo_phi_sac_minibatch", [] { return ppo(EncoderKind::phi_sac); });
    add("ppo_phi_dqn_minibatch", [] { return ppo(EncoderKind::phi_dqn); });
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
