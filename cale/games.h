// The sixty Atari 2600 games of the literature, the scores that they are normalised with, and the games that
// are played with paddles.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace cale {

/// A game's names and reference scores.
struct Game {
    std::string_view name;  // as in Gymnasium's ids: "MsPacman"
    std::string_view rom;   // as ALE calls it, and its ROM file without ".bin": "ms_pacman"
    bool in_atari100k;      // one of the 26 games of Atari 100k (Kaiser et al. 2020)
    // Scores of a random agent and of a human (Mnih et al. 2015, Wang et al. 2016); some games have none.
    std::optional<double> random_score;
    std::optional<double> human_score;  // the human's
    int minimal_action_count;           // joystick events that the game tells apart
};

/// All sixty, in alphabetical order.
std::span<const Game> games();
/// The sixty, and after them four more that ALE has and that are played with a paddle: they have no published
/// scores.
std::span<const Game> all_games();

/// Returns whether the game is played with a paddle, as ALE's properties of its ROM say: Breakout, Pong and
/// the four more.
bool has_paddle(const Game& game);

/// The one of all_games() that goes by this name: "MsPacman", "ms_pacman", "ALE/MsPacman-v5" and
/// "MsPacmanNoFrameskip-v4" are the same. Throws std::invalid_argument that suggests
/// up to three games, or says where they are listed.
const Game& find_game(std::string_view name);
/// The games of "pong,breakout". Throws as find_game() does, and std::invalid_argument for a game that is
/// named twice.
std::vector<const Game*> games_of(std::string_view names);
/// Returns "Pong+Breakout", the names of games_of(names). Throws as it does.
std::string game_names(std::string_view names);

}  // namespace cale
