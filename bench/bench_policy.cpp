// Milliseconds per decision on one observation, on one core: LibTorch (cale::Policy) and cale::lite::Policy
// with the same weights.
//   bench_policy --benchmark_filter=phi_sac
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>

#include "policy/encoder_layers.h"
#include "policy/inference_plan.h"
#include "policy/policy_file.h"
#include "policy/policy_lite.h"
#include "policy/torch/policy.h"

namespace {

using namespace cale;

/// SAC's network with random weights; DQN's where the encoder is phi_dqn.
std::string policy_contents(const std::string& encoder) {
    PolicyFile policy;
    auto& info = policy.info;
    auto& network = policy.network;
    info.action_space = "continuous";
    const auto hidden = hidden_layers(1, 512, Layer::Kind::relu);
    if (encoder == "phi_dqn") {
        network.layers = chain({prefixed("encoder.", phi_dqn()), prefixed("head.", hidden)});
        network.head = {.kind = Head::Kind::values, .num_actions = 4};
        info.action_space = "minimal";
        info.actions = {Event::noop, Event::fire, Event::right, Event::left};
    } else {
        const bool sac = encoder == "phi_sac";
        network.layers =
            chain({prefixed("encoder.", sac ? phi_sac() : impala()),
                   prefixed("encoder.", sac ? tanh_branch("actor") : relu_branch("actor", false)),
                   prefixed("actor.", hidden)});
    }
    std::mt19937 random(1);
    for (const auto& [name, shape] : parameter_shapes(network)) {
        std::size_t count = 1;
        for (const auto size : shape) count *= static_cast<std::size_t>(size);
        const float bound =
            1.7f / std::sqrt(static_cast<float>(count / static_cast<std::size_t>(shape.front())));
        std::uniform_real_distribution<float> uniform(-bound, bound);
        auto& weights = policy.weights[name];
        weights.resize(count);
        for (auto& number : weights) number = uniform(random);
    }
    set_golden_pair(policy);
    return policy_file_contents(policy);
}

void libtorch(benchmark::State& state, const std::string& encoder) {
    const auto policy = Policy::parse(policy_contents(encoder));
    const auto observation = golden_observation(policy.info());
    for (auto _ : state) benchmark::DoNotOptimize(policy.act(observation));
}

void lite_policy(benchmark::State& state, const std::string& encoder) {
    const auto policy = lite::Policy::parse(policy_contents(encoder));
    auto workspace = policy.workspace();
    const auto observation = golden_observation(policy.info());
    for (auto _ : state) benchmark::DoNotOptimize(policy.act(observation, workspace));
    state.SetLabel(std::string(lite::instruction_set()));
}

}  // namespace

int main(int argc, char** argv) {
    at::set_num_threads(1);
    for (const std::string encoder : {"phi_sac", "phi_dqn", "impala"}) {
        const auto add = [&](const char* who, auto function) {
            benchmark::RegisterBenchmark((encoder + "/" + who).c_str(), function, encoder)
                ->Unit(benchmark::kMillisecond)
                ->UseRealTime();
        };
        add("libtorch", libtorch);
        add("lite", lite_policy);
    }
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
