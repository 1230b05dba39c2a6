// The evaluations of a run that `cale evaluate FOLDER` makes and `cale report --score evaluation` reads, in
// the run's folder:
//
//     evaluations/fixed_episodes-1a2b3c4d/   named after the protocol and the checksum of protocol.json
//         protocol.json                      how the games are played
//         step_000100000.csv, _events.csv, _rewards.csv, .json   of the checkpoint of that agent step
//         step_000100000-5ef2a0c1.partial    the games that have ended so far, of that policy
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "evaluate/evaluation.h"
#include "storage/append_file.h"

namespace cale {

/// Whether `folder` is a run's: it has a config.yaml beside an episodes.csv or checkpoints.
bool is_run(const std::filesystem::path& folder);

/// Returns the folders of the runs in `folder`, at any depth, sorted by name with numbers compared as
/// numbers. A link to a run counts as one; links to other folders are not followed. Throws
/// std::filesystem::filesystem_error.
std::vector<std::filesystem::path> run_folders(const std::filesystem::path& folder);

/// Everything that determines an evaluation besides the policy and the environment that it was trained in.
struct EvaluationProtocol {
    std::string name{};                      // "fixed_episodes"
    std::int64_t games = 0;                  // see EvaluationPlan
    std::int64_t steps = 0;                  // the same
    double epsilon = 0;                      // the same
    std::optional<std::int64_t> noop_max{};  // none: the environment's
    std::uint64_t seed = 1;                  // of the games
    std::string choice{};                    // "greedy", "sampled", or "own": as in the run's own evaluations
    std::map<std::string, std::string>
        settings{};  // of the environment, that are changed: "env.threshold" -> "0.3"
};

/// evaluations/<name>-<checksum> in the run's folder, which need not exist.
std::filesystem::path evaluations_folder(const std::filesystem::path& run,
                                         const EvaluationProtocol& protocol);

/// Makes that folder, with its protocol.json, unless it exists. Throws std::system_error, and
/// std::runtime_error where the folder holds another protocol.
void make_evaluations_folder(const std::filesystem::path& folder, const EvaluationProtocol& protocol);

/// The result of an evaluation, as stored in its step_N.json.
struct EvaluationResult {
    std::int64_t agent_steps = 0;  // of the checkpoint
    std::int64_t games = 0;
    double mean = 0;
    double standard_deviation = 0;
    double median = 0;
    std::optional<double> human_normalised{};
};

/// Returns the finished evaluation of the checkpoint of that agent step in evaluations_folder(); none if
/// there is no readable one with a row for each of its games. Returns none, too, where the evaluation is of
/// another policy than `policy`, a checksum_text(): the run was made again.
std::optional<EvaluationResult> evaluation_result(const std::filesystem::path& folder,
                                                  std::int64_t agent_steps, std::string_view policy = {});

/// The file of the games that have ended of that checkpoint's evaluation.
std::filesystem::path partial_evaluation(const std::filesystem::path& folder, std::int64_t agent_steps,
                                         std::string_view policy);

/// A file of the games that have ended. A killed process loses only the unfinished games.
class PlayedGames {
  public:
    /// Continues the file of an earlier process, if there is one; an incomplete last line is cut off. Throws
    /// std::runtime_error, here and in write(), if writing fails.
    explicit PlayedGames(const std::filesystem::path& file);

    /// Returns the games that the file contained, by number.
    const std::map<std::int64_t, EvaluatedGame>& known() const { return known_; }
    void write(std::int64_t number, const EvaluatedGame& game);

  private:
    std::map<std::int64_t, EvaluatedGame> known_;
    AppendFile file_;
};

/// A run and its evaluation.
struct EvaluationRow {
    std::string run{};
    std::optional<EvaluationResult> result{};
    std::string failure{};  // a sentence, where there is no result
};

/// Returns a header and a line for each run: agent steps, games, mean, standard deviation, median and the
/// human-normalised mean; in their place, why it has no result.
std::string evaluation_table(const std::vector<EvaluationRow>& rows);

}  // namespace cale
