// The games as text, for `cale games`.
#pragma once

#include <string>

#include "cale/games.h"

namespace cale {

/// A row per game: name, number of minimal actions, published random score, measured score of random play on
/// the joystick (protocol 200m), human score, whether it is one of Atari 100k, whether it has a paddle, the
/// file of its ROM. Empty `rom_dir`: as find_rom() has it. `atari100k`: those 26 alone.
std::string game_table(const std::string& rom_dir, bool atari100k);

/// The same as CSV:
/// game,rom,atari100k,random_score,human_score,joystick_random_200m,joystick_random_atari100k,
/// minimal_action_count,paddle,minimal_actions,rom_file. The events of the minimal set, separated by spaces,
/// come from the emulator: they and the file are empty if the ROM is missing. A missing score is an empty
/// cell.
std::string game_csv(const std::string& rom_dir, bool atari100k);

/// A row per game: its difficulties and its modes, from the emulator.
std::string mode_table(const std::string& rom_dir, bool atari100k);

/// The details of one game, one per line, with its events.
std::string game_details(const Game& game, const std::string& rom_dir);

}  // namespace cale
