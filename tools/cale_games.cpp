#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include <fmt/format.h>

#include "evaluate/game_table.h"
#include "settings/config.h"
#include "tools/commands.h"

namespace cale {
namespace {

struct Options {
    std::string game;
    std::string rom_dir;
    bool atari100k = false;
    bool csv = false;
    bool modes = false;
};

void show(const Options& options) {
    if (!options.rom_dir.empty() && !std::filesystem::is_directory(options.rom_dir))
        throw ConfigError(fmt::format("--rom-dir {}: there is no such folder", options.rom_dir));
    if (!options.game.empty()) {
        std::fputs(game_details(find_game(options.game), options.rom_dir).c_str(), stdout);
    } else if (options.modes) {
        std::fputs(mode_table(options.rom_dir, options.atari100k).c_str(), stdout);
    } else if (options.csv) {
        std::fputs(game_csv(options.rom_dir, options.atari100k).c_str(), stdout);
    } else {
        std::fputs(game_table(options.rom_dir, options.atari100k).c_str(), stdout);
    }
}

}  // namespace

void add_games(CLI::App& app) {
    auto& command = *app.add_subcommand(
        "games",
        "Lists the 60 games and four more with a paddle: how many actions each has, the scores that "
        "returns are normalised with, what random play on the joystick scores, which "
        "belong to Atari 100k, which ROM is there.");
    const auto options = std::make_shared<Options>();
    auto* game = command.add_option("GAME", options->game, "all about this one: pong, Pong or ALE/Pong-v5")
                     ->type_name("GAME");
    command
        .add_option("--rom-dir", options->rom_dir,
                    "folder of the ROM files, instead of ALE_ROMS_DIR and what "
                    "scripts/setup installed")
        ->type_name("DIR");
    command.add_flag("--atari100k", options->atari100k, "those 26 alone")->excludes(game);
    auto* csv =
        command.add_flag("--csv", options->csv, "as CSV, with the events of every game")->excludes(game);
    command
        .add_flag("--modes", options->modes,
                  "the modes and difficulties of each instead, for env.mode and env.difficulty")
        ->excludes(game)
        ->excludes(csv);
    command.footer(
        "Examples:\n"
        "  cale games\n"
        "  cale games breakout\n"
        "  cale games --modes\n"
        "  cale games --atari100k --csv > games.csv\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([options] { show(*options); });
}

}  // namespace cale
