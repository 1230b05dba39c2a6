// The gray palette of the emulator, against ALE's own conversion.
#include <array>
#include <cstdint>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include <ale/ale_interface.hpp>
#include <ale/common/ColourPalette.hpp>
#include <ale/common/Log.hpp>
#include <ale/emucore/Console.hxx>
#include <ale/emucore/OSystem.hxx>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/games.h"

namespace {

// The grays of all 256 indices, as ALE's getScreenGrayscale() has them.
std::vector<std::uint8_t> reference_gray(ale::ALEInterface& reference) {
    std::array<std::uint8_t, 256> indices{};
    std::iota(indices.begin(), indices.end(), std::uint8_t{0});
    std::vector<std::uint8_t> gray;
    reference.theOSystem->colourPalette().applyPaletteGrayscale(gray, indices.data(), indices.size());
    return gray;
}

TEST(EmulatorPalette, GraysOfAllIndicesAreALEs) {
    ale::Logger::setMode(ale::Logger::Error);
    for (const auto& [game, format] : {std::pair("air_raid", "PAL"), std::pair("pong", "NTSC")}) {
        const auto rom = cale::find_rom(game, "");
        const cale::Emulator emulator(cale::find_game(game), rom, 0, 1);
        ale::ALEInterface reference;
        reference.loadROM(rom);
        ASSERT_EQ(reference.theOSystem->console().getFormat(), format) << game;
        auto expected = reference_gray(reference);
        // In NTSC games, of which none shows it, ALE's 255 is whatever the linker has put behind the table;
        // in ale-py's library that is 0.
        if (format == std::string("NTSC")) expected[255] = 0;
        for (std::size_t i = 0; i < 256; ++i)
            EXPECT_EQ(int{emulator.gray_palette()[i]}, int{expected[i]}) << game << ", index " << i;
    }
}

}  // namespace
