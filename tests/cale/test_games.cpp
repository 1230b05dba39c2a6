#include <algorithm>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/games.h"
#include "cale/text.h"
#include "message_of.h"
#include "support/temporary_folder.h"

namespace {

using cale::find_game;
using testing::HasSubstr;

TEST(Games, SixtyOfWhichTwentySixAreAtari100k) {
    const auto games = cale::games();
    EXPECT_EQ(games.size(), 60u);
    EXPECT_EQ(std::ranges::count_if(games, &cale::Game::in_atari100k), 26);
    EXPECT_TRUE(std::ranges::is_sorted(games, {}, &cale::Game::name));
    const auto unscored = [](const cale::Game& game) { return !game.human_score; };
    EXPECT_EQ(std::ranges::count_if(games, unscored), 5);
    for (const auto& game : games) {
        EXPECT_EQ(game.random_score.has_value(), game.human_score.has_value()) << game.name;
        EXPECT_TRUE(!game.in_atari100k || game.human_score) << game.name;
    }
}

TEST(Games, ScoresAndActionsAreTheReferences) {
    std::ifstream table(CALE_SOURCE_DIR "/tests/cale/games.csv");
    std::string line;
    std::getline(table, line);
    ASSERT_EQ(line, "game,in_100k,random,human,minimal_action_count");
    std::size_t rows = 0;
    for (; std::getline(table, line); ++rows) {
        const auto cells = cale::split(line, ',');
        const auto& game = find_game(cells.at(0));
        EXPECT_EQ(game.in_atari100k, cells.at(1) == "1") << line;
        EXPECT_EQ(game.random_score, cale::number_in<double>(cells.at(2))) << line;
        EXPECT_EQ(game.human_score, cale::number_in<double>(cells.at(3))) << line;
        EXPECT_EQ(game.minimal_action_count, cale::number_in<int>(cells.at(4))) << line;
    }
    EXPECT_EQ(rows, cale::games().size());
}

TEST(Games, EverySpellingIsFound) {
    for (const auto& game : cale::games()) {
        const std::string name(game.name);
        for (const auto& spelling : {name, std::string(game.rom), "ALE/" + name + "-v5", name + "-v4",
                                     name + "NoFrameskip-v4", name + "Deterministic-v0"}) {
            EXPECT_EQ(&find_game(spelling), &game) << spelling;
        }
    }
    EXPECT_EQ(find_game("PONG").rom, "pong");
}

TEST(Games, TheNearestGameIsNamed) {
    const auto refusal = [](const char* name) {
        return message_of<std::invalid_argument>([&] { find_game(name); });
    };
    EXPECT_EQ(refusal(""), "there is no game '': name one of the 64, such as pong");
    EXPECT_EQ(refusal("Pog"), "there is no game 'Pog'; did you mean pong?");
    EXPECT_THAT(refusal("ALE/SpaceInvader-v5"), HasSubstr("space_invaders"));
    EXPECT_THAT(refusal("ms_pacmen"), HasSubstr("ms_pacman"));
    EXPECT_EQ(refusal("road"), "there is no game 'road'; did you mean road_runner?");
    EXPECT_EQ(refusal("demon"), "there is no game 'demon'; did you mean demon_attack?");
    EXPECT_EQ(refusal("man"), "there is no game 'man'; did you mean chopper_command or ms_pacman?");
    EXPECT_EQ(refusal("a"), "there is no game 'a'; cale games lists all 64");
    EXPECT_EQ(refusal("montezuma's"), "there is no game 'montezuma's'; cale games lists all 64");
    EXPECT_THAT(refusal(""), HasSubstr("no game ''"));
}

TEST(EmulatorGames, ARomIsKnownByItsContents) {
    const test::TemporaryFolder folder;
    const auto rom = cale::find_rom("ms_pacman", "");
    std::filesystem::copy(rom, folder / "mystery");
    EXPECT_EQ(cale::rom_name(folder / "mystery"), "ms_pacman");
    EXPECT_EQ(cale::rom_name(cale::find_rom("pong", "").parent_path() / "adventure.bin"), "adventure");
    EXPECT_EQ(cale::rom_name(folder.write("pong.bin", "no ROM")), "");
    EXPECT_THROW(cale::rom_name(folder / "nothing"), std::runtime_error);
}

TEST(EmulatorGames, AllSixtyLoadAndStep) {
    for (const auto& game : cale::games()) {
        SCOPED_TRACE(game.name);
        cale::Emulator emulator(game, cale::find_rom(game.rom, ""), 0, 1);
        emulator.reset();
        EXPECT_EQ(std::ssize(emulator.minimal_actions()), game.minimal_action_count);
        EXPECT_EQ(emulator.legal_actions().size(), game.rom == "skiing" ? 9u : 18u);
        EXPECT_EQ(emulator.gray_palette()[0], 0);
        EXPECT_EQ(emulator.screen_width(), cale::kScreenWidth);
        EXPECT_EQ(emulator.screen().size(),
                  std::size_t{160} * static_cast<std::size_t>(emulator.screen_height()));
        EXPECT_EQ(emulator.ram().size(), 128u);
        const auto before = emulator.frame_number();
        for (int i = 0; i < 40; ++i) emulator.act(static_cast<cale::Event>(i % cale::kEventCount), 1);
        EXPECT_EQ(emulator.frame_number() - before, 40);
        EXPECT_FALSE(emulator.game_over());
    }
}

}  // namespace
