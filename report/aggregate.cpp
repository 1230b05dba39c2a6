#include "report/aggregate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <future>
#include <iterator>
#include <numeric>
#include <stdexcept>

#include "cale/cores.h"
#include "cale/seeds.h"
#include "report/ranges.h"

namespace cale {
namespace {

using Counts = std::span<const std::uint32_t>;  // how often each score is in a resample

void check(const Scores& scores) {
    if (scores.empty()) throw std::invalid_argument("there is no game to aggregate over");
    for (const auto& runs : scores) {
        if (runs.empty()) throw std::invalid_argument("a game without a run has no score to aggregate");
        if (!std::all_of(runs.begin(), runs.end(), [](double score) { return std::isfinite(score); }))
            throw std::invalid_argument("a score to aggregate is not a finite number");
    }
}

std::vector<double> flattened(const Scores& scores) {
    std::vector<double> all;
    for (const auto& runs : scores) all.insert(all.end(), runs.begin(), runs.end());
    return all;
}

/// The indices of `values` in ascending order of value.
std::vector<std::uint32_t> ascending(const std::vector<double>& values) {
    std::vector<std::uint32_t> order(values.size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), [&](auto a, auto b) { return values[a] < values[b]; });
    return order;
}

/// Of both middle values where their number is even. Reorders the values.
double median_of(std::vector<double>& values) {
    const auto middle = values.begin() + std::ssize(values) / 2;
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2 == 1) return *middle;
    return (*std::max_element(values.begin(), middle) + *middle) / 2;
}

/// Between neighbours, in a straight line. Reorders the values.
double quantile_of(std::span<double> values, double quantile) {
    const double position = quantile * static_cast<double>(values.size() - 1);
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(position);
    std::nth_element(values.begin(), at, values.end());
    const double fraction = position - std::floor(position);
    if (fraction == 0) return *at;
    return *at + fraction * (*std::min_element(at + 1, values.end()) - *at);
}

/// The draws of one resample: splitmix64 from a place that follows from (seed, resample), each of
/// its words for two draws.
class Draws {
  public:
    Draws(std::uint64_t seed, std::int64_t resample)
        : state_(mixed(mixed(seed) + static_cast<std::uint64_t>(resample))) {}

    /// 0 to n - 1. Off uniform by less than n / 2^32.
    std::uint32_t below(std::uint32_t n) {
        word_ = half_used_ ? word_ >> 32 : mixed(state_ += 0x9E3779B97F4A7C15u);
        half_used_ = !half_used_;
        return static_cast<std::uint32_t>(((word_ & 0xFFFFFFFFu) * n) >> 32);
    }

  private:
    std::uint64_t state_;
    std::uint64_t word_ = 0;
    bool half_used_ = false;
};

void resample(Draws draws, const Scores& strata, std::vector<std::uint32_t>& counts) {
    std::fill(counts.begin(), counts.end(), 0u);
    auto* stratum = counts.data();
    for (const auto& runs : strata) {
        const auto size = static_cast<std::uint32_t>(runs.size());
        for (std::uint32_t i = 0; i < size; ++i) ++stratum[draws.below(size)];
        stratum += size;
    }
}

/// Runs work(begin, end) on parts of [0, count), each on a thread of its own. Throws what one of them throws.
void in_parallel(std::int64_t count, int threads,
                 const std::function<void(std::int64_t, std::int64_t)>& work) {
    constexpr std::int64_t kWorthAThread = 2'000;
    const std::int64_t wanted = threads > 0 ? threads : core_count();
    const auto parts = std::clamp<std::int64_t>(count / kWorthAThread, 1, wanted);
    std::vector<std::future<void>> workers;
    for (std::int64_t part = 1; part < parts; ++part)
        workers.push_back(
            std::async(std::launch::async, work, count * part / parts, count * (part + 1) / parts));
    work(0, count / parts);
    for (auto& worker : workers) worker.get();
}

