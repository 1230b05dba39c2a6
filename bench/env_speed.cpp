// Agent steps per second of our VectorEnv under random actions: one number on stdout.
//   env_speed GAME ENVIRONMENTS THREADS STEPS [minimal]
// STEPS are those of all environments together. With "minimal" the actions are those of the game's minimal
// discrete set.
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <random>
#include <string_view>
#include <vector>

#include "bench/command_line.h"
#include "cale/vector_env.h"

namespace {

int measure(int argc, char** argv) {
    const bool minimal = argc == 6 && std::string_view(argv[5]) == "minimal";
    if (argc != 5 && !minimal) return bench::kUsage;
    cale::EnvConfig config = cale::protocol_200m(argv[1]);
    config.num_envs = bench::whole_number("ENVIRONMENTS", argv[2], 1, 1024);
    config.env_threads = bench::whole_number("THREADS", argv[3], 0, 1024);
    if (minimal) config.action_space = cale::ActionSet::minimal;
    const std::int64_t steps =
        bench::whole_number("STEPS", argv[4], config.num_envs, 1'000'000'000) / config.num_envs;

    const auto n = static_cast<std::size_t>(config.num_envs);
    std::vector<std::uint32_t> seeds(n);
    for (std::size_t i = 0; i < n; ++i) seeds[i] = static_cast<std::uint32_t>(i);
    cale::VectorEnv env(config, seeds);
    std::vector<std::uint8_t> frames(n * cale::kFrameSize);
    std::vector<std::uint8_t> final_frames(frames.size());
    std::vector<cale::StepResult> results(n);
    std::vector<cale::ContinuousAction> actions(n);
    std::vector<std::int64_t> choices(n);
    const auto num_actions = static_cast<std::int64_t>(env.actions().size());
    std::mt19937 random(1);
    std::uniform_real_distribution<float> unit(0, 1);
    constexpr float pi = std::numbers::pi_v<float>;

    env.reset(frames);
    std::chrono::steady_clock::time_point start;
    for (std::int64_t step = -100; step < steps; ++step) {
        if (step == 0) start = std::chrono::steady_clock::now();
        if (minimal) {
            for (auto& choice : choices) choice = static_cast<std::int64_t>(random()) % num_actions;
            env.step(choices, frames, final_frames, results);
        } else {
            for (auto& action : actions) action = {unit(random), pi * (2 * unit(random) - 1), unit(random)};
            env.step(actions, frames, final_frames, results);
        }
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    std::printf("%.1f\n", static_cast<double>(steps * config.num_envs) / seconds.count());
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run("env_speed GAME ENVIRONMENTS THREADS STEPS [minimal]", measure, argc, argv);
}
