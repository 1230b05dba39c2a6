// Milliseconds per gradient step of every agent, on 84x84 frames and the batch of its configuration:
//   bench_update --benchmark_filter=sac_phi_sac
// On the CPU the number of threads is the benchmark's argument. NAME_bf16 is the same update with
// train.precision=bf16, for processors that have it; NAME_cuda is the update on the first CUDA device, if
// there is one, timed until its result is there.
#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/cuda.h>
#include <torch/types.h>

#include "agents/process.h"
#include "bench/updates.h"

namespace {

using cale::Precision;

void measure(benchmark::State& state, const bench::NamedUpdate& named, const bench::Computation& how) {
    if (how.device.is_cpu()) at::set_num_threads(static_cast<int>(state.range(0)));
    const auto finish = [&] {
        if (how.device.is_cuda()) torch::cuda::synchronize();
    };
    const auto update = named.make(how);
    const int warm_ups = how.device.is_cpu() ? 3 : 6;  // a CUDA graph is recorded in the fourth
    for (int i = 0; i < warm_ups; ++i) update();
    finish();
    for (auto _ : state) {
        update();
        finish();
    }
}

void add(const bench::NamedUpdate& named, const bench::Computation& how) {
    const auto name = named.name + (how.precision == Precision::bf16 ? "_bf16" : "") +
                      (how.device.is_cuda() ? "_cuda" : "");
    auto* const added = benchmark::RegisterBenchmark(
        name.c_str(), [=](benchmark::State& state) { measure(state, named, how); });
    if (how.device.is_cpu()) added->Arg(1)->Arg(2);
    added->Unit(benchmark::kMillisecond)->UseRealTime();
}

}  // namespace

int main(int argc, char** argv) {
    cale::prepare_process_for_training();
    for (const auto& named : bench::updates()) {
        for (const auto precision : {Precision::float32, Precision::bf16}) {
            add(named, {.precision = precision});
            if (torch::cuda::is_available()) add(named, {.precision = precision, .device = torch::kCUDA});
        }
    }
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
