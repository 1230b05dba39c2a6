// Search for settings: sets of them are drawn at random (Bergstra & Bengio 2012), and either all are trained
// to the end, or again and again the better half is trained twice as far (successive halving: Jamieson &
// Talwalkar 2016).
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "sweep/plan.h"
#include "sweep/search_space.h"
#include "sweep/sweep_file.h"

namespace cale {

enum class SearchMethod { none, random, halving };

/// Returns the agent steps at which samples are compared, the last one the end of the runs. `random`: it
/// alone. `halving`: first_steps, an eighth of the run unless the space says otherwise, then twice as many
/// each time.
std::vector<std::int64_t> rungs(SearchMethod method, const SearchSpace& space, std::int64_t total_steps);

/// Returns the mean return of the games that ended in the newest quarter of a run's first `steps` agent
/// steps, where none has ended that of the last one before; none without a game. `folder` is the run's.
std::optional<double> search_score(const std::filesystem::path& folder, std::int64_t steps);

/// What the runs of a sample came to.
struct SampleScore {
    std::int64_t sample = 0;
    std::int64_t steps = 0;                                 // agent steps at which it was last compared
    double rank = 0;                                        // 1 is the best: the mean over the combinations
    std::map<std::string, std::optional<double>> scores{};  // by SweepRun::combination
    std::set<std::string> failed{};                         // combinations whose run did not come so far
};

/// Fills in the ranks and sorts by them, and by number where they are equal. Scores of different games do not
/// compare, so samples are ranked in each combination, those with equal scores alike, a sample without a
/// score, in which no game has ended, behind them, and one whose run failed last.
void rank(std::vector<SampleScore>& samples);

/// What to search, and with what.
struct Search {
    const Sweep& sweep;
    std::span<const PlannedRun> runs;
    SearchMethod method = SearchMethod::random;
    std::filesystem::path folder{};  // of the runs' folders
    /// Trains these runs and returns the exit code of the sweep so far.
    std::function<int(std::span<const PlannedRun>)> train{};
};

/// Throws ConfigError where the runs cannot be compared: they are of different lengths, or are to pause and
/// would not continue as if they had not (without their replay, or in real time).
void check_search(const Search& search);

/// Returns the runs that are trained next, up to where they pause: those of the first rung that has some left
/// to train; none where the search is done.
std::vector<PlannedRun> next_runs(const Search& search);

/// Prints a line for each run whose folder holds another run or, with halving, one that stopped without its
/// replay and would not continue as if it had not. Returns whether there is any.
bool refuse_others(const Search& search, std::FILE* out);

/// Trains the samples, prints how they compare to `out`, and leaves search.csv, with every sample, and
/// search_best.yaml, the settings of the best one for --config, where any has a score, in the folder. Returns
/// the exit code: 0 done, 1 some runs failed, which counts as the worst score, or are refused, and then
/// nothing is trained, 130 interrupted; the same call then continues. Throws as check_search() does, and
/// std::runtime_error for a damaged episodes.csv.
int run_search(const Search& search, std::FILE* out);

}  // namespace cale
