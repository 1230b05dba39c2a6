// web_trace POLICY STEPS SEED [CHANGE...]
// Plays a policy greedily in its environment and prints every agent step as JSON. The page plays the same
// actions and is held to what is printed here (tests/web/test_page.py).
#include <zlib.h>

#include <cstdint>
#include <cstdio>
#include <exception>
#include <span>
#include <string>
#include <vector>

#include "cale/env.h"
#include "cale/seeds.h"
#include "policy/policy_lite.h"
#include "web/settings.h"

namespace {

unsigned long checksum(std::span<const std::uint8_t> bytes) {
    return crc32(0, bytes.data(), static_cast<uInt>(bytes.size()));
}

void print(const char* name, std::span<const float> numbers) {
    std::printf("\"%s\": [", name);
    for (const float& number : numbers)
        std::printf("%s%.9g", &number == numbers.data() ? "" : ", ", static_cast<double>(number));
    std::printf("], ");
}

void play(const std::string& file, int steps, std::uint64_t seed, const std::string& changes) {
    const auto policy = cale::lite::Policy::load(file);
    auto workspace = policy.workspace();
    auto config = cale::web::trained_env(policy.info());
    config.terminal_on_life_loss = policy.info().life_loss_ends_episode;
    cale::web::change(config, changes);
    cale::Env env(config, cale::derive_seed(seed, "play", 0));
    const auto space = cale::observation_space(config);
    std::vector<std::uint8_t> frame(static_cast<std::size_t>(space.frame_size())), screen;
    cale::FrameStack stack(1, static_cast<std::size_t>(space.stack), frame.size());
    bool over = true;
    std::printf("[");
    for (int step = 0; step < steps; ++step) {
        if (over) {
            env.reset(frame);
            stack.clear(0);
            stack.push(0, frame);
        }
        const auto decision = policy.act(stack.data(), workspace);
        std::printf(step == 0 ? "{" : ",\n{");
        print("output", policy.newest_output(workspace));
        const auto& stick = decision.stick;
        print("stick", std::vector{stick.radius, stick.theta, stick.fire});
        const auto result = env.step(stick, frame);
        stack.follow(0, result, frame);
        over = result.episode_over;
        env.screen_rgb(screen);
        std::printf(
            "\"action\": %lld, \"reward\": %.9g, \"lives\": %d, \"over\": %s, \"screen\": %lu, "
            "\"observation\": %lu}",
            static_cast<long long>(decision.action), static_cast<double>(result.reward), result.lives,
            over ? "true" : "false", checksum(screen), checksum(stack.data()));
    }
    std::printf("]\n");
}

}  // namespace

int main(int argc, char** argv) {
    const std::vector<std::string> words(argv + 1, argv + argc);
    if (words.size() < 3) {
        std::fputs("usage: web_trace POLICY STEPS SEED [SETTING=VALUE...]\n", stderr);
        return 2;
    }
    try {
        std::string changes;
        for (std::size_t i = 3; i < words.size(); ++i) changes += words[i] + '\n';
        play(words[0], std::stoi(words[1]), std::stoull(words[2]), changes);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "web_trace: %s\n", error.what());
        return 1;
    }
}
