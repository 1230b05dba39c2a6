// A game loop with a trained policy in it. The game is an emulated one; yours only has to give its screen
// after every frame and to take joystick events. (Policies that read a console's memory are given that.)
#include <cstdint>
#include <cstdio>
#include <exception>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <cale/emulator.h>
#include <cale/env.h>
#include <cale/games.h>
#include <cale/number.h>
#include <policy/observer.h>
#include <policy/torch/policy.h>

namespace {

// The emulator's screen, a byte of luminance per pixel.
std::span<const std::uint8_t> gray_screen(const cale::Emulator& console, std::vector<std::uint8_t>& pixels) {
    pixels.clear();
    for (const std::uint8_t colour : console.screen()) pixels.push_back(console.gray_palette()[colour]);
    return pixels;
}

/// One frame. Returns the reward.
int press(cale::Emulator& console, const cale::Decision& decision) {
    if (decision.paddle) return console.act_paddle(*decision.paddle, decision.event == cale::Event::fire);
    return console.act(decision.event, decision.strength);
}

struct Played {
    int frames = 0;
    int score = 0;
};

Played play(const cale::Policy& policy, cale::Emulator& console, int most_frames) {
    std::vector<std::uint8_t> pixels;
    cale::Observer observer(policy.info(), console.screen_height());
    const auto seen = [&] { return observer.reads_memory() ? console.ram() : gray_screen(console, pixels); };
    console.reset();
    observer.start(seen());

    Played played;
    cale::Decision decision;
    for (int lives = console.lives(); !console.game_over() && played.frames < most_frames; ++played.frames) {
        if (observer.due()) decision = policy.act(observer.observation());
        played.score += press(console, decision);
        observer.see(seen());
        if (console.lives() < lives) observer.lose_life();
        lives = console.lives();
    }
    return played;
}

}  // namespace

int main(int argc, char** argv) {
    const bool asked = argc == 2 && std::string_view(argv[1]) == "--help";
    const auto most_frames = argc > 2 ? cale::number_in<int>(argv[2]) : 108'000;
    if (argc < 2 || argc > 3 || most_frames.value_or(0) < 1 || asked) {
        std::fputs("usage: embed_policy POLICY.safetensors [FRAMES], with FRAMES at least 1\n",
                   asked ? stdout : stderr);
        return asked ? 0 : 2;
    }
    try {
        const auto policy = cale::Policy::load(argv[1]);
        const std::string name =
            policy.info().game.substr(0, policy.info().game.find('+'));  // of several the first
        const auto& game = cale::find_game(name);
        // A placed paddle does not stick.
        const float sticky_probability = policy.info().joystick == cale::Joystick::paddle ? 0 : 0.25F;
        cale::Emulator console(game, cale::find_rom(name, ""), sticky_probability, /*seed=*/1);
        const auto [frames, score] = play(policy, console, *most_frames);
        std::printf("%s plays %s: %d points in %d frames\n", policy.info().agent.c_str(), name.c_str(), score,
                    frames);
        if (std::fflush(stdout) != 0) throw std::runtime_error("the output cannot be written");
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "embed_policy: %s\n", error.what());
        return 1;
    }
}
