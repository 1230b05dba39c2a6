// The evaluations of a run that `cale evaluate FOLDER` makes and `cale report --score evaluation` reads, in
// the run's folder:
//
//     evaluations/fixed_episodes-1a2b3c4d/   named after the protocol and the checksum of protocol.json
//         protocol.json                      how the games are played
//         step_000100000.csv, _events.csv, _rewards.csv, .json   of the checkpoint of that agent step
//         step_000100000.partial             the games that ended so far, until the others have
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "evaluate/evaluation.h"
#include "storage/append_file.h"

namespace cale {

/// The folders of the runs that lie in `folder`, at any depth, in the order of their names, in which numbers
/// count as numbers. A run has a config.yaml beside an episodes.csv or checkpoints. A link to a run counts as
/// one; links to other folders are not followed. Throws std::filesystem::filesystem_error.
std::vector<std::filesystem::path> run_folders(const std::filesystem::path& folder);

/// What the games of an evaluation follow from, beside the policy and the environment that it was trained in.
struct EvaluationProtocol {
    std::string name{};                      // "fixed_episodes"
    std::int64_t games = 0;                  // see EvaluationPlan
    std::int64_t steps = 0;                  // the same
    double epsilon = 0;                      // the same
    std::optional<std::int64_t> noop_max{};  // none: the environment's
    std::uint64_t seed = 1;                  // of the games
    std::string choice{};                    // "greedy", "sampled", or "own": as the agent's own evaluations
    std::map<std::string, std::string>
        settings{};  // of the environment, that are changed: "env.threshold" -> "0.3"
};

/// evaluations/<name>-<checksum> in the run's folder, which need not exist.
std::filesystem::path evaluations_folder(const std::filesystem::path& run,
                                         const EvaluationProtocol& protocol);

/// Makes that folder, with its protocol.json, unless it is there. Throws std::system_error, and
/// std::runtime_error where the folder holds another protocol.
void make_evaluations_folder(const std::filesystem::path& folder, const EvaluationProtocol& protocol);

/// What an evaluation came to, as its step_N.json has it.
struct EvaluationResult {
    std::int64_t agent_steps = 0;  // of the checkpoint
    std::int64_t games = 0;
    double mean = 0;
    double standard_deviation = 0;
    double median = 0;
    std::optional<double> human_normalised{};
};

/// The finished evaluation of the checkpoint of that agent step in evaluations_folder(); none where there is
/// none that can be read.
std::optional<EvaluationResult> evaluation_result(const std::filesystem::path& folder,
                                                  std::int64_t agent_steps);

/// "step_000100000"
std::string evaluation_name(std::int64_t agent_steps);

/// A file of games that have ended. A process that is killed leaves all of them but those under way.
class PlayedGames {
  public:
    /// Goes on with the file of an earlier process, if there is one; half a last line is cut off.
    /// Throws std::runtime_error, here and in write(), where the disk refuses.
    explicit PlayedGames(const std::filesystem::path& file);

    /// Those that the file had, by their numbers.
    const std::map<std::int64_t, EvaluatedGame>& known() const { return known_; }
    void write(std::int64_t number, const EvaluatedGame& game);

  private:
    std::map<std::int64_t, EvaluatedGame> known_;
    AppendFile file_;
};

/// A header and a line for each run: agent steps, games, mean, standard deviation, median and the
/// human-normalised mean; in their place, why it has no result.
struct EvaluationRow {
    std::string run{};
    std::optional<EvaluationResult> result{};
    std::string failure{};  // a sentence, where there is no result
};
std::string evaluation_table(const std::vector<EvaluationRow>& rows);

}  // namespace cale
