#include "report/panel.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "report/ranges.h"

namespace cale {
namespace {

constexpr std::array<Colour, 7> kSeriesColours{{
    {0x00, 0x72, 0xb2},  // blue
    {0xd5, 0x5e, 0x00},  // vermilion
    {0x00, 0x9e, 0x73},  // bluish green
    {0xcc, 0x79, 0xa7},  // reddish purple
    {0xe6, 0x9f, 0x00},  // orange
    {0x56, 0xb4, 0xe9},  // sky blue
    {0x6f, 0x6f, 0x6f},  // for their black, which text has
}};

/// A line of a group, still without points.
Line series_line(std::size_t index, double width) {
    const auto round = index / kSeriesColours.size() % (1 + kDashes.size());
    Line line{.points = {},
              .colour = series_colour(index),
              .width = width,
              .of = {.series = static_cast<int>(index)}};
    line.dashed = round > 0;
    if (line.dashed) line.pattern = round - 1;
    return line;
}

}  // namespace

Colour series_colour(std::size_t index) {
    return kSeriesColours[index % kSeriesColours.size()];
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

std::vector<std::string> tick_texts(const std::vector<double>& ticks) {
    double largest = 0;
    for (const double tick : ticks) largest = std::max(largest, std::abs(tick));
    const double unit = largest >= 1e6 ? 1e6 : largest >= 1e4 ? 1e3 : 1;
    const auto* suffix = unit == 1e6 ? "M" : unit == 1e3 ? "k" : "";
    return mapped(ticks,
                  [&](double tick) { return fmt::format("{:g}{}", tick / unit, tick == 0 ? "" : suffix); });
}

Interval room_for(std::span<const double> values) {
    if (values.empty()) return {};
    const auto [low, high] = std::ranges::minmax(values);
    const double size = std::max(std::abs(low), std::abs(high));
    const double room = nearly_equal(low, high) ? std::max(1.0, 0.1 * size) : 0.05 * (high - low);
    return {low - room, high + room};
}

Picture titled_picture(const std::string& title, double width) {
    constexpr double kSize = 17;
    Picture picture{.title = title};
    picture.width =
        static_cast<int>(std::ceil(std::max(width, text_width(title, kSize, true) + 2 * kMargin)));
    picture.write(title, {kMargin, 32}, kInk, kSize, Anchor::start, true);
    return picture;
}

void finish_picture(Picture& picture, double bottom, const std::string& method) {
    constexpr double kSize = 11, kRow = 15;
    for (const auto& line : wrapped(method, picture.width - 2 * kMargin, kSize)) {
        bottom += kRow;
        picture.write(line, {kMargin, bottom}, kFaintInk, kSize);
    }
    picture.height = static_cast<int>(std::ceil(bottom + kRow));
}

Extent extent_of(const Picture& picture) {
    return {picture.areas.size(), picture.lines.size(), picture.marks.size(), picture.words.size()};
}

void assign_panel(Picture& picture, const Extent& before, const Panel& panel, std::string_view game) {
    const auto number = static_cast<int>(picture.panels.size());
    const auto assign = [number](auto& elements, std::size_t first) {
        for (std::size_t i = first; i < elements.size(); ++i) elements[i].of.panel = number;
    };
    assign(picture.areas, before.areas);
    assign(picture.lines, before.lines);
    assign(picture.marks, before.marks);
    assign(picture.words, before.words);
    picture.panels.push_back({std::string(game), panel.left, panel.top});
}

std::vector<double> fitting_ticks(const Panel& panel, int count, double text_size) {
    for (;; --count) {
        auto ticks = nice_ticks(panel.x.low, panel.x.high, count);
        double width = 0;
        for (const auto& text : tick_texts(ticks)) width += text_width(text, text_size) + text_size;
        if (count <= 1 || width <= panel.right - panel.left + text_size) return ticks;
    }
}

void draw_grid_line_at_x(Picture& picture, const Panel& panel, double value) {
    const double x = panel.to_x(value);
    picture.areas.push_back(rectangle(x - 0.5, panel.top, x + 0.5, panel.bottom, kGrid));
}

void draw_axes(Picture& picture, const Panel& panel, int x_ticks, int y_ticks, double text_size) {
    const auto rows = nice_ticks(panel.y.low, panel.y.high, y_ticks);
    const auto row_texts = tick_texts(rows);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const double y = panel.to_y(rows[i]);
        picture.areas.push_back(rectangle(panel.left, y - 0.5, panel.right, y + 0.5, kGrid));
        picture.write(row_texts[i], {panel.left - 7, y + 0.35 * text_size}, kFaintInk, text_size,
                      Anchor::end);
    }
    const auto columns = fitting_ticks(panel, x_ticks, text_size);
    const auto column_texts = tick_texts(columns);
    for (std::size_t i = 0; i < columns.size(); ++i) {
        const double x = panel.to_x(columns[i]);
        picture.lines.push_back({{{x, panel.bottom}, {x, panel.bottom + 4}}, kFaintInk, 1});
        picture.write(column_texts[i], {x, panel.bottom + 6 + text_size}, kFaintInk, text_size,
                      Anchor::middle);
    }
    picture.lines.push_back({{{panel.left, panel.bottom}, {panel.right, panel.bottom}}, kFaintInk, 1});
}

void draw_curve(Picture& picture, const Panel& panel, const std::vector<double>& x,
                const std::vector<Estimate>& y, std::size_t series, bool with_band) {
    auto line = series_line(series, 2);
    std::vector<Point> band;
    for (std::size_t i = 0; i < x.size(); ++i) {
        line.samples.push_back(
            {x[i], y[i].value, with_band ? y[i].low : y[i].value, with_band ? y[i].high : y[i].value});
        line.points.push_back({panel.to_x(x[i]), panel.to_y(y[i].value)});
        band.push_back({panel.to_x(x[i]), panel.to_y(y[i].high)});
    }
    for (std::size_t i = x.size(); i-- > 0;) band.push_back({panel.to_x(x[i]), panel.to_y(y[i].low)});
    if (with_band) picture.areas.push_back({band, line.colour, 0.18, line.of});
    picture.lines.push_back(std::move(line));
}

double draw_legend(Picture& picture, const std::vector<std::string>& names, double left, double right,
                   double top) {
    constexpr double kSample = 24, kGap = 7, kBetween = 22, kRow = 19, kSize = 12.5;
    double x = left, y = top + kRow / 2;
    for (std::size_t i = 0; i < names.size(); ++i) {
        if (names[i].empty()) continue;
        const double width = kSample + kGap + text_width(names[i], kSize);
        if (x > left && x + width > right) {
            x = left;
            y += kRow;
        }
        auto line = series_line(i, 3);
        line.points = {{x, y}, {x + kSample, y}};
        picture.write(names[i], {x + kSample + kGap, y + 4}, kInk, kSize, Anchor::start, false, line.of);
        picture.lines.push_back(std::move(line));
        x += width + kBetween;
    }
    return y + kRow / 2 - top;
}

double widest(const std::vector<std::string>& texts, double size, bool bold) {
    double width = 0;
    for (const auto& text : texts) width = std::max(width, text_width(text, size, bold));
    return width;
}

std::vector<std::string> wrapped(std::string_view text, double width, double size) {
    std::vector<std::string> lines;
    std::string line;
    while (!text.empty()) {
        const auto space = std::min(text.find(' '), text.size());
        const auto word = text.substr(0, space);
        if (!line.empty() && text_width(line, size) + text_width(word, size) + size > width) {
            lines.push_back(line);
            line.clear();
        }
        if (!line.empty()) line += ' ';
        line += word;
        text.remove_prefix(std::min(space + 1, text.size()));
    }
    if (!line.empty()) lines.push_back(line);
    return lines;
}

}  // namespace cale
