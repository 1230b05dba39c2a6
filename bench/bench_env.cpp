// An agent step of one environment, and the parts of it that are ours:
//   bench_env --benchmark_filter=step
#include <array>
#include <cstdint>
#include <random>
#include <vector>

#include <benchmark/benchmark.h>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/frames.h"
#include "cale/games.h"

namespace {

using namespace cale;

constexpr std::array<const char*, 3> kGames{"pong", "seaquest", "ms_pacman"};

ContinuousAction random_action(std::mt19937& random) {
    std::uniform_real_distribution<float> unit(0, 1);
    return {unit(random), 3.14f * (2 * unit(random) - 1), unit(random)};
}

void step(benchmark::State& state) {
    Env env(protocol_200m(kGames.at(static_cast<std::size_t>(state.range(0)))), /*seed=*/1);
    state.SetLabel(kGames.at(static_cast<std::size_t>(state.range(0))));
    std::vector<std::uint8_t> frame(kFrameSize);
    std::mt19937 random(1);
    env.reset(frame);
    for (auto _ : state) {
        if (env.step(random_action(random), frame).episode_over) env.reset(frame);
    }
}
BENCHMARK(step)->DenseRange(0, kGames.size() - 1)->Unit(benchmark::kMicrosecond);

/// The screens of some seconds of play under random actions.
std::vector<std::vector<std::uint8_t>> screens_of(Emulator& emulator) {
    std::vector<std::vector<std::uint8_t>> screens;
    std::mt19937 random(1);
    emulator.reset();
    while (screens.size() < 512) {
        const auto event = joystick_event(random_action(random), 0.5f);
        for (int frame = 0; frame < 4; ++frame) {
            emulator.act(event, 1);
            if (frame >= 2) screens.emplace_back(emulator.screen().begin(), emulator.screen().end());
        }
        if (emulator.game_over()) emulator.reset();
    }
    return screens;
}

/// Two screens per iteration, of an even number that come again and again.
void preprocess_in_turn(benchmark::State& state, const Emulator& emulator,
                        const std::vector<std::vector<std::uint8_t>>& screens) {
    FramePipeline pipeline(emulator.screen_height(), emulator.gray_palette());
    pipeline.start(screens.front());
    std::vector<std::uint8_t> frame(kFrameSize);
    std::size_t next = 0;
    for (auto _ : state) {
        pipeline.set_first(screens[next]);
        pipeline.set_second(screens[next + 1]);
        pipeline.write(frame);
        next = (next + 2) % screens.size();
    }
}

/// All that follows the emulation: two screens taken in, the brighter in gray, 84x84.
void preprocess(benchmark::State& state) {
    const auto* game = kGames.at(static_cast<std::size_t>(state.range(0)));
    state.SetLabel(game);
    Emulator emulator(find_game(game), find_rom(game, ""), /*sticky_probability=*/0, /*seed=*/1);
    const auto screens = screens_of(emulator);
    preprocess_in_turn(state, emulator, screens);
}
BENCHMARK(preprocess)->DenseRange(0, kGames.size() - 1)->Unit(benchmark::kMicrosecond);

/// The same where every pixel of both screens changes every time.
void preprocess_noise(benchmark::State& state) {
    Emulator emulator(find_game("pong"), find_rom("pong", ""), /*sticky_probability=*/0, /*seed=*/1);
    std::mt19937 random(1);
    std::vector<std::vector<std::uint8_t>> screens(4);
    for (auto& screen : screens) {
        screen.resize(emulator.screen().size());
        for (auto& pixel : screen) pixel = static_cast<std::uint8_t>(random());
    }
    preprocess_in_turn(state, emulator, screens);
}
BENCHMARK(preprocess_noise)->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