/// `statistic` writes its `width` values for the runs of a resample, given as Counts: how often each score is
/// in it, the strata one after the other. The estimate is its value where each is once.
template <class Statistic>
std::vector<Estimate> bootstrapped(const Scores& strata, const Bootstrap& config, std::size_t width,
                                   const Statistic& statistic) {
    if (config.resamples < 1)
        throw std::invalid_argument(fmt::format("{} resamples: at least one is needed", config.resamples));
    if (!(config.confidence > 0 && config.confidence < 1))
        throw std::invalid_argument(
            fmt::format("a confidence of {}: it lies between 0 and 1", config.confidence));
    const auto total = flattened(strata).size();
    const auto resamples = static_cast<std::size_t>(config.resamples);

    std::vector<double> values(width);
    auto of_all_runs = statistic;
    of_all_runs(std::vector<std::uint32_t>(total, 1u), values);

    std::vector<double> replicates(width * resamples);  // value by value
    in_parallel(config.resamples, config.threads, [&](std::int64_t begin, std::int64_t end) {
        auto own = statistic;
        std::vector<std::uint32_t> counts(total);
        std::vector<double> row(width);
        for (auto r = begin; r < end; ++r) {
            resample(Draws(config.seed, r), strata, counts);
            own(counts, row);
            for (std::size_t i = 0; i < width; ++i)
                replicates[i * resamples + static_cast<std::size_t>(r)] = row[i];
        }
    });

    std::vector<Estimate> estimates;
    const double tail = (1 - config.confidence) / 2;
    for (std::size_t i = 0; i < width; ++i) {
        const auto of_value = std::span(replicates).subspan(i * resamples, resamples);
        estimates.push_back({values[i], quantile_of(of_value, tail), quantile_of(of_value, 1 - tail)});
    }
    return estimates;
}

/// A run of x or y among those of its game.
struct RankedRun {
    double score;
    std::uint32_t index;  // in a resample's counts
    bool of_x;
    bool last_of_equals;
};

/// The runs of each game, in ascending order. The strata: x's games, then y's.
std::vector<std::vector<RankedRun>> ranked(const Scores& x, const Scores& y) {
    std::vector<std::vector<RankedRun>> games(x.size());
    std::uint32_t index = 0;
    for (const bool of_x : {true, false})
        for (std::size_t game = 0; game < games.size(); ++game)
            for (const double score : (of_x ? x : y)[game])
                games[game].push_back({score, index++, of_x, false});
    for (auto& runs : games) {
        std::ranges::sort(runs, {}, &RankedRun::score);
        for (std::size_t i = 0; i < runs.size(); ++i)
            runs[i].last_of_equals = i + 1 == runs.size() || runs[i + 1].score != runs[i].score;
    }
    return games;
}

}  // namespace

std::span<const std::string_view> names_of(Metric) {
    static constexpr std::array<std::string_view, kMetricCount> kNames{"iqm", "median", "mean",
                                                                       "optimality_gap"};
    return kNames;
}

bool nearly_equal(double low, double high) {
    return high - low <= 1e-9 * std::max(std::abs(low), std::abs(high));
}

double human_normalised(double score, const Game& game) {
    if (!game.random_score || !game.human_score)
        throw std::invalid_argument(fmt::format("{} has no human score to normalise with", game.name));
    return (score - *game.random_score) / (*game.human_score - *game.random_score);
}

