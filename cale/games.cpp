#include "cale/games.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include "cale/text.h"

namespace cale {
namespace {

// Name, ROM, in Atari 100k, random and human score, minimal actions.
constexpr std::size_t kSixty = 60;
constexpr std::array<Game, kSixty + 4> kGames{{
    {"AirRaid", "air_raid", false, std::nullopt, std::nullopt, 6},
    {"Alien", "alien", true, 227.8, 7127.7, 18},
    {"Amidar", "amidar", true, 5.8, 1719.5, 10},
    {"Assault", "assault", true, 222.4, 742.0, 7},
    {"Asterix", "asterix", true, 210.0, 8503.3, 9},
    {"Asteroids", "asteroids", false, 719.1, 47388.7, 14},
    {"Atlantis", "atlantis", false, 12850.0, 29028.1, 4},
    {"BankHeist", "bank_heist", true, 14.2, 753.1, 18},
    {"BattleZone", "battle_zone", true, 2360.0, 37187.5, 18},
    {"BeamRider", "beam_rider", false, 363.9, 16926.5, 9},
    {"Berzerk", "berzerk", false, 123.7, 2630.4, 18},
    {"Bowling", "bowling", false, 23.1, 160.7, 6},
    {"Boxing", "boxing", true, 0.1, 12.1, 18},
    {"Breakout", "breakout", true, 1.7, 30.5, 4},
    {"Carnival", "carnival", false, std::nullopt, std::nullopt, 6},
    {"Centipede", "centipede", false, 2090.9, 12017.0, 18},
    {"ChopperCommand", "chopper_command", true, 811.0, 7387.8, 18},
    {"CrazyClimber", "crazy_climber", true, 10780.5, 35829.4, 9},
    {"DemonAttack", "demon_attack", true, 152.1, 1971.0, 6},
    {"DoubleDunk", "double_dunk", false, -18.6, -16.4, 18},
    {"ElevatorAction", "elevator_action", false, std::nullopt, std::nullopt, 18},
    {"Enduro", "enduro", false, 0.0, 860.5, 9},
    {"FishingDerby", "fishing_derby", false, -91.7, -38.7, 18},
    {"Freeway", "freeway", true, 0.0, 29.6, 3},
    {"Frostbite", "frostbite", true, 65.2, 4334.7, 18},
    {"Gopher", "gopher", true, 257.6, 2412.5, 8},
    {"Gravitar", "gravitar", false, 173.0, 3351.4, 18},
    {"Hero", "hero", true, 1027.0, 30826.4, 18},
    {"IceHockey", "ice_hockey", false, -11.2, 0.9, 18},
    {"Jamesbond", "jamesbond", true, 29.0, 302.8, 18},
    {"JourneyEscape", "journey_escape", false, std::nullopt, std::nullopt, 16},
    {"Kangaroo", "kangaroo", true, 52.0, 3035.0, 18},
    {"Krull", "krull", true, 1598.0, 2665.5, 18},
    {"KungFuMaster", "kung_fu_master", true, 258.5, 22736.3, 14},
    {"MontezumaRevenge", "montezuma_revenge", false, 0.0, 4753.3, 18},
    {"MsPacman", "ms_pacman", true, 307.3, 6951.6, 9},
    {"NameThisGame", "name_this_game", false, 2292.3, 8049.0, 6},
    {"Phoenix", "phoenix", false, 761.4, 7242.6, 8},
    {"Pitfall", "pitfall", false, -229.4, 6463.7, 18},
    {"Pong", "pong", true, -20.7, 14.6, 6},
    {"Pooyan", "pooyan", false, std::nullopt, std::nullopt, 6},
    {"PrivateEye", "private_eye", true, 24.9, 69571.3, 18},
    {"Qbert", "qbert", true, 163.9, 13455.0, 6},
    {"Riverraid", "riverraid", false, 1338.5, 17118.0, 18},
    {"RoadRunner", "road_runner", true, 11.5, 7845.0, 18},
    {"Robotank", "robotank", false, 2.2, 11.9, 18},
    {"Seaquest", "seaquest", true, 68.4, 42054.7, 18},
    {"Skiing", "skiing", false, -17098.1, -4336.9, 3},
    {"Solaris", "solaris", false, 1236.3, 12326.7, 18},
    {"SpaceInvaders", "space_invaders", false, 148.0, 1668.7, 6},
    {"StarGunner", "star_gunner", false, 664.0, 10250.0, 18},
    {"Tennis", "tennis", false, -23.8, -8.3, 18},
    {"TimePilot", "time_pilot", false, 3568.0, 5229.2, 10},
    {"Tutankham", "tutankham", false, 11.4, 167.6, 8},
    {"UpNDown", "up_n_down", true, 533.4, 11693.2, 6},
    {"Venture", "venture", false, 0.0, 1187.5, 18},
    {"VideoPinball", "video_pinball", false, 0.0, 17667.9, 9},
    {"WizardOfWor", "wizard_of_wor", false, 563.5, 4756.5, 10},
    {"YarsRevenge", "yars_revenge", false, 3092.9, 54576.9, 18},
    {"Zaxxon", "zaxxon", false, 32.5, 9173.3, 18},
    // Others with a paddle.
    {"Backgammon", "backgammon", false, std::nullopt, std::nullopt, 3},
    {"Blackjack", "blackjack", false, std::nullopt, std::nullopt, 4},
    {"Casino", "casino", false, std::nullopt, std::nullopt, 4},
    {"Kaboom", "kaboom", false, std::nullopt, std::nullopt, 4},
}};

void remove_suffix(std::string_view& text, std::string_view suffix) {
    if (text.ends_with(suffix)) text.remove_suffix(suffix.size());
}

// What all spellings of a game's name have in common: lower-case letters and digits.
std::string canonical(std::string_view name) {
    if (name.starts_with("ALE/")) name.remove_prefix(4);
    const auto dash = name.rfind("-v");
    if (dash != std::string_view::npos &&
        name.find_first_not_of("0123456789", dash + 2) == std::string_view::npos) {
        name = name.substr(0, dash);
    }
    remove_suffix(name, "NoFrameskip");
    remove_suffix(name, "Deterministic");
    auto result = lower(name);
    std::erase(result, '_');
    return result;
}

/// What may be meant by a name that is no game's: those of which it is a part, or the nearest.
std::string suggestion(const std::string& wanted) {
    std::vector<std::string> names, meant;
    for (const Game& game : kGames) {
        names.push_back(canonical(game.name));
        if (names.back().find(wanted) != std::string::npos) meant.emplace_back(game.rom);
    }
    if (const auto name = nearest(wanted, names); meant.empty() && !name.empty()) {
        const auto found = std::ranges::find(names, name) - names.begin();
        meant.emplace_back(kGames[static_cast<std::size_t>(found)].rom);
    }
    if (meant.empty() || meant.size() > 3) return "; cale games lists all " + std::to_string(kGames.size());
    std::string text = "; did you mean " + meant.front();
    for (std::size_t i = 1; i < meant.size(); ++i) text += (i + 1 < meant.size() ? ", " : " or ") + meant[i];
    return text + "?";
}

}  // namespace

std::span<const Game> games() {
    return all_games().first(kSixty);
}
std::span<const Game> all_games() {
    return kGames;
}

bool has_paddle(const Game& game) {
    const auto more = all_games().subspan(kSixty);
    return game.rom == "breakout" || game.rom == "pong" ||
           std::ranges::find(more, game.rom, &Game::rom) != more.end();
}

const Game& find_game(std::string_view name) {
    const std::string wanted = canonical(name);
    if (wanted.empty())
        throw std::invalid_argument("there is no game '" + std::string(name) + "': name one of the " +
                                    std::to_string(kGames.size()) + ", such as pong");
    const auto found =
        std::ranges::find(kGames, wanted, [](const Game& game) { return canonical(game.name); });
    if (found != kGames.end()) return *found;
    throw std::invalid_argument("there is no game '" + std::string(name) + "'" + suggestion(wanted));
}

std::vector<const Game*> games_of(std::string_view names) {
    std::vector<const Game*> games;
    for (const auto& name : split(names, ',')) {
        games.push_back(&find_game(name));
        if (std::ranges::count(games, games.back()) == 1) continue;
        throw std::invalid_argument(std::string(games.back()->rom) + " is named twice among '" +
                                    std::string(names) + "'");
    }
    return games;
}

std::string game_names(std::string_view names) {
    std::string joined;
    for (const auto* const game : games_of(names)) {
        if (!joined.empty()) joined += '+';
        joined += game->name;
    }
    return joined;
}

}  // namespace cale
