// The table-driven resize against OpenCV's on frames of all sixty games.
#include <cstdlib>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/frames.h"
#include "cale/games.h"
#include "reference_frames.h"
#include "support/golden.h"

namespace {

/// Of each game; by hand, for 120,000 frames: CALE_REAL_FRAMES=2000 test_cale
/// --gtest_filter='EmulatorFrames*'
std::uint64_t frames_per_game() {
    const char* wanted = std::getenv("CALE_REAL_FRAMES");
    return wanted != nullptr ? std::strtoull(wanted, nullptr, 10) : 20;
}

TEST(EmulatorFrames, AreOpenCVsInEveryGame) {
    std::uint64_t compared = 0;
    std::vector<std::uint8_t> frame(cale::kFrameSize);
    for (const auto& game : cale::games()) {
        cale::Emulator emulator(game, cale::find_rom(game.rom, ""), 0.25f, 1);
        cale::FramePipeline frames(emulator.screen_height(), emulator.gray_palette());
        ReferenceFrames reference(emulator.screen_height(), emulator.gray_palette());
        const auto actions = emulator.minimal_actions();
        for (std::uint64_t step = 0; step < frames_per_game(); ++step) {
            if (step == 0 || emulator.game_over()) {
                emulator.reset();
                frames.start(emulator.screen());
                reference.start(emulator.screen());
            }
            const auto event = actions[golden::bits(11, step) % actions.size()];
            for (int skipped = 0; skipped < 3; ++skipped) emulator.act(event, 1);
            frames.set_first(emulator.screen());
            reference.set_first(emulator.screen());
            emulator.act(event, 1);
            frames.set_second(emulator.screen());
            reference.set_second(emulator.screen());
            frames.write(frame);
            ASSERT_EQ(frame, reference.observe()) << game.name << ", step " << step;
            ++compared;
        }
    }
    RecordProperty("frames", std::to_string(compared));
    EXPECT_EQ(compared, 60 * frames_per_game());
}

}  // namespace
