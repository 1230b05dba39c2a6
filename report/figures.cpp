#include "report/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <span>
#include <utility>

#include "cale/text.h"
#include "report/panel.h"
#include "report/ranges.h"
#include "report/tables.h"

namespace cale {
namespace {

constexpr double kLabelSize = 13;
constexpr double kLeft = 70, kRight = 756;  // of a single panel

/// Whether every group has an interval of its aggregates.
bool all_intervals(const Comparison& comparison) {
    return std::ranges::all_of(comparison.results, &GroupResult::has_interval);
}

/// `some`: whether any interval is shown.
std::string method_of(const Comparison& comparison, const Bootstrap& bootstrap, bool some) {
    const auto sample =
        fmt::format("{}; {}", counted(comparison.games.size(), "game"), runs_text(comparison));
    if (!some) return sample + "; no intervals, which need several runs per game";
    return fmt::format(
        "{}; {:g} % stratified bootstrap intervals{}, {} resamples", sample, 100 * bootstrap.confidence,
        all_intervals(comparison) ? "" : " of groups with several runs per game", bootstrap.resamples);
}

/// The same for curves with bands.
std::string method_of_bands(const Comparison& comparison) {
    const bool some = comparison.has_interval_of_aggregates();
    return (some ? "pointwise; " : "") + method_of(comparison, comparison.config.for_bands(), some);
}

/// A group's interval as a bar, its estimate as a line across.
void draw_interval(Picture& picture, const Panel& panel, const Estimate& estimate, double y,
                   bool with_interval, std::size_t series) {
    constexpr double kHalf = 8;
    const auto colour = series_colour(series);
    const Belonging of{.series = static_cast<int>(series)};
    const double x = panel.to_x(estimate.value);
    if (!with_interval) {
        picture.marks.push_back(disc({x, y}, 4, colour));
        picture.marks.back().of = of;
        return;
    }
    picture.areas.push_back(
        rectangle(panel.to_x(estimate.low), y - kHalf, panel.to_x(estimate.high), y + kHalf, colour, 0.55));
    picture.areas.back().of = of;
    picture.lines.push_back({{{x, y - kHalf}, {x, y + kHalf}}, kInk, 1.8, false, of});
}

void draw_vertical_grid(Picture& picture, const Panel& panel, int count) {
    constexpr double kSize = 11.5;
    const auto ticks = fitting_ticks(panel, count, kSize);
    const auto texts = tick_texts(ticks);
    for (std::size_t i = 0; i < ticks.size(); ++i) {
        draw_grid_line_at_x(picture, panel, ticks[i]);
        picture.write(texts[i], {panel.to_x(ticks[i]), panel.bottom + 17}, kFaintInk, kSize, Anchor::middle);
    }
    picture.lines.push_back({{{panel.left, panel.bottom}, {panel.right, panel.bottom}}, kFaintInk, 1});
}

constexpr double kBaselineRow = 14;

/// Horizontal dashed lines, their names to the right of the panel, none over another, nor below the panel
/// where it has a row for each.
void draw_baselines(Picture& picture, const Panel& panel, std::vector<std::pair<double, std::string>> lines) {
    constexpr double kSize = 11.5;
    std::sort(lines.begin(), lines.end(), std::greater<>());
    double highest_free = panel.top;
    auto rows_below = static_cast<double>(lines.size());
    for (const auto& [value, name] : lines) {
        const double y = panel.to_y(value), lowest = panel.bottom - --rows_below * kBaselineRow;
        const double baseline = std::max(std::min(y + 4, lowest), highest_free);
        highest_free = baseline + kBaselineRow;
        picture.lines.push_back({{{panel.left, y}, {panel.right, y}}, kFaintInk, 1.2, true});
        picture.write(name, {panel.right + 8, baseline}, kFaintInk, kSize);
    }
}

/// A panel below the groups' legend.
Panel panel_below_legend(Picture& picture, const Comparison& comparison, Interval x, Interval y,
                         double height = 320) {
    const double top = 78 + draw_legend(picture, labels_of(comparison), kLeft, kRight, 48);
    return {.left = kLeft, .top = top, .right = kRight, .bottom = top + height, .x = x, .y = y};
}

void title_axes(Picture& picture, const Panel& panel, const char* x, const char* y) {
    picture.write(y, {panel.left, panel.top - 12}, kInk, 12.5);
    picture.write(x, {panel.right, panel.bottom + 38}, kInk, 12.5, Anchor::end);
}

}  // namespace

Picture aggregate_figure(const Comparison& comparison) {
    constexpr std::array<const char*, kMetricCount> kTitles{"IQM", "Median", "Mean", "Optimality gap"};
    constexpr double kRow = 32, kBetween = 26, kPanelWidth = 172;
    auto names = labels_of(comparison);
    std::ranges::move(mapped(published(comparison), &Baseline::name), std::back_inserter(names));
    const double left = kMargin + std::max(80.0, widest(names, kLabelSize)) + 14;
    const double top = 100, bottom = top + kRow * static_cast<double>(names.size());
    Picture picture =
        titled_picture("Aggregate human-normalised scores", left + kMetricCount * (kPanelWidth + kBetween));
    for (std::size_t row = 0; row < names.size(); ++row) {
        const double y = top + kRow * (static_cast<double>(row) + 0.5);
        picture.write(names[row], {left - 14, y + 4.5}, kInk, kLabelSize, Anchor::end);
    }
    for (std::size_t m = 0; m < kMetricCount; ++m) {
        std::vector<double> values;
        for (const auto& result : comparison.results) {
            const auto& [value, low, high] = result.aggregates[m];
            values.insert(values.end(), {value, low, high});
        }
        for (const auto& result : comparison.baselines) values.push_back(result.aggregates[m].value);
        const double start = left + static_cast<double>(m) * (kPanelWidth + kBetween);
        const Panel panel{
            .left = start, .top = top, .right = start + kPanelWidth, .bottom = bottom, .x = room_for(values)};
        draw_vertical_grid(picture, panel, 4);
        picture.write(kTitles[m], {start, top - 24}, kInk, 13.5, Anchor::start, true);
        picture.write(m + 1 == kMetricCount ? "lower is better" : "higher is better", {start, top - 9},
                      kFaintInk, 11);
        double y = top + kRow / 2;
        for (std::size_t i = 0; i < comparison.results.size(); ++i, y += kRow) {
            const auto& result = comparison.results[i];
            draw_interval(picture, panel, result.aggregates[m], y, result.has_interval(), i);
        }
        for (const auto& result : comparison.baselines) {
            picture.marks.push_back(diamond({panel.to_x(result.aggregates[m].value), y}, 6, kFaintInk));
            y += kRow;
        }
    }
    finish_picture(
        picture, bottom + 34,
        method_of(comparison, comparison.config.bootstrap, comparison.has_interval_of_aggregates()) +
            (comparison.baselines.empty() ? ""
                                          : "; diamonds: published mean scores per game, without intervals"));
    return picture;
}

Picture profile_figure(const Comparison& comparison) {
    Picture picture = titled_picture("Performance profiles", kRight + kMargin);
    const auto panel = panel_below_legend(picture, comparison, {0, comparison.thresholds.back()}, {0, 1});
    draw_axes(picture, panel, 8, 5);
    for (std::size_t i = 0; i < comparison.results.size(); ++i)
        draw_curve(picture, panel, comparison.thresholds, comparison.results[i].profile, i,
                   comparison.results[i].has_interval());
    title_axes(picture, panel, "human-normalised score", "fraction of runs with a higher score");
    auto method = method_of_bands(comparison);
    const auto has_more = [](const GroupResult& result) { return result.profile.back().value > 0; };
    if (std::ranges::any_of(comparison.results, has_more))
        method += fmt::format("; some runs score more than {:g}", comparison.thresholds.back());
    finish_picture(picture, panel.bottom + 50, method);
    return picture;
}

Picture improvement_figure(const Comparison& comparison) {
    constexpr double kRow = 30, kTop = 96, kPanelWidth = 380;
    // The number of pairs grows with the square of the groups'.
    constexpr std::size_t kMostPairs = 100;
    const auto pairs =
        std::span(comparison.improvements).first(std::min(comparison.improvements.size(), kMostPairs));
    const auto firsts = mapped(pairs, [&](const auto& pair) { return comparison.results[pair.x].label; });
    const auto seconds = mapped(pairs, [&](const auto& pair) { return comparison.results[pair.y].label; });
    const double left = kMargin + std::max(60.0, widest(firsts, kLabelSize)) + 14;
    const Panel panel{.left = left,
                      .top = kTop,
                      .right = left + kPanelWidth,
                      .bottom = kTop + kRow * static_cast<double>(firsts.size())};
    Picture picture =
        titled_picture("Probability of improvement",
                       panel.right + 14 + std::max(60.0, widest(seconds, kLabelSize)) + kMargin);
    draw_vertical_grid(picture, panel, 5);
    picture.lines.push_back(
        {{{panel.to_x(0.5), kTop}, {panel.to_x(0.5), panel.bottom}}, kFaintInk, 1.2, true});
    picture.write("X", {left - 14, kTop - 12}, kInk, kLabelSize, Anchor::end, true);
    picture.write("P(X > Y)", {(left + panel.right) / 2, kTop - 12}, kInk, kLabelSize, Anchor::middle, true);
    picture.write("Y", {panel.right + 14, kTop - 12}, kInk, kLabelSize, Anchor::start, true);
    for (std::size_t i = 0; i < firsts.size(); ++i) {
        const double y = kTop + kRow * (static_cast<double>(i) + 0.5);
        picture.write(firsts[i], {left - 14, y + 4.5}, kInk, kLabelSize, Anchor::end);
        picture.write(seconds[i], {panel.right + 14, y + 4.5}, kInk, kLabelSize);
        draw_interval(picture, panel, pairs[i].probability, y, pairs[i].has_interval, pairs[i].x);
    }
    auto method = method_of(comparison, comparison.config.bootstrap, comparison.has_interval_of_a_pair());
    if (pairs.size() < comparison.improvements.size())
        method = fmt::format("The first {} of {} pairs; the table has all. {}", pairs.size(),
                             comparison.improvements.size(), method);
    finish_picture(picture, panel.bottom + 34, method);
    return picture;
}

Picture efficiency_figure(const Comparison& comparison) {
    const auto iqm = static_cast<std::size_t>(Metric::iqm);
    std::vector<double> values;
    double last_step = 1;
    for (const auto& result : comparison.results) {
        for (const auto& aggregates : result.curve) {
            const auto& [value, low, high] = aggregates[iqm];
            values.insert(values.end(), {value, low, high});
        }
        if (!result.curve_steps.empty()) last_step = std::max(last_step, result.curve_steps.back());
    }
    const auto [low, high] = room_for(values);
    // A baseline that would press the curves flat is left out.
    const double reach = 4 * std::max(high - low, 0.1);
    std::vector<std::pair<double, std::string>> baselines;
    std::vector<std::string> names, far;
    for (const auto& [baseline, aggregates] : comparison.baselines) {
        const double value = aggregates[iqm].value;
        if (value < low - reach || value > high + reach) {
            far.push_back(baseline.name);
            continue;
        }
        baselines.emplace_back(value, baseline.name);
        names.push_back(baseline.name);
        values.push_back(value);
    }
    const double room = names.empty() ? 0 : widest(names, 11.5) + 10;
    Picture picture = titled_picture("Sample efficiency", kRight + room + kMargin);
    const auto panel = panel_below_legend(picture, comparison, {0, last_step}, room_for(values),
                                          std::max(320.0, kBaselineRow * static_cast<double>(names.size())));
    draw_axes(picture, panel, 6, 6);
    draw_baselines(picture, panel, std::move(baselines));
    const auto iqm_of = [&](const Aggregates& aggregates) { return aggregates[iqm]; };
    for (std::size_t i = 0; i < comparison.results.size(); ++i) {
        const auto& result = comparison.results[i];
        draw_curve(picture, panel, result.curve_steps, mapped(result.curve, iqm_of), i,
                   result.has_interval());
    }
    title_axes(picture, panel, "agent steps", "IQM of human-normalised scores");
    auto method = method_of_bands(comparison);
    std::vector<std::string> unfinished;
    for (const auto& group : comparison.groups)
        if (!std::ranges::all_of(group.runs, &Run::finished)) unfinished.push_back(group.label);
    if (!unfinished.empty())
        method += fmt::format("; to where the shortest run is, unfinished: {}", fmt::join(unfinished, ", "));
    if (!far.empty()) method += fmt::format("; left out, far from the curves: {}", fmt::join(far, ", "));
    finish_picture(picture, panel.bottom + 50, method);
    return picture;
}

std::vector<Figure> figures(const Comparison& comparison) {
    std::vector<Figure> all;
    if (!comparison.games.empty()) {
        all.push_back(
            {"aggregates", "Aggregate scores",
             std::string(
                 "0 is the published random score, 1 the human's. The interquartile mean (IQM) averages the "
                 "middle half of all runs on all games; the median and the mean are those of the games' "
                 "means; the optimality gap is how far runs fall short of 1 on average. ") +
                 (all_intervals(comparison) ? "A bar is the interval, the line across it the estimate."
                  : comparison.has_interval_of_aggregates()
                      ? "A bar is the interval, the line across it the estimate, a "
                        "point an estimate without an interval."
                      : "A point is the estimate."),
             aggregate_figure(comparison)});
        const auto has_curve = [](const GroupResult& result) { return result.curve_steps.size() > 1; };
        if (std::ranges::any_of(comparison.results, has_curve)) {
            all.push_back({"sample_efficiency", "Sample efficiency",
                           "The interquartile mean while learning. A curve begins where every run has a "
                           "score and ends with the shortest run.",
                           efficiency_figure(comparison)});
        }
        all.push_back(
            {"performance_profiles", "Performance profiles",
             "The part of a group's runs that score above a given human-normalised score: higher is better.",
             profile_figure(comparison)});
        if (!comparison.improvements.empty()) {
            all.push_back(
                {"probability_of_improvement", "Probability of improvement",
                 std::string("How likely a run of X scores more than a run of Y on a game drawn at random.") +
                     (comparison.has_interval_of_a_pair()
                          ? " An interval that leaves out 0.5 speaks for a difference where both have at "
                            "least five runs per game; with two or three many leave it out by chance."
                          : ""),
                 improvement_figure(comparison)});
        }
    }
    std::ranges::move(game_figures(comparison), std::back_inserter(all));
    return all;
}

}  // namespace cale
