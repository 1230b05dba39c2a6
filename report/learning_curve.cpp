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
            auto [low, high] = std::ranges::minmax_element(first, last, {}, &Point::y);
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

/// Whether a score can be shown beside these returns without pressing them together.
bool is_near(const Interval& returns, double score) {
    const double span = returns.high - returns.low;
    return score > returns.high - 3 * span && score < returns.low + 3 * span;
}

/// The least and the greatest; one to either side where all are equal, but for their last digits; 0 to 1 of
/// none.
Interval range_of(const std::vector<double>& returns) {
    if (returns.empty()) return {};
    const auto [low, high] = std::ranges::minmax(returns);
    if (!nearly_equal(low, high)) return {low, high};
    const double room = std::max(1.0, 1e-6 * std::max(std::abs(low), std::abs(high)));
    return {low - room, high + room};
}

/// The returns, the references that are near them, and a margin.
Interval shown_range(const Interval& returns, const std::vector<ReferenceScore>& references) {
    Interval shown = returns;
    for (const auto& reference : references) {
        if (!is_near(returns, reference.score)) continue;
        shown.low = std::min(shown.low, reference.score);
        shown.high = std::max(shown.high, reference.score);
    }
    const double margin = 0.04 * (shown.high - shown.low);
    return {shown.low - margin, shown.high + margin};
}

void draw_returns(Picture& picture, const Panel& panel, const EpisodeHistory& episodes, std::size_t window) {
    if (episodes.returns.empty()) {
        picture.write("no episode has ended yet", {(kLeft + panel.right) / 2, (kTop + kBottom) / 2},
                      kFaintInk, 15, Anchor::middle);
        return;
    }
    const auto averages = moving_average(episodes.returns, window);
    std::vector<Point> thin, bold;
    for (std::size_t i = 0; i < averages.size(); ++i) {
        thin.push_back({panel.to_x(episodes.steps[i]), panel.to_y(episodes.returns[i])});
        bold.push_back({panel.to_x(episodes.steps[i]), panel.to_y(averages[i])});
    }
    picture.lines.push_back({thinned(thin), kThin, 0.8});
    picture.lines.push_back({thinned(bold), kBold, 2.4});
}

/// Their words stand to the right of the curve, one below the other where they would overlap.
void draw_references(Picture& picture, const Panel& panel, const Interval& returns,
                     std::vector<ReferenceScore> references) {
    std::ranges::sort(references, std::ranges::greater(), &ReferenceScore::score);
    double lowest_free = kTop - 20;
    for (const auto& reference : references) {
        const double height = std::clamp(panel.to_y(reference.score), kTop, kBottom);
        const double baseline = std::max(height + 4, lowest_free);
        lowest_free = baseline + 15;
        // One decimal, as scores are published.
        const double shown = std::round(10 * reference.score) / 10 + 0.0;
        picture.write(fmt::format("{} {:g}", reference.label, shown), {panel.right + 8, baseline}, kReference,
                      12);
        if (is_near(returns, reference.score)) {
            picture.lines.push_back({{{kLeft, height}, {panel.right, height}}, kReference, 1.2, true});
        } else {
            picture.write(reference.score > panel.y.high ? "(far above)" : "(far below)",
                          {panel.right + 8, baseline + 15}, kReference, 12);
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
    const Panel panel{.left = kLeft,
                      .top = kTop,
                      .right = references.empty() ? kRightEdge : kRightEdge - kRoomForReferences,
                      .bottom = kBottom,
                      .x = {0, count > 0 ? std::max(1.0, episodes.steps.back()) : 1},
                      .y = shown_range(returns, references)};

    Picture picture{.width = 800, .height = 450, .title = title};
    draw_axes(picture, panel, 6, 6);
    draw_returns(picture, panel, episodes, window);
    draw_references(picture, panel, returns, references);

    picture.write(title, {kLeft, 30}, kInk, 18, Anchor::start, true);
    picture.write("return", {kLeft, kTop - 14}, kInk, 13, Anchor::start);
    picture.write("agent steps", {panel.right, kBottom + 40}, kInk, 13, Anchor::end);
    if (count > 0) {
        picture.write("mean of " + counted(window, "episode"), {kRightEdge, 30}, kBold, 13, Anchor::end,
                      true);
        picture.write(fmt::format("each of {} episodes", count), {kRightEdge, 48}, {0x6f, 0xa3, 0xd6}, 13,
                      Anchor::end);
    }
    return picture;
}

}  // namespace cale