Aggregates aggregate(const Scores& scores, const Bootstrap& bootstrap) {
    check(scores);
    const auto all = flattened(scores);
    const auto order = ascending(all);  // so that a resample needs no sorting
    const auto statistic = [&, game_means = std::vector<double>()](Counts counts,
                                                                   std::span<double> out) mutable {
        const std::size_t total = all.size(), cut = total / 4;
        double middle = 0, gap = 0;
        std::size_t seen = 0;
        for (const auto i : order) {
            const std::size_t first = std::max(seen, cut), last = std::min(seen + counts[i], total - cut);
            if (first < last) middle += static_cast<double>(last - first) * all[i];
            gap += counts[i] * (1 - std::min(all[i], 1.0));
            seen += counts[i];
        }
        game_means.clear();
        double mean = 0;
        auto count = counts.begin();
        for (const auto& runs : scores) {
            double sum = 0;
            for (const double score : runs) sum += *count++ * score;
            game_means.push_back(sum / static_cast<double>(runs.size()));
            mean += game_means.back();
        }
        out[static_cast<std::size_t>(Metric::iqm)] = middle / static_cast<double>(total - 2 * cut);
        out[static_cast<std::size_t>(Metric::median)] = median_of(game_means);
        out[static_cast<std::size_t>(Metric::mean)] = mean / static_cast<double>(scores.size());
        out[static_cast<std::size_t>(Metric::optimality_gap)] = gap / static_cast<double>(total);
    };
    const auto estimates = bootstrapped(scores, bootstrap, kMetricCount, statistic);
    Aggregates aggregates;
    std::ranges::copy(estimates, aggregates.begin());
    return aggregates;
}

Estimate mean_of_runs(const std::vector<double>& runs, const Bootstrap& bootstrap) {
    check({runs});
    const auto mean = [&](Counts counts, std::span<double> out) {
        out[0] = std::inner_product(runs.begin(), runs.end(), counts.begin(), 0.0) /
                 static_cast<double>(runs.size());
    };
    return bootstrapped({runs}, bootstrap, 1, mean).front();
}

std::vector<Estimate> performance_profile(const Scores& scores, const std::vector<double>& thresholds,
                                          const Bootstrap& bootstrap) {
    check(scores);
    if (!std::is_sorted(thresholds.begin(), thresholds.end()))
        throw std::invalid_argument("the thresholds of a performance profile must ascend");
    const auto all = flattened(scores);
    const auto order = ascending(all);
    const auto not_above = mapped(thresholds, [&](double threshold) {  // how many of `order` are
        return std::ranges::partition_point(order, [&](auto i) { return !(all[i] > threshold); }) -
               order.begin();
    });
    const auto part_above = [&](Counts counts, std::span<double> out) {
        std::size_t below = 0;
        auto next = order.begin();
        for (std::size_t i = 0; i < out.size(); ++i) {
            for (; next < order.begin() + not_above[i]; ++next) below += counts[*next];
            out[i] = 1 - static_cast<double>(below) / static_cast<double>(order.size());
        }
    };
    return bootstrapped(scores, bootstrap, thresholds.size(), part_above);
}

Estimate probability_of_improvement(const Scores& x, const Scores& y, const Bootstrap& bootstrap) {
    check(x);
    check(y);
    if (x.size() != y.size())
        throw std::invalid_argument(
            fmt::format("runs on {} games cannot be compared with runs on {}: the games must be the same",
                        x.size(), y.size()));
    const auto games = ranked(x, y);
    const auto improvement = [&](Counts counts, std::span<double> out) {
        double probability = 0;
        for (std::size_t game = 0; game < games.size(); ++game) {
            double wins = 0, y_below = 0, x_equal = 0, y_equal = 0;
            for (const auto& run : games[game]) {
                (run.of_x ? x_equal : y_equal) += counts[run.index];
                if (!run.last_of_equals) continue;
                wins += x_equal * (y_below + y_equal / 2);
                y_below += y_equal;
                x_equal = y_equal = 0;
            }
            probability += wins / static_cast<double>(x[game].size() * y[game].size());
        }
        out[0] = probability / static_cast<double>(games.size());
    };
    auto strata = x;
    strata.insert(strata.end(), y.begin(), y.end());
    return bootstrapped(strata, bootstrap, 1, improvement).front();
}

}  // namespace cale
