// Milliseconds per gradient step of every agent, on 84x84 frames and the batch of its configuration:
//   bench_update --benchmark_filter=sac_phi_sac
// The number of threads is the benchmark's argument. NAME_bf16 is the same update with train.precision=bf16,
// for processors that have it.
#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/types.h>

#include "agents/process.h"
#include "bench/updates.h"

namespace {

using cale::Precision;

void measure(benchmark::State& state, const bench::NamedUpdate& named, Precision precision) {
    at::set_num_threads(static_cast<int>(state.range(0)));
    const auto update = named.make(precision);
    for (int warm_up = 0; warm_up < 3; ++warm_up) update();
    for (auto _ : state) update();
}

}  // namespace

int main(int argc, char** argv) {
    cale::prepare_process_for_training();
    for (const auto& named : bench::updates()) {
        for (const auto precision : {Precision::float32, Precision::bf16}) {
            const auto name = named.name + (precision == Precision::bf16 ? "_bf16" : "");
            benchmark::RegisterBenchmark(name.c_str(),
                                         [=](benchmark::State& state) { measure(state, named, precision); })
                ->Arg(1)
                ->Arg(2)
                ->Unit(benchmark::kMillisecond)
                ->UseRealTime();
        }
    }
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
