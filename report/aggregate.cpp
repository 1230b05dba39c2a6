#include "report/aggregate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "cale/cores.h"
#include "cale/seeds.h"

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

std::vector<std::uint32_t> sizes_of(const Scores& scores) {
    std::vector<std::uint32_t> sizes;
    for (const auto& runs : scores) sizes.push_back(static_cast<std::uint32_t>(runs.size()));
    return sizes;
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

void resample(Draws draws, const std::vector<std::uint32_t>& sizes, std::vector<std::uint32_t>& counts) {
    std::fill(counts.begin(), counts.end(), 0u);
    auto* stratum = counts.data();
    for (const auto size : sizes) {
        for (std::uint32_t i = 0; i < size; ++i) ++stratum[draws.below(size)];
        stratum += size;
    }
}

/// Runs work(begin, end) on parts of [0, count), each on a thread of its own.
void in_parallel(std::int64_t count, int threads,
                 const std::function<void(std::int64_t, std::int64_t)>& work) {
    constexpr std::int64_t kWorthAThread = 2'000;
    const std::int64_t wanted = threads > 0 ? threads : core_count();
    const auto parts = std::clamp<std::int64_t>(count / kWorthAThread, 1, wanted);
    std::vector<std::jthread> workers;
    for (std::int64_t part = 1; part < parts; ++part)
        workers.emplace_back(work, count * part / parts, count * (part + 1) / parts);
    work(0, count / parts);
}

/// `statistic` writes its width() values for the runs of a resample, given as Counts: how often each
/// score is in it, the strata one after the other. The estimate is its value where each is once.
template <class Statistic>
std::vector<Estimate> bootstrapped(const Statistic& statistic, const std::vector<std::uint32_t>& sizes,
                                   const Bootstrap& config) {
    if (config.resamples < 1)
        throw std::invalid_argument(fmt::format("{} resamples: at least one is needed", config.resamples));
    if (!(config.confidence > 0 && config.confidence < 1))
        throw std::invalid_argument(
            fmt::format("a confidence of {}: it lies between 0 and 1", config.confidence));
    const std::size_t width = statistic.width();
    const auto total = std::accumulate(sizes.begin(), sizes.end(), std::size_t{0});
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
            resample(Draws(config.seed, r), sizes, counts);
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

/// All four metrics. With the scores in ascending order once and for all, a resample needs no sorting.
class AggregateStatistic {
  public:
    explicit AggregateStatistic(const Scores& scores)
        : scores_(flattened(scores)), order_(ascending(scores_)), sizes_(sizes_of(scores)) {}

    std::size_t width() const { return kMetricCount; }

    void operator()(Counts counts, std::span<double> out) {
        const std::size_t total = scores_.size(), cut = total / 4;
        double middle = 0, gap = 0;
        std::size_t seen = 0;
        for (const auto i : order_) {
            const std::size_t first = std::max(seen, cut), last = std::min(seen + counts[i], total - cut);
            if (first < last) middle += static_cast<double>(last - first) * scores_[i];
            gap += counts[i] * (1 - std::min(scores_[i], 1.0));
            seen += counts[i];
        }
        game_means_.clear();
        double mean = 0;
        std::size_t start = 0;
        for (const auto size : sizes_) {
            double sum = 0;
            for (auto i = start; i < start + size; ++i) sum += counts[i] * scores_[i];
            game_means_.push_back(sum / size);
            mean += game_means_.back();
            start += size;
        }
        out[static_cast<std::size_t>(Metric::iqm)] = middle / static_cast<double>(total - 2 * cut);
        out[static_cast<std::size_t>(Metric::median)] = median_of(game_means_);
        out[static_cast<std::size_t>(Metric::mean)] = mean / static_cast<double>(sizes_.size());
        out[static_cast<std::size_t>(Metric::optimality_gap)] = gap / static_cast<double>(total);
    }

  private:
    std::vector<double> scores_;
    std::vector<std::uint32_t> order_;
    std::vector<std::uint32_t> sizes_;
    std::vector<double> game_means_{};  // of the resample at hand
};

class MeanStatistic {
  public:
    explicit MeanStatistic(const std::vector<double>& runs) : runs_(runs) {}

    std::size_t width() const { return 1; }

    void operator()(Counts counts, std::span<double> out) {
        double sum = 0;
        for (std::size_t i = 0; i < runs_.size(); ++i) sum += counts[i] * runs_[i];
        out[0] = sum / static_cast<double>(runs_.size());
    }

  private:
    std::vector<double> runs_;
};

class ProfileStatistic {
  public:
    ProfileStatistic(const Scores& scores, const std::vector<double>& thresholds) {
        const auto all = flattened(scores);
        order_ = ascending(all);
        for (const double threshold : thresholds) {
            const auto first = std::partition_point(order_.begin(), order_.end(),
                                                    [&](auto i) { return !(all[i] > threshold); });
            not_above_.push_back(static_cast<std::size_t>(first - order_.begin()));
        }
    }

    std::size_t width() const { return not_above_.size(); }

    void operator()(Counts counts, std::span<double> out) {
        std::size_t rank = 0, below = 0;
        for (std::size_t i = 0; i < not_above_.size(); ++i) {
            for (; rank < not_above_[i]; ++rank) below += counts[order_[rank]];
            out[i] = 1 - static_cast<double>(below) / static_cast<double>(order_.size());
        }
    }

  private:
    std::vector<std::uint32_t> order_{};
    std::vector<std::size_t> not_above_{};  // by threshold: how many of `order_` are not above it
};

/// The strata: x's games, then y's.
class ImprovementStatistic {
  public:
    ImprovementStatistic(const Scores& x, const Scores& y) {
        std::uint32_t x_start = 0;
        auto y_start = static_cast<std::uint32_t>(flattened(x).size());
        for (std::size_t game = 0; game < x.size(); ++game) {
            add_game(x[game], y[game], x_start, y_start);
            x_start += static_cast<std::uint32_t>(x[game].size());
            y_start += static_cast<std::uint32_t>(y[game].size());
        }
    }

    std::size_t width() const { return 1; }

    void operator()(Counts counts, std::span<double> out) {
        double probability = 0;
        for (const auto& game : games_) {
            double wins = 0, y_below = 0, x_equal = 0, y_equal = 0;
            for (const auto& run : game.ascending) {
                (run.of_x ? x_equal : y_equal) += counts[run.index];
                if (!run.last_of_equals) continue;
                wins += x_equal * (y_below + y_equal / 2);
                y_below += y_equal;
                x_equal = y_equal = 0;
            }
            probability += wins / game.pairs;
        }
        out[0] = probability / static_cast<double>(games_.size());
    }

  private:
    struct Run {
        double score;
        std::uint32_t index;
        bool of_x;
        bool last_of_equals;
    };
    struct Ranking {  // of the runs of one game
        std::vector<Run> ascending{};
        double pairs = 0;
    };

    void add_game(const std::vector<double>& x, const std::vector<double>& y, std::uint32_t x_start,
                  std::uint32_t y_start) {
        Ranking game;
        game.pairs = static_cast<double>(x.size() * y.size());
        for (const double score : x) game.ascending.push_back({score, x_start++, true, false});
        for (const double score : y) game.ascending.push_back({score, y_start++, false, false});
        auto& runs = game.ascending;
        std::sort(runs.begin(), runs.end(), [](const Run& a, const Run& b) { return a.score < b.score; });
        for (std::size_t i = 0; i < runs.size(); ++i)
            runs[i].last_of_equals = i + 1 == runs.size() || runs[i + 1].score != runs[i].score;
        games_.push_back(std::move(game));
    }

    std::vector<Ranking> games_{};
};

}  // namespace

std::span<const std::string_view> names_of(Metric) {
    static constexpr std::array<std::string_view, kMetricCount> kNames{"iqm", "median", "mean",
                                                                       "optimality_gap"};
    return kNames;
}

double human_normalised(double score, const Game& game) {
    if (!game.random_score || !game.human_score)
        throw std::invalid_argument(fmt::format("{} has no human score to normalise with", game.name));
    return (score - *game.random_score) / (*game.human_score - *game.random_score);
}

Aggregates aggregate(const Scores& scores, const Bootstrap& bootstrap) {
    check(scores);
    const auto estimates = bootstrapped(AggregateStatistic(scores), sizes_of(scores), bootstrap);
    Aggregates aggregates;
    std::copy(estimates.begin(), estimates.end(), aggregates.begin());
    return aggregates;
}

Estimate mean_of_runs(const std::vector<double>& runs, const Bootstrap& bootstrap) {
    check({runs});
    return bootstrapped(MeanStatistic(runs), sizes_of({runs}), bootstrap).front();
}

std::vector<Estimate> performance_profile(const Scores& scores, const std::vector<double>& thresholds,
                                          const Bootstrap& bootstrap) {
    check(scores);
    if (!std::is_sorted(thresholds.begin(), thresholds.end()))
        throw std::invalid_argument("the thresholds of a performance profile must ascend");
    return bootstrapped(ProfileStatistic(scores, thresholds), sizes_of(scores), bootstrap);
}

Estimate probability_of_improvement(const Scores& x, const Scores& y, const Bootstrap& bootstrap) {
    check(x);
    check(y);
    if (x.size() != y.size())
        throw std::invalid_argument(
            fmt::format("runs on {} games cannot be compared with runs on {}: the games must be the same",
                        x.size(), y.size()));
    auto sizes = sizes_of(x);
    const auto sizes_of_y = sizes_of(y);
    sizes.insert(sizes.end(), sizes_of_y.begin(), sizes_of_y.end());
    return bootstrapped(ImprovementStatistic(x, y), sizes, bootstrap).front();
}

}  // namespace cale
