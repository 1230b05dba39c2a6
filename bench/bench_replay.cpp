// The replay at Atari's size: storing a step, and gathering a batch, out of 70 MB and out
// of 700 MB of frames.
#include <array>
#include <cstdint>
#include <random>
#include <vector>

#include <benchmark/benchmark.h>

#include "replay/replay_buffer.h"

namespace {

using namespace cale;

// A full buffer of frames that differ.
ReplayBuffer full_replay(std::int64_t capacity) {
    ReplayConfig config;
    config.capacity = capacity;
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
BENCHMARK(add)->Arg(10'000)->Arg(100'000);

void sample(benchmark::State& state) {
    const ReplayBuffer replay = full_replay(state.range(0));
    std::mt19937_64 random(1);
    Batch batch = replay.empty_batch(state.range(1));
    for (auto _ : state) replay.sample_into(batch, random);
    state.SetItemsProcessed(state.iterations() * state.range(1));
    state.SetBytesProcessed(state.iterations() *
                            (batch.observation.numel() + batch.next_observation.numel()));
}
BENCHMARK(sample)->ArgNames({"stored", "batch"})->Args({10'000, 32})->Args({100'000, 32});

}  // namespace
