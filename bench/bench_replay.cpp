// The replay at Atari's size: storing a step, and gathering a batch, out of 70 MB, 700 MB and 7 GB
// of frames, by chance and by priority.
#include <array>
#include <cstdint>
#include <random>
#include <vector>

#include <benchmark/benchmark.h>

#include "replay/replay_buffer.h"

namespace {

using namespace cale;

// A full buffer of frames that differ.
ReplayBuffer full_replay(std::int64_t capacity, bool prioritised = false) {
    ReplayConfig config;
    config.capacity = capacity;
    config.prioritised = prioritised;
    ReplayBuffer replay(config);
    std::vector<std::uint8_t> frame(84 * 84);
    const std::array<float, 3> action{0.5f, 0, 0.5f};
    for (std::uint32_t t = 0; replay.size() < capacity; ++t) {
        std::fill(frame.begin(), frame.end(), static_cast<std::uint8_t>(t));
        replay.add(0, {.frame = frame, .action = action, .reward = 1, .terminal = t % 1000 == 999});
    }
    return replay;
}

void add(benchmark::State& state) {
    ReplayBuffer replay = full_replay(state.range(0));
    const std::vector<std::uint8_t> frame(84 * 84, 7);
    const std::array<float, 3> action{0.5f, 0, 0.5f};
    for (auto _ : state) replay.add(0, {.frame = frame, .action = action, .reward = 1});
    state.SetItemsProcessed(state.iterations());
}
BENCHMARK(add)->ArgName("stored")->Arg(10'000)->Arg(100'000)->Arg(1'000'000);

void sample(benchmark::State& state) {
    const ReplayBuffer replay = full_replay(state.range(0));
    std::mt19937_64 random(1);
    Batch batch = replay.empty_batch(state.range(1));
    for (auto _ : state) replay.sample_into(batch, random);
    state.SetItemsProcessed(state.iterations() * state.range(1));
    state.SetBytesProcessed(state.iterations() *
                            (batch.observation.numel() + batch.next_observation.numel()));
}
BENCHMARK(sample)
    ->ArgNames({"stored", "batch"})
    ->Args({10'000, 32})
    ->Args({100'000, 32})
    ->Args({1'000'000, 32});

/// Sampling 32 by priority and giving them new ones, as an update of DER does.
void sample_by_priority(benchmark::State& state) {
    ReplayBuffer replay = full_replay(state.range(0), /*prioritised=*/true);
    std::mt19937_64 random(1);
    Batch batch = replay.empty_batch(32);
    for (auto _ : state) {
        replay.sample_into(batch, random);
        replay.set_priorities(batch.index, batch.probability);
    }
    state.SetItemsProcessed(state.iterations() * 32);
}
BENCHMARK(sample_by_priority)->ArgName("stored")->Arg(10'000)->Arg(100'000)->Arg(1'000'000);

}  // namespace
