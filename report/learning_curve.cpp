#include "report/learning_curve.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "cale/text.h"
#include "report/csv.h"
#include "report/panel.h"

namespace cale {
namespace {

constexpr Colour kThin{0xa9, 0xc9, 0xea};
constexpr Colour kBold{0x1b, 0x5f, 0xa8};
constexpr Colour kReference{0xc2, 0x55, 0x2d};

constexpr double kLeft = 70, kTop = 70, kRightEdge = 780, kBottom = 395;
constexpr double kRoomForReferences = 100;

/// At most four points per pixel column, which look the same as all of them.
std::vector<Point> thinned(const std::vector<Point>& points) {
    std::vector<Point> kept;
    for (auto first = points.begin(); first != points.end();) {
        const double pixel = std::floor(first->x);
        const auto last =
            std::find_if(first, points.end(), [pixel](Point p) { return std::floor(p.x) != pixel; });
        if (last - first <= 4) {
            kept.insert(kept.end(), first, last);
        } else {
            auto [low, high] = std::minmax_element(first, last, [](Point a, Point b) { return a.y < b.y; });
            if (high < low) std::swap(low, high);
            kept.insert(kept.end(), {*first, *low, *high, *(last - 1)});
        }
        first = last;
    }
    return kept;
}

}  // namespace

EpisodeHistory read_episodes(const std::filesystem::path& path, std::size_t bytes) {
    const auto table = read_csv(path, bytes);
    const auto return_column = table.find("r");
    const auto step_column = table.find("global_step");
    const auto length_column = table.find("l");
    if (!return_column || (!step_column && !length_column)) {
        throw std::runtime_error(
            fmt::format("{} is not an episodes.csv: its header does not name the columns r and global_step",
                        path.string()));
    }
    EpisodeHistory history{.cut_line = table.cut_line};
    const auto first_line = nlohmann::json::parse(table.comment, nullptr, false);
    if (first_line.is_object()) {
        const auto text = [&](const char* key) {
            const auto found = first_line.find(key);
            return found != first_line.end() && found->is_string() ? found->get<std::string>()
                                                                   : std::string();
        };
        history.env_id = text("env_id");
        history.agent = text("agent");
        const auto seed = first_line.find("seed");
        if (seed != first_line.end() && seed->is_number_unsigned()) history.seed = seed->get<std::uint64_t>();
    }
    double steps = 0;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
        steps = step_column ? table.number(row, *step_column) : steps + table.number(row, *length_column);
        history.steps.push_back(steps);
        history.returns.push_back(table.score(row, *return_column));
    }
    return history;
}

std::vector<double> moving_average(const std::vector<double>& values, std::size_t window) {
    std::vector<double> averages;
    double sum = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
        sum += values[i];
        if (i >= window) sum -= values[i - window];
        averages.push_back(sum / static_cast<double>(std::min(i + 1, window)));
    }
    return averages;
}

StepCurve mean_returns(const EpisodeHistory& episodes, double window, double end) {
    StepCurve curve;
    double sum = 0;
    std::size_t oldest = 0, next = 0;  // the window holds the episodes [oldest, next)
    const auto add_point = [&](double step) {
        if (curve.steps.empty() || step > curve.steps.back()) {
            curve.steps.push_back(step);
            curve.values.emplace_back();
        }
        curve.values.back() = sum / static_cast<double>(next - oldest);
    };
    while (true) {
        const double ends = next < episodes.steps.size() ? episodes.steps[next] : HUGE_VAL;
        const double leaves = next > oldest + 1 ? episodes.steps[oldest] + window : HUGE_VAL;
        const double step = std::min(ends, leaves);
        if (step > end || step == HUGE_VAL) break;
        if (leaves <= ends)
            sum -= episodes.returns[oldest++];
        else
            sum += episodes.returns[next++];
        add_point(step);
    }
    if (next > 0) add_point(end);
    return curve;
}

namespace {

struct ReturnRange {
    double low = 0, high = 1;

    /// Whether a score can be shown beside this without pressing it together.
    bool is_near(double score) const {
        const double span = high - low;
        return score > high - 3 * span && score < low + 3 * span;
    }
};

/// Where steps and returns lie in the picture.
struct Axes {
    ReturnRange returns;
    double last_step, right;

