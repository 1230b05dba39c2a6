// Games played without learning: by an agent in training, and by a policy for `cale evaluate`.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <torch/types.h>

#include "cale/env.h"
#include "cale/frames.h"
#include "evaluate/event_counts.h"
#include "world/world.h"

namespace cale {

/// The actions chosen for N games.
struct Chosen {
    torch::Tensor actions;   // [N, coordinates] float32, or [N] int64
    torch::Tensor values{};  // [N] float32, the values of the chosen actions; undefined if unknown
};

/// Returns the joystick for action `i` of `actions`, which are in the coordinates of `joystick`, on the CPU
/// and contiguous.
ContinuousAction chosen_stick(Joystick joystick, const torch::Tensor& actions, std::int64_t i);

/// Chooses for N games under way. `observations`: [N, stack, ...] uint8, valid during the call;
/// `games`: the numbers of the games that its rows belong to.
using Decide = std::function<Chosen(const torch::Tensor& observations, std::span<const std::int64_t> games)>;

/// A game that has ended.
struct EvaluatedGame {
    std::string game{};         // which one, "Pong", where several are played in turn; else empty
    double episode_return = 0;  // undiscounted, neither clipped nor scaled
    std::int64_t length = 0;    // agent steps
    std::int64_t frames = 0;    // emulated
    EventCounts events{};       // how often each joystick event was chosen
    std::map<float, std::int64_t> rewards{};  // reward of an agent step -> count
};

/// The games of a plan, and what they have together.
struct Evaluation {
    std::vector<EvaluatedGame> games;         // by their numbers
    EventCounts events{};                     // the sums over the games
    std::map<float, std::int64_t> rewards{};  // the same
    double mean_return = 0;                   // over the games
    double standard_deviation = 0;            // of the returns, divided by n
    bool interrupted = false;                 // by EvaluationPlan::stop: there are fewer games than planned
};

/// As EvaluationPlan::games or steps: no limit.
constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max();

/// Which games are played, and how. Game i depends on `seed` and i alone, whatever `parallel` is, provided
/// that the choices of `decide` for a game do.
struct EvaluationPlan {
    EnvConfig env{};           // several games are played in turn
    std::int64_t games = 100;  // at most; `steps` may allow fewer
    /// No game begins once the games before it total this many agent steps.
    std::int64_t steps = kNoLimit;
    std::int64_t parallel = 1;          // games under way at a time, stepped by LibTorch's threads
    std::uint64_t seed = 1;             // each game's is derived from it
    double epsilon = 0;                 // probability of a uniformly random action instead of the chosen one
    std::filesystem::path video{};      // an MP4 file of one of the games; empty: none
    std::int64_t filmed_game = 0;       // the number of the one in `video`
    double film_minutes = 5;            // of the game's time
    std::filesystem::path step_logs{};  // a folder for game_0000.csv, ... (evaluate/step_log.h); empty: none
    /// Games already played, by number: they are counted and not played again.
    std::map<std::int64_t, EvaluatedGame> known{};
    /// Called after each game, in the order in which they end.
    std::function<void(std::int64_t number, const EvaluatedGame&)> ended{};
    std::function<void(std::int64_t steps)> stepped{};  // called after so many agent steps, of all games
    /// Asked before each step. If it returns true, the evaluation ends, with the games before the first
    /// unfinished one: games that are under way together end in the order of their lengths, and the short
    /// ones alone would bias the mean.
    std::function<bool()> stop{};
};

/// DER's evaluation in Dopamine (DataEfficientAtariRunner): 100 fresh games that begin with 0 to 29
/// no-op agent steps, 0.1 % random actions.
EvaluationPlan fixed_episodes(const EnvConfig& env);
/// Dopamine's evaluation phase (Machado et al. 2018): games until 125,000 agent steps are played, the
/// last one to its end; 0.1 % random actions.
EvaluationPlan fixed_steps(const EnvConfig& env);

/// Returns the observations, [N, stack, ...] uint8: a view of the stack, valid as long as it.
torch::Tensor stack_tensor(const FrameStack& stack, std::size_t num_envs, const ObservationSpace& space);
/// Returns what World::step() takes for an agent's actions, [N, A] float32 or [N] int64, contiguous on the
/// CPU: a view that lasts as long as they do.
Actions view_of_actions(const torch::Tensor& actions);

/// Plays the games, each in its own environment. A lost life that ends the agent's episode clears the stack
/// and does not end the game. Throws what `decide` and the environments throw, and std::invalid_argument for
/// actions or values of another shape or type.
Evaluation evaluate(const Decide& decide, const EvaluationPlan& plan);

/// Plays the plan's games in sequence, each in a new world with a seed derived from the plan's and its
/// number. Of the plan only games, seed, ended, stepped and stop apply: the rest is Atari's. Throws what
/// `decide` and the world throw, and std::invalid_argument for actions or values of another shape or type and
/// for a reward that is not finite.
Evaluation evaluate(const Decide& decide, const MakeWorld& make_world, const EvaluationPlan& plan);

/// The smallest reward that at least the fraction `quantile`, 0 to 1, of the agent steps did not exceed.
/// Throws std::invalid_argument for no rewards.
float reward_quantile(const std::map<float, std::int64_t>& rewards, double quantile);

/// Three tables: X.csv with a row per game (episode,return,length,frames and, where several are played in
/// turn, game), X_events.csv with a row for each of the 18 joystick events (event,count), and X_rewards.csv
/// with the rewards of the agent steps at 101 quantiles (quantile,reward). Makes the folder. Throws
/// std::invalid_argument for an evaluation without games, and std::runtime_error where it cannot write.
void write_evaluation(const std::filesystem::path& csv, const Evaluation& evaluation);

/// Statistics of a set of returns.
struct ReturnSummary {
    double mean = 0;                           // over the games
    double standard_deviation = 0;             // divided by n
    double median = 0;                         // of an even number: the mean of the middle two
    double interquartile_mean = 0;             // without the lowest and the highest quarter, rounded down
    double minimum = 0;                        // the worst game
    double maximum = 0;                        // the best game
    std::optional<double> human_normalised{};  // (mean - random) / (human - random), where both are known
};

/// Throws std::invalid_argument for no games.
ReturnSummary summarise(const Evaluation& evaluation, std::string_view game);

}  // namespace cale
