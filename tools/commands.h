// The subcommands of `cale`, a file each. Each function adds one to the program; its callback runs when the
// command line names it. An exception is printed as one sentence and ends the program: with code 2 for
// invalid input (ConfigError, std::invalid_argument), else with 1. A callback with another exit code stores
// it in `exit_code`.
#pragma once

#include <CLI/CLI.hpp>

namespace cale {

/// How a run spent its time.
void add_bench(CLI::App& app);
/// Scripts for shells.
void add_completion(CLI::App& app);
/// A joystick's motion from a log of it.
void add_fit_stick(CLI::App& app);
/// Games played by a trained policy, or by those of many runs.
void add_evaluate(CLI::App& app, int& exit_code);
/// Policies for other programs.
void add_export(CLI::App& app);
/// The sixty games.
void add_games(CLI::App& app);
/// The regions of the joystick.
void add_map(CLI::App& app);
/// A game in a window.
void add_play(CLI::App& app, int& exit_code);
/// The step response of a joystick that moves.
void add_stick(CLI::App& app);
/// Statistics and figures of many runs.
void add_report(CLI::App& app);
/// Every run of a comparison.
void add_sweep(CLI::App& app, int& exit_code);

}  // namespace cale
