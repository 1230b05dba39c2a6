// Milliseconds per gradient step of SAC, batch 32, 84x84:
//   bench_update --benchmark_filter=phi_sac
// The number of threads is the benchmark's argument.
#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/torch.h>

#include "agents/random.h"
#include "agents/sac.h"

namespace {

using namespace cale;

constexpr std::int64_t kBatch = 32;

SacLearner make_learner(const SacConfig& config) {
    const auto make_network = [&] {
        return SacNetwork(EncoderConfig{.encoder = config.network.encoder, .phi_dqn = config.network.phi_dqn},
                          config.network.head(), make_generator(1));
    };
    return {make_network(), make_network(), torch::zeros({1}).requires_grad_(), {}};
}

Batch make_batch() {
    Batch batch;
    batch.observation = torch::randint(0, 256, {kBatch, 4, 84, 84}, torch::kUInt8);
    batch.next_observation = torch::randint(0, 256, {kBatch, 4, 84, 84}, torch::kUInt8);
    batch.action = torch::rand({kBatch, 3});
    batch.n_step_return = torch::randn({kBatch});
    batch.discount = torch::full({kBatch}, 0.99);
    return batch;
}

void sac_update(benchmark::State& state, EncoderKind encoder, PhiDqn phi_dqn) {
    at::set_num_threads(static_cast<int>(state.range(0)));
    SacConfig config;
    config.network.encoder = encoder;
    config.network.phi_dqn = phi_dqn;
    auto learner = make_learner(config);
    const auto batch = make_batch();
    const SacNoise noise{torch::randn({kBatch, 3}), torch::randn({kBatch, 3})};
    for (int warm_up = 0; warm_up < 3; ++warm_up) cale::sac_update(learner, batch, noise, config);
    for (auto _ : state) benchmark::DoNotOptimize(cale::sac_update(learner, batch, noise, config).critic);
}

BENCHMARK_CAPTURE(sac_update, phi_sac, EncoderKind::phi_sac, PhiDqn::conv2d)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(sac_update, phi_dqn, EncoderKind::phi_dqn, PhiDqn::conv2d)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(sac_update, impala, EncoderKind::impala, PhiDqn::conv2d)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
