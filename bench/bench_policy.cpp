// Milliseconds per decision on one observation, on one core: LibTorch (cale::Policy) and cale::lite::Policy
// with the same weights.
//   bench_policy --benchmark_filter=phi_sac
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>

#include "policy/policy_file.h"
#include "policy/policy_lite.h"
#include "policy/program.h"
#include "policy/torch/policy.h"

namespace {

using namespace cale;
using Encoder = PolicyNetwork::Encoder;

/// SAC's network with random weights; DQN's where the encoder is phi_dqn.
std::string policy_contents(Encoder encoder) {
    PolicyFile policy;
    auto& [info, network, weights, golden] = policy;
    network.encoder = encoder;
    info.action_space = "continuous";
    if (encoder == Encoder::phi_dqn) {
        network.branch = PolicyNetwork::Branch::none;
        network.head = PolicyNetwork::Head::values;
        network.num_actions = 4;
        info.action_space = "minimal";
        info.actions = {Event::noop, Event::fire, Event::right, Event::left};
    }
    std::mt19937 random(1);
    for (const auto& [name, type, shape] : parameters_of(network)) {
        std::size_t count = 1;
        for (const auto size : shape) count *= static_cast<std::size_t>(size);
        const float bound =
            1.7f / std::sqrt(static_cast<float>(count / static_cast<std::size_t>(shape.front())));
        std::uniform_real_distribution<float> uniform(-bound, bound);
        weights[name].resize(count);
        for (auto& number : weights[name]) number = uniform(random);
    }
    golden.observation = golden_observation(info);
    const lite::Program program(policy);
    lite::Floats memory(program.memory_size);
    const auto output = program.run(golden.observation, memory);
    golden.output.assign(output.begin(), output.end());
    return policy_file_contents(policy);
}

void libtorch(benchmark::State& state, Encoder encoder) {
    const auto policy = Policy::parse(policy_contents(encoder));
    const auto observation = golden_observation(policy.info());
    for (auto _ : state) benchmark::DoNotOptimize(policy.act(observation));
}

void lite_policy(benchmark::State& state, Encoder encoder) {
    const auto policy = lite::Policy::parse(policy_contents(encoder));
    auto workspace = policy.workspace();
    const auto observation = golden_observation(policy.info());
    for (auto _ : state) benchmark::DoNotOptimize(policy.act(observation, workspace));
    state.SetLabel(std::string(lite::instruction_set()));
}

}  // namespace

int main(int argc, char** argv) {
    at::set_num_threads(1);
    for (const auto& [name, encoder] : {std::pair{"phi_sac", Encoder::phi_sac},
                                        {"phi_dqn", Encoder::phi_dqn},
                                        {"impala", Encoder::impala}}) {
        const auto add = [&, encoder = encoder](const char* who, auto function) {
            benchmark::RegisterBenchmark((std::string(name) + "/" + who).c_str(), function, encoder)
                ->Unit(benchmark::kMillisecond)
                ->UseRealTime();
        };
        add("libtorch", libtorch);
        add("lite", lite_policy);
    }
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
