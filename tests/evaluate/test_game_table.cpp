#include "evaluate/game_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include <fmt/format.h>

#include "cale/env.h"
#include "cale/random_play.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::ContainsRegex;
using testing::HasSubstr;

auto lines(const std::string& text) {
    return std::count(text.begin(), text.end(), '\n');
}

TEST(GameTable, HasARowForEachGame) {
    const auto table = game_table("", false);
    EXPECT_EQ(lines(table), 69);  // with the head, what the columns are, and the sum
    const auto measured = [](const char* game) {
        return fmt::format("{:9.1f}", joystick_random(game, "200m").mean);
    };
    EXPECT_THAT(table, HasSubstr("\nBreakout                4        1.7  " + measured("breakout") +
                                 "       30.5  yes   yes   "));
    EXPECT_THAT(table, HasSubstr("\nAirRaid                 6          -  " + measured("air_raid") +
                                 "          -        "));
    EXPECT_THAT(table,
                HasSubstr("\nKaboom                  4          -          -          -        yes   "));
    EXPECT_EQ(lines(game_table("", true)), 31);
    EXPECT_THAT(game_table("", true), HasSubstr("\n26 games, all with their ROM\n"));
}

TEST(GameTable, SaysWhichRomsAreMissing) {
    const test::TemporaryFolder empty;
    const auto table = game_table(empty.path().string(), false);
    EXPECT_THAT(table, HasSubstr("missing"));
    EXPECT_THAT(table, HasSubstr("64 games, 64 without their ROM: run scripts/setup"));
    EXPECT_THAT(game_csv(empty.path().string(), true),
                ContainsRegex("\nPong,pong,1,-20\\.7,14\\.6,-20\\.[0-9]+,-20\\.[0-9]+,6,1,,\n"));
    EXPECT_THAT(game_details(find_game("pong"), empty.path().string()), HasSubstr("pong.bin, missing"));
}

TEST(GameTable, AFileThatIsAnotherThingIsNoRom) {
    const test::TemporaryFolder folder;
    folder.write("pong.bin", "Pong?");
    EXPECT_THAT(game_table(folder.path().string(), true),
                HasSubstr("not this game's: " + (folder / "pong.bin").string()));
    EXPECT_THAT(game_csv(folder.path().string(), true),
                ContainsRegex("\nPong,pong,1,-20\\.7,14\\.6,-20\\.[0-9]+,-20\\.[0-9]+,6,1,,\n"));
    EXPECT_THAT(mode_table(folder.path().string(), true), HasSubstr("the ROM is not this game's: "));
    EXPECT_THAT(game_details(find_game("pong"), folder.path().string()),
                HasSubstr("pong.bin, not this game's: "));
}

TEST(GameTableEmulator, AsksTheEmulatorForTheActions) {
    // One ROM alone, as an emulator takes a tenth of a second to start.
    const test::TemporaryFolder folder;
    std::filesystem::copy(find_rom("pong", ""), folder.path() / "pong.bin");
    const auto csv = game_csv(folder.path().string(), true);
    EXPECT_EQ(lines(csv), 27);
    EXPECT_THAT(csv, ContainsRegex("\nPong,pong,1,.*,6,1,NOOP FIRE RIGHT LEFT RIGHTFIRE LEFTFIRE,/"));
    EXPECT_THAT(game_details(find_game("Breakout"), ""),
                HasSubstr("\njoystick random   1.2 (1 to 1.5, 100 games of protocol 200m)\n"
                          "                  1.1 (0.9 to 1.3, 100 games of protocol atari100k)\n"));
    EXPECT_THAT(game_details(find_game("Breakout"), ""), HasSubstr("4: NOOP, FIRE, RIGHT, LEFT\n"));
    EXPECT_THAT(game_details(find_game("Breakout"), ""),
                HasSubstr("\nmodes             0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44\n"
                          "difficulties      0, 1\n"));
    EXPECT_THAT(
        mode_table(folder.path().string(), true),
        AllOf(HasSubstr("\nPong              0 1 2 3       0 1\n"),
              HasSubstr("\nHero              -             the ROM is missing: run scripts/setup\n")));
}

}  // namespace
}  // namespace cale
