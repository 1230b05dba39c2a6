// The learning curve of one run: what every episode returned, and their moving average.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "report/picture.h"

namespace cale {

/// The episodes of a run that have ended, in that order.
struct EpisodeHistory {
    std::string env_id{};  // "ALE/Pong-v5"; empty if the file does not say
    std::string agent{};   // "sac"; empty if the file does not say
    std::optional<std::uint64_t> seed{};
    std::vector<double> steps{};            // agent steps of the run when the episode ended
    std::vector<double> returns{};          // undiscounted, unclipped
    std::optional<std::size_t> cut_line{};  // of the file, in whose middle it ends
};

/// Reads the columns `r` and `global_step` of an episodes.csv; where the latter is missing, as in a
/// Monitor file of Stable-Baselines3, the sum of the lengths `l`. An incomplete last line is no episode: see
/// `cut_line`. `bytes`: as if the file ended there. Throws std::runtime_error naming the file and the line at
/// fault.
EpisodeHistory read_episodes(const std::filesystem::path& path, std::size_t bytes = std::string::npos);

/// Element i is the mean of the `window` newest values up to i, of fewer at the beginning.
std::vector<double> moving_average(const std::vector<double>& values, std::size_t window);

/// A value that changes at these agent steps, which ascend, and stays between them.
struct StepCurve {
    std::vector<double> steps{};
    std::vector<double> values{};
};

/// The mean return of the episodes that ended in the newest `window` agent steps. It changes where an episode
/// ends and where one leaves the window; where none is left in it, the newest counts. The last step is `end`,
/// after which no episode counts; where none ended before it, there is no step.
StepCurve mean_returns(const EpisodeHistory& episodes, double window, double end);

/// A score to compare with, drawn as a dashed horizontal line; where that would squeeze the curve
/// into less than a third of the picture, as words beside it.
struct ReferenceScore {
    std::string label;  // "human"
    double score = 0;
};

/// Thin: every return. Bold: the moving average over a tenth of the episodes, 100 at most.
Picture learning_curve(const EpisodeHistory& episodes, const std::string& title,
                       const std::vector<ReferenceScore>& references = {});

}  // namespace cale
