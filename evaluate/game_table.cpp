#include "evaluate/game_table.h"

#include <cmath>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/random_play.h"
#include "report/csv.h"

namespace cale {
namespace {

/// A game's ROM; none where there is no file, or one of something else, as `text` says.
struct RomFile {
    std::optional<std::filesystem::path> path{};
    std::string text{};
    std::string remedy{};
};

RomFile rom_of(const Game& game, const std::string& rom_dir) {
    RomFile rom{.text = "missing", .remedy = ": run scripts/setup"};
    try {
        const auto file = find_rom(game.rom, rom_dir);
        rom = {.text = fmt::format("not this game's: {}", file.string())};
        if (rom_name(file) == game.rom) rom = {.path = file, .text = file.string()};
    } catch (const std::runtime_error&) {
        // As `text` says.
    }
    return rom;
}

std::vector<std::string_view> minimal_actions(const Game& game, const std::string& rom_dir) {
    EnvConfig config{.game = std::string(game.rom), .rom_dir = rom_dir};
    config.action_space = ActionSet::minimal;
    const Env env(config, /*seed=*/0);
    std::vector<std::string_view> names;
    for (const Event event : env.actions()) names.push_back(event_name(event));
    return names;
}

/// All, or those of Atari 100k.
std::vector<Game> listed_games(bool atari100k) {
    std::vector<Game> listed;
    for (const Game& game : all_games())
        if (!atari100k || game.in_atari100k) listed.push_back(game);
    return listed;
}

/// The mean score of random play on the joystick, as it is measured by default.
std::optional<double> joystick_score(const Game& game, bool sticky) {
    const std::string rom(game.rom);
    const auto play = joystick_random(sticky ? protocol_200m(rom) : protocol_atari100k(rom));
    return play ? std::optional(play->mean) : std::nullopt;
}

std::string score(const std::optional<double>& value, std::string_view otherwise) {
    return value ? fmt::format("{}", *value) : std::string(otherwise);
}

/// One decimal, as scores are published.
double rounded(double score) {
    return std::round(10 * score) / 10 + 0.0;
}

}  // namespace

std::string game_table(const std::string& rom_dir, bool atari100k) {
    constexpr auto kRow = "{:<16}  {:>7}  {:>9}  {:>9}  {:>9}  {:<4}  {:<6}  {}\n";
    std::string text =
        fmt::format(kRow, "game", "actions", "random", "joystick", "human", "100k", "paddle", "ROM");
    std::size_t shown = 0, missing = 0;
    for (const Game& game : listed_games(atari100k)) {
        const auto rom = rom_of(game, rom_dir);
        const auto joystick = joystick_score(game, /*sticky=*/true);
        ++shown;
        if (!rom.path) ++missing;
        text +=
            fmt::format(kRow, game.name, game.minimal_action_count, score(game.random_score, "-"),
                        joystick ? fmt::format("{}", rounded(*joystick)) : "-", score(game.human_score, "-"),
                        game.in_atari100k ? "yes" : "", has_paddle(game) ? "yes" : "", rom.text);
    }
    text +=
        "random: the published score of random joystick events; joystick: random play on the continuous "
        "joystick,\nmeasured with sticky actions (cale games GAME has its interval, and without them); "
        "paddle: env.paddle=absolute\nplaces it\n";
    text += fmt::format("{} games, {}\n", shown,
                        missing == 0 ? "all with their ROM"
                                     : fmt::format("{} without their ROM: run scripts/setup, or let "
                                                   "--rom-dir or ALE_ROMS_DIR name a folder that has it",
                                                   missing));
    return text;
}

std::string game_csv(const std::string& rom_dir, bool atari100k) {
    std::string text =
        "game,rom,atari100k,random_score,human_score,joystick_random_200m,joystick_random_atari100k,"
        "minimal_action_count,paddle,minimal_actions,rom_file\n";
    for (const Game& game : listed_games(atari100k)) {
        const auto rom = rom_of(game, rom_dir);
        const auto actions = rom.path ? minimal_actions(game, rom_dir) : std::vector<std::string_view>{};
        text += fmt::format("{},{},{},{},{},{},{},{},{},{},", game.name, game.rom, game.in_atari100k ? 1 : 0,
                            score(game.random_score, ""), score(game.human_score, ""),
                            score(joystick_score(game, true), ""), score(joystick_score(game, false), ""),
                            game.minimal_action_count, has_paddle(game) ? 1 : 0, fmt::join(actions, " ")) +
                csv_line({rom.path ? rom.text : ""});
    }
    return text;
}

std::string mode_table(const std::string& rom_dir, bool atari100k) {
    constexpr auto kRow = "{:<16}  {:<12}  {}\n";
    std::string text = fmt::format(kRow, "game", "difficulties", "modes");
    for (const Game& game : listed_games(atari100k)) {
        const auto rom = rom_of(game, rom_dir);
        if (!rom.path) {
            text += fmt::format(kRow, game.name, "-", fmt::format("the ROM is {}{}", rom.text, rom.remedy));
            continue;
        }
        const Emulator console(game, *rom.path, /*sticky_probability=*/0, /*seed=*/0);
        text += fmt::format(kRow, game.name, fmt::format("{}", fmt::join(console.difficulties(), " ")),
                            fmt::join(console.modes(), " "));
    }
    return text + "env.mode and env.difficulty choose them.\n";
}

std::string game_details(const Game& game, const std::string& rom_dir) {
    const auto rom = rom_of(game, rom_dir);
    std::string text;
    const auto line = [&text](std::string_view name, std::string_view value) {
        text += fmt::format("{:<16}  {}\n", name, value);
    };
    line("game", fmt::format("ALE/{}-v5", game.name));
    line("Atari 100k", game.in_atari100k ? "yes" : "no");
    line("random score", score(game.random_score, "none published"));
    if (!joystick_score(game, true)) {
        line("joystick random", "not measured");
    } else {
        for (const auto& [name, protocol] :
             {std::pair("joystick random", "200m"), std::pair("", "atari100k")}) {
            const auto& play = joystick_random(game.name, protocol);
            line(name, fmt::format("{} ({} to {}, {} games of protocol {})", rounded(play.mean),
                                   rounded(play.low), rounded(play.high), play.games, protocol));
        }
    }
    line("human score", score(game.human_score, "none published"));
    line("minimal actions", rom.path ? fmt::format("{}: {}", game.minimal_action_count,
                                                   fmt::join(minimal_actions(game, rom_dir), ", "))
                                     : fmt::format("{}", game.minimal_action_count));
    line("paddle", has_paddle(game) ? "yes: env.paddle=absolute places it" : "no");
    if (rom.path) {
        const Emulator console(game, *rom.path, /*sticky_probability=*/0, /*seed=*/0);
        line("modes", fmt::format("{}", fmt::join(console.modes(), ", ")));
        line("difficulties", fmt::format("{}", fmt::join(console.difficulties(), ", ")));
    }
    line("ROM", rom.path ? rom.text : fmt::format("{}.bin, {}{}", game.rom, rom.text, rom.remedy));
    return text;
}

}  // namespace cale
