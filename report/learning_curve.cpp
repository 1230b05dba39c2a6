#include "report/learning_curve.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <string_view>

namespace cale {
namespace {

constexpr Colour kInk{0x33, 0x3a, 0x45};
constexpr Colour kFaintInk{0x78, 0x80, 0x8c};
constexpr Colour kGrid{0xe6, 0xe9, 0xed};
constexpr Colour kThin{0xa9, 0xc9, 0xea};
constexpr Colour kBold{0x1b, 0x5f, 0xa8};
constexpr Colour kReference{0xc2, 0x55, 0x2d};

constexpr double kLeft = 70, kTop = 70, kRightEdge = 780, kBottom = 395;
constexpr double kRoomForReferences = 100;

std::vector<std::string_view> split(std::string_view line) {
    std::vector<std::string_view> cells;
    if (line.ends_with('\r')) line.remove_suffix(1);
    for (auto comma = line.find(','); comma != line.npos; comma = line.find(',')) {
        cells.push_back(line.substr(0, comma));
        line.remove_prefix(comma + 1);
    }
    cells.push_back(line);
    return cells;
}

std::optional<std::size_t> column(const std::vector<std::string_view>& names, std::string_view name) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) return std::nullopt;
    return static_cast<std::size_t>(found - names.begin());
}

std::optional<double> number(std::string_view text) {
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
        return std::nullopt;
    return value;
}

/// The value of "env_id" in the comment line. Game names need no escapes.
std::string env_id_of(std::string_view comment) {
    constexpr std::string_view key = "\"env_id\"";
    auto start = comment.find(key);
    if (start == comment.npos) return {};
    start = comment.find('"', start + key.size());
    if (start == comment.npos) return {};
    const auto end = comment.find('"', start + 1);
    return end == comment.npos ? std::string() : std::string(comment.substr(start + 1, end - start - 1));
}

/// 250000 -> "250k"
std::string tick_text(double value) {
    if (std::abs(value) >= 1e6) return fmt::format("{:g}M", value / 1e6);
    if (std::abs(value) >= 1e4) return fmt::format("{:g}k", value / 1e3);
    return fmt::format("{:g}", value);
}

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