    double x(double step) const { return kLeft + step / last_step * (right - kLeft); }
    double y(double value) const {
        return kBottom - (value - returns.low) / (returns.high - returns.low) * (kBottom - kTop);
    }
};

/// The least and the greatest; one to either side where all are equal; 0 to 1 of none.
ReturnRange range_of(const std::vector<double>& returns) {
    ReturnRange range;
    if (!returns.empty()) {
        const auto [lowest, highest] = std::minmax_element(returns.begin(), returns.end());
        range = {*lowest, *highest};
    }
    if (range.low == range.high) range = {range.low - 1, range.high + 1};
    return range;
}

/// The returns, the references that are near them, and a margin.
ReturnRange shown_range(const ReturnRange& returns, const std::vector<ReferenceScore>& references) {
    ReturnRange shown = returns;
    for (const auto& reference : references) {
        if (!returns.is_near(reference.score)) continue;
        shown.low = std::min(shown.low, reference.score);
        shown.high = std::max(shown.high, reference.score);
    }
    const double margin = 0.04 * (shown.high - shown.low);
    return {shown.low - margin, shown.high + margin};
}

void draw_axes(Picture& picture, const Axes& axes) {
    const auto rows = nice_ticks(axes.returns.low, axes.returns.high, 6);
    const auto row_texts = tick_texts(rows);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const double height = axes.y(rows[i]);
        picture.lines.push_back({{{kLeft, height}, {axes.right, height}}, kGrid, 1});
        picture.words.push_back({row_texts[i], {kLeft - 8, height + 4}, kFaintInk, 12, Anchor::end});
    }
    const auto columns = nice_ticks(0, axes.last_step, 6);
    const auto column_texts = tick_texts(columns);
    for (std::size_t i = 0; i < columns.size(); ++i) {
        const double place = axes.x(columns[i]);
        picture.lines.push_back({{{place, kBottom}, {place, kBottom + 5}}, kFaintInk, 1});
        picture.words.push_back({column_texts[i], {place, kBottom + 19}, kFaintInk, 12, Anchor::middle});
    }
    picture.lines.push_back({{{kLeft, kBottom}, {axes.right, kBottom}}, kFaintInk, 1});
}

void draw_returns(Picture& picture, const Axes& axes, const EpisodeHistory& episodes, std::size_t window) {
    if (episodes.returns.empty()) {
        picture.words.push_back({"no episode has ended yet",
                                 {(kLeft + axes.right) / 2, (kTop + kBottom) / 2},
                                 kFaintInk,
                                 15,
                                 Anchor::middle});
        return;
    }
    const auto averages = moving_average(episodes.returns, window);
    std::vector<Point> thin, bold;
    for (std::size_t i = 0; i < averages.size(); ++i) {
        thin.push_back({axes.x(episodes.steps[i]), axes.y(episodes.returns[i])});
        bold.push_back({axes.x(episodes.steps[i]), axes.y(averages[i])});
    }
    picture.lines.push_back({thinned(thin), kThin, 0.8});
    picture.lines.push_back({thinned(bold), kBold, 2.4});
}

/// Their words stand to the right of the curve, one below the other where they would overlap.
void draw_references(Picture& picture, const Axes& axes, const ReturnRange& returns,
                     std::vector<ReferenceScore> references) {
    std::sort(references.begin(), references.end(),
              [](const auto& a, const auto& b) { return a.score > b.score; });
    double lowest_free = kTop - 20;
    for (const auto& reference : references) {
        const double height = std::clamp(axes.y(reference.score), kTop, kBottom);
        const double baseline = std::max(height + 4, lowest_free);
        lowest_free = baseline + 15;
        // One decimal, as scores are published.
        const double shown = std::round(10 * reference.score) / 10 + 0.0;
        picture.words.push_back(
            {fmt::format("{} {:g}", reference.label, shown), {axes.right + 8, baseline}, kReference, 12});
        if (returns.is_near(reference.score)) {
            picture.lines.push_back({{{kLeft, height}, {axes.right, height}}, kReference, 1.2, true});
        } else {
            picture.words.push_back({reference.score > axes.returns.high ? "(far above)" : "(far below)",
                                     {axes.right + 8, baseline + 15},
                                     kReference,
                                     12});
            lowest_free += 15;
        }
    }
}

}  // namespace

Picture learning_curve(const EpisodeHistory& episodes, const std::string& title,
                       const std::vector<ReferenceScore>& references) {
    const auto count = episodes.returns.size();
    const auto window = std::clamp<std::size_t>(count / 10, 1, 100);
    const auto returns = range_of(episodes.returns);
    const Axes axes{.returns = shown_range(returns, references),
                    .last_step = count > 0 ? std::max(1.0, episodes.steps.back()) : 1,
                    .right = references.empty() ? kRightEdge : kRightEdge - kRoomForReferences};

    Picture picture{.width = 800, .height = 450, .title = title};
    draw_axes(picture, axes);
    draw_returns(picture, axes, episodes, window);
    draw_references(picture, axes, returns, references);

    picture.words.push_back({title, {kLeft, 30}, kInk, 18, Anchor::start, true});
    picture.words.push_back({"return", {kLeft, kTop - 14}, kInk, 13, Anchor::start});
    picture.words.push_back({"agent steps", {axes.right, kBottom + 40}, kInk, 13, Anchor::end});
    if (count > 0) {
        picture.words.push_back(
            {"mean of " + counted(window, "episode"), {kRightEdge, 30}, kBold, 13, Anchor::end, true});
        picture.words.push_back({fmt::format("each of {} episodes", count),
                                 {kRightEdge, 48},
                                 {0x6f, 0xa3, 0xd6},
                                 13,
                                 Anchor::end});
    }
    return picture;
}

}  // namespace cale
