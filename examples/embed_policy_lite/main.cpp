// A trained policy in a program that needs nothing but the C++ standard library. The "game" is a square that
// the joystick moves over a gray screen; it has no lives to lose, of which Observer::lose_life() would be
// told.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <policy/observer.h>
#include <policy/policy_lite.h>

namespace {

constexpr int kRows = 210, kColumns = 160, kSquare = 16, kFrames = 120;

struct Game {
    int x = 72, y = 97;

    /// The events that lie along an axis; the rest stands still here.
    void press(cale::Event event) {
        const auto pushes = [event](cale::Event direction) { return event == direction ? 1 : 0; };
        x = std::clamp(x + pushes(cale::Event::right) - pushes(cale::Event::left), 0, kColumns - kSquare);
        y = std::clamp(y + pushes(cale::Event::down) - pushes(cale::Event::up), 0, kRows - kSquare);
    }
    /// A byte of luminance per pixel.
    std::vector<std::uint8_t> screen() const {
        std::vector<std::uint8_t> pixels(std::size_t{kRows} * kColumns);
        for (int row = y; row < y + kSquare; ++row)
            std::fill_n(pixels.begin() + std::ptrdiff_t{row} * kColumns + x, kSquare, std::uint8_t{255});
        return pixels;
    }
};

void play(const cale::lite::Policy& policy) {
    auto workspace = policy.workspace();  // one per thread
    cale::Observer observer(policy.info(), kRows);
    Game game;
    observer.start(game.screen());
    cale::Decision decision;
    for (int frame = 0; frame < kFrames; ++frame) {
        if (observer.due()) {
            decision = policy.act(observer.observation(), workspace);
            std::printf("%d %d\n", frame, static_cast<int>(decision.event));
        }
        game.press(decision.event);
        observer.see(game.screen());
    }
    if (std::fflush(stdout) != 0) throw std::runtime_error("cannot write the standard output");
}

}  // namespace

int main(int argc, char** argv) {
    const bool asked = argc == 2 && std::string_view(argv[1]) == "--help";
    if (argc != 2 || asked) {
        std::fputs("usage: embed_policy_lite POLICY.safetensors\n", asked ? stdout : stderr);
        return asked ? 0 : 2;
    }
    try {
        play(cale::lite::Policy::load(argv[1]));
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "embed_policy_lite: %s\n", error.what());
        return 1;
    }
}
