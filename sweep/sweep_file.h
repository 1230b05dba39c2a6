// A sweep file: which runs a comparison consists of.
//
//     agent: sac
//     config: ../configs/{agent}/atari100k.yaml   # relative to this file
//     set:                                        # what all runs have
//       eval.episodes: 20
//     grid:                                       # every combination is a run
//       train.seed: 1..5
//       env.game: atari100k
//       agent.encoder: [phi_sac, phi_dqn]
//     variants:                                   # or a list of grids, each combined with `grid`
//       - agent.exploration: standard
//       - agent.exploration: epsilon_greedy
//         agent.epsilon_train: [0.01, 0.1]
//     search:                                     # or settings that are drawn (search_space.h)
//       samples: 16                               # each is trained in every combination of the rest
//       settings:
//         agent.learning_rate: log 1e-5..1e-3
//         agent.update_horizon: 1..10
//         agent.batch_size: [32, 64]
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "sweep/search_space.h"

namespace cale {

/// "agent.encoder=phi_sac", as passed to the training programs.
std::string assignment(const Setting& setting);

/// One run of a sweep.
struct SweepRun {
    std::string name;               // of its folder: "Breakout__sac__encoder=phi_sac__1"
    std::string agent;              // "sac": trained by train_sac
    std::filesystem::path config;   // for --config; empty: the program's defaults
    std::string game;               // "Breakout"
    std::vector<Setting> settings;  // what differs from `config`, env.game and train.seed among it
    std::int64_t sample = 0;        // of a search, from 1; 0: there is none
    std::string combination{};      // its name without the sample, which runs of different samples share
};

/// A sweep file that was read.
struct Sweep {
    std::string name;  // of the file, without its ending
    std::vector<SweepRun> runs{};
    std::size_t repeated = 0;  // combinations that are a run which is there already
    // "agent.encoder=phi_sac" -> "mine.yaml:9:3", where the file has the key; not what a command line has.
    std::map<std::string, std::string> places{};
    std::optional<SearchSpace> search{};
    std::vector<std::vector<Setting>> samples{};  // of the search, from number 1 on
};

/// Reads a sweep file and lists its runs, the first key of `grid` varying slowest and the variants fastest.
///
/// Keys are `agent`, `config` and any setting. Values are one or a list; 1..5 stands for five of them, and
/// for env.game atari100k, paper_ten and all for the games of Atari 100k, the ten whose curves the paper
/// shows, and the sixty. A variant's value takes precedence over `grid`, and `grid` over `set`, `agent` and
/// `config`.
///
/// `overrides` are KEY=VALUE[,VALUE...] of a command line, which hold for every run: they replace the values
/// of that key wherever the file has it, and add it elsewhere. A `config` among them is relative to the
/// current folder.
///
/// Of a search every combination is trained with each sample's settings, which go before all others; the
/// samples vary fastest. Values of a searched key on the command line are drawn from instead of the file's.
///
/// A run's name has game and agent first, every key of `grid` and `variants` between, or sample=NUMBER, and
/// the seed last. Throws ConfigError, "file:line:column: what is wrong" where one line is at fault: the file
/// cannot be read, a key or game is unknown, there are too many runs, or a name is too long or that of two
/// runs. The training programs check the settings (see plan()).
Sweep read_sweep(const std::filesystem::path& file, std::span<const std::string> overrides = {});

}  // namespace cale
