// Milliseconds per batch of decisions on one core: LibTorch (cale::Policy) and cale::lite::Policy with the
// same weights. Before the first of them the policies can be written as ONNX models, for other runtimes:
//   bench_policy --benchmark_filter=phi_sac/lite/8 [--onnx=FOLDER]
#include <algorithm>
#include <cmath>
#include <fstream>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include <ATen/Parallel.h>
#include <benchmark/benchmark.h>
#include <torch/types.h>

#include "policy/encoder_layers.h"
#include "policy/inference_plan.h"
#include "policy/network_parameters.h"
#include "policy/onnx/onnx.h"
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
    info.agent = encoder == "phi_dqn" ? "dqn" : "sac";
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

std::vector<std::uint8_t> observations(const PolicyInfo& info, std::int64_t count) {
    const auto one = golden_observation(info);
    std::vector<std::uint8_t> all;
    for (std::int64_t i = 0; i < count; ++i) all.insert(all.end(), one.begin(), one.end());
    return all;
}

void libtorch(benchmark::State& state, const std::string& encoder) {
    const auto policy = Policy::parse(policy_contents(encoder));
    auto bytes = observations(policy.info(), state.range(0));
    const auto batch = torch::from_blob(bytes.data(), {state.range(0), 4, 84, 84}, torch::kUInt8);
    for (auto _ : state) benchmark::DoNotOptimize(policy.act(batch));
}

void lite_policy(benchmark::State& state, const std::string& encoder) {
    const auto policy = lite::Policy::parse(policy_contents(encoder));
    const auto count = static_cast<std::size_t>(state.range(0));
    auto workspace = policy.workspace(std::min<std::size_t>(count, 8));
    const auto bytes = observations(policy.info(), state.range(0));
    std::vector<Decision> decisions(count);
    for (auto _ : state) {
        policy.act(bytes, decisions, workspace);
        benchmark::DoNotOptimize(decisions.data());
    }
    state.SetLabel(std::string(lite::instruction_set()));
}

}  // namespace

int main(int argc, char** argv) {
    at::set_num_threads(1);
    constexpr std::string_view kFlag = "--onnx=";
    const bool writes = argc > 1 && std::string_view(argv[argc - 1]).starts_with(kFlag);
    const std::string folder = writes ? argv[--argc] + kFlag.size() : "";
    for (const std::string encoder : {"phi_sac", "phi_dqn", "impala"}) {
        if (writes)
            std::ofstream(folder + "/" + encoder + ".onnx")
                << onnx_model(parse_policy_file(policy_contents(encoder)));
        const auto add = [&](const char* who, auto function) {
            benchmark::RegisterBenchmark((encoder + "/" + who).c_str(), function, encoder)
                ->Arg(1)
                ->Arg(8)
                ->Arg(64)
                ->Unit(benchmark::kMillisecond)
                ->UseRealTime();
        };
        add("libtorch", libtorch);
        add("lite", lite_policy);
    }
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
}