EpisodeHistory read_episodes(const std::filesystem::path& path) {
    std::ifstream file(path);
    if (!file) throw std::runtime_error(fmt::format("cannot read the episodes in {}", path.string()));
    const std::string text{std::istreambuf_iterator<char>(file), {}};

    EpisodeHistory history;
    std::optional<std::size_t> return_column, step_column, length_column;
    double steps = 0;
    std::size_t line_number = 0, columns = 0;
    for (std::size_t start = 0, end = 0; (end = text.find('\n', start)) != text.npos; start = end + 1) {
        const auto line = std::string_view(text).substr(start, end - start);
        ++line_number;
        if (line.starts_with('#')) {
            history.env_id = env_id_of(line);
            continue;
        }
        const auto cells = split(line);
        if (columns == 0) {
            columns = cells.size();
            return_column = column(cells, "r");
            step_column = column(cells, "global_step");
            length_column = column(cells, "l");
            if (!return_column || (!step_column && !length_column)) {
                throw std::runtime_error(
                    fmt::format("{} is not an episodes.csv: line {} does not name the columns r "
                                "and global_step",
                                path.string(), line_number));
            }
            continue;
        }
        const auto value_of = [&](std::size_t index) {
            const auto value = cells.size() == columns ? number(cells[index]) : std::nullopt;
            if (!value) {
                throw std::runtime_error(
                    fmt::format("{} is damaged: line {} is '{}'", path.string(), line_number, line));
            }
            return *value;
        };
        steps = step_column ? value_of(*step_column) : steps + value_of(*length_column);
        history.steps.push_back(steps);
        history.returns.push_back(value_of(*return_column));
    }
    if (columns == 0)
        throw std::runtime_error(fmt::format("{} has no header: it is empty or damaged", path.string()));
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

std::vector<double> nice_ticks(double low, double high, int count) {
    const double raw = (high - low) / count;
    const double power = std::pow(10, std::floor(std::log10(raw)));
    const double digit = raw / power;
    const double step = power * (digit < 1.5 ? 1 : digit < 3.5 ? 2 : digit < 7.5 ? 5 : 10);
    std::vector<double> ticks;
    const double slack = 1e-9 * step;
    for (double i = std::ceil((low - slack) / step); i * step <= high + slack; ++i)
        ticks.push_back(i == 0 ? 0 : i * step);
    return ticks;
}

Picture learning_curve(const EpisodeHistory& episodes, const std::string& title,
                       const std::vector<ReferenceScore>& references) {
    const auto count = episodes.returns.size();
    const auto window = std::clamp<std::size_t>(count / 10, 1, 100);
    const auto averages = moving_average(episodes.returns, window);

    double low = 0, high = 1, last_step = 1;
    if (count > 0) {
        const auto [lowest, highest] = std::minmax_element(episodes.returns.begin(), episodes.returns.end());
        low = *lowest;
        high = *highest;
        last_step = std::max(1.0, episodes.steps.back());
    }
    if (low == high) {
        low -= 1;
        high += 1;
    }
    const double data_span = high - low, data_low = low, data_high = high;
    const auto fits = [&](double score) {
        return score > data_high - 3 * data_span && score < data_low + 3 * data_span;
    };
    for (const auto& reference : references) {
        if (!fits(reference.score)) continue;
        low = std::min(low, reference.score);
        high = std::max(high, reference.score);
    }
    const double margin = 0.04 * (high - low);
    low -= margin;
    high += margin;

    const double right = references.empty() ? kRightEdge : kRightEdge - kRoomForReferences;
    const auto x = [&](double step) { return kLeft + step / last_step * (right - kLeft); };
    const auto y = [&](double value) { return kBottom - (value - low) / (high - low) * (kBottom - kTop); };

    Picture picture{.width = 800, .height = 450, .title = title};
    for (const double tick : nice_ticks(low, high, 6)) {
        picture.lines.push_back({{{kLeft, y(tick)}, {right, y(tick)}}, kGrid, 1});
        picture.words.push_back({tick_text(tick), {kLeft - 8, y(tick) + 4}, kFaintInk, 12, Anchor::end});
    }
    for (const double tick : nice_ticks(0, last_step, 6)) {
        picture.lines.push_back({{{x(tick), kBottom}, {x(tick), kBottom + 5}}, kFaintInk, 1});
        picture.words.push_back({tick_text(tick), {x(tick), kBottom + 19}, kFaintInk, 12, Anchor::middle});
    }
    picture.lines.push_back({{{kLeft, kBottom}, {right, kBottom}}, kFaintInk, 1});

    std::vector<Point> thin, bold;
    for (std::size_t i = 0; i < count; ++i) {
        thin.push_back({x(episodes.steps[i]), y(episodes.returns[i])});
        bold.push_back({x(episodes.steps[i]), y(averages[i])});
    }
    if (count > 0) {
        picture.lines.push_back({thinned(thin), kThin, 0.8});
        picture.lines.push_back({thinned(bold), kBold, 2.4});
    } else {
        picture.words.push_back({"no episode has ended yet",
                                 {(kLeft + right) / 2, (kTop + kBottom) / 2},
                                 kFaintInk,
                                 15,
                                 Anchor::middle});
    }

    // Their words stand to the right of the curve, one below the other where they would overlap.
    double lowest_free = kTop - 20;
    auto from_above = references;
    std::sort(from_above.begin(), from_above.end(),
              [](const auto& a, const auto& b) { return a.score > b.score; });
    for (const auto& reference : from_above) {
        const double height = std::clamp(y(reference.score), kTop, kBottom);
        const double baseline = std::max(height + 4, lowest_free);
        lowest_free = baseline + 15;
        picture.words.push_back({fmt::format("{} {:g}", reference.label, reference.score),
                                 {right + 8, baseline},
                                 kReference,
                                 12});
        if (fits(reference.score)) {
            picture.lines.push_back({{{kLeft, height}, {right, height}}, kReference, 1.2, true});
        } else {
            picture.words.push_back({reference.score > high ? "(far above)" : "(far below)",
                                     {right + 8, baseline + 15},
                                     kReference,
                                     12});
            lowest_free += 15;
        }
    }

    picture.words.push_back({title, {kLeft, 30}, kInk, 18, Anchor::start, true});
    picture.words.push_back({"return", {kLeft, kTop - 14}, kInk, 13, Anchor::start});
    picture.words.push_back({"agent steps", {right, kBottom + 40}, kInk, 13, Anchor::end});
    if (count > 0) {
        picture.words.push_back(
            {fmt::format("mean of {} episodes", window), {kRightEdge, 30}, kBold, 13, Anchor::end, true});
        picture.words.push_back({fmt::format("each of {} episodes", count),
                                 {kRightEdge, 48},
                                 {0x6f, 0xa3, 0xd6},
                                 13,
                                 Anchor::end});
    }
    return picture;
}

}  // namespace cale
