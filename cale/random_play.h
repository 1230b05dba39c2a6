// Scores of random play on the continuous joystick, by game: the baseline of everything that is played with
// it. The published random scores (Game::random_score) are those of the discrete joystick, where every event
// is equally likely; a uniformly random (r, theta, fire) leaves the stick in its centre more than half of the
// time.
#pragma once

#include <cstdint>
#include <optional>
#include <random>
#include <span>
#include <string_view>

#include "cale/env.h"
#include "cale/games.h"
#include "cale/joystick.h"

namespace cale {

/// Returns a joystick that is uniform over the coordinates of `joystick`, or over the actions of `factored`.
ContinuousAction random_stick(Joystick joystick, std::mt19937& random);

/// One game under one protocol, every action drawn uniformly from the box of the joystick's coordinates, at
/// threshold 0.5. Measured with bench/joystick_random; data/README.md says how.
struct RandomPlay {
    std::string_view game;      // as in Game::name
    std::string_view protocol;  // "200m" or "atari100k": protocol_200m(), protocol_atari100k()
    Joystick joystick;          // polar or cartesian
    std::int64_t games;         // whole games, whatever ends the agent's episodes
    std::int64_t cut_games;     // of them cut off after 108,000 frames
    std::int64_t agent_steps;   // of all games together
    double mean;                // of the games' returns, undiscounted and unclipped
    double low;                 // the 95 % bootstrap interval of the mean
    double high;                // its upper end
    double rewarded_share;      // of the agent steps, those that brought a reward
};

/// data/joystick_random_scores.csv: 60 games x 2 protocols x 2 joysticks, in this order.
std::span<const RandomPlay> joystick_random_scores();

/// The game by any name that find_game() knows. Throws std::invalid_argument for another game, protocol or
/// joystick.
const RandomPlay& joystick_random(std::string_view game, std::string_view protocol,
                                  Joystick joystick = Joystick::polar);

/// The measurement that a run in this environment compares with: "200m" at sticky probability 0.25,
/// "atari100k" at 0. None for discrete actions, whose baseline is Game::random_score, and for a joystick or
/// rules that were not measured: directions, another threshold, event map, frame skip or stickiness,
/// paddles scaled by r in Pong and Breakout, games cut off before 100,000 frames or after 108,000. Whether a
/// lost life ends the agent's episode does not matter to whole games.
std::optional<RandomPlay> joystick_random(const EnvConfig& config);

/// Returns whether games are cut off so early that scores do not compare with those of whole games: before
/// 100,000 frames, where published ones are at 108,000.
bool cuts_games_short(const EnvConfig& config);

/// The mean return of random play with the actions of this environment, which a score is compared with: of
/// the joystick where actions are coordinates, else the published Game::random_score. (Human-normalised
/// scores always take the latter, so that they can be compared with published ones.) None where it is not
/// known.
std::optional<double> random_floor(const EnvConfig& config);

}  // namespace cale
