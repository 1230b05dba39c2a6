#include "report/picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "cale/text.h"
#include "report/ranges.h"
#include "storage/files.h"

namespace cale {
namespace {

std::string svg_points(const std::vector<Point>& points) {
    const auto text = [](Point point) { return fmt::format("{:.1f},{:.1f}", point.x, point.y); };
    return joined(mapped(points, text), " ");
}

/// What a page's script gets to know of an element.
std::string data_of(const Belonging& of) {
    return (of.series < 0 ? "" : fmt::format(" data-series=\"{}\"", of.series)) +
           (of.panel < 0 ? "" : fmt::format(" data-panel=\"{}\"", of.panel));
}
std::string data_of(const std::vector<Sample>& samples) {
    if (samples.empty()) return "";
    const auto text = [](const Sample& sample) {
        return fmt::format("{:.6g},{:.6g},{:.6g},{:.6g}", sample.x, sample.y, sample.low, sample.high);
    };
    return fmt::format(" data-samples=\"{}\"", fmt::join(mapped(samples, text), " "));
}
std::string data_of(const std::vector<PanelPlace>& panels) {
    if (panels.empty()) return "";
    const auto text = [](const PanelPlace& panel) {
        return fmt::format("{},{:.1f},{:.1f}", panel.game, panel.left, panel.top);
    };
    return fmt::format(" data-panels=\"{}\"", escaped(joined(mapped(panels, text), ";")));
}

std::string svg_element(const Area& area, bool with_data) {
    return fmt::format("<polygon fill=\"{}\"{}{} points=\"{}\"/>\n", to_hex(area.colour),
                       area.opacity < 1 ? fmt::format(" fill-opacity=\"{:g}\"", area.opacity) : "",
                       with_data ? data_of(area.of) : "", svg_points(area.outline));
}

// Drawn four times as large and then shrunk: OpenCV's own smoothing knows no fractional widths.
constexpr double kPngScale = 2;
constexpr double kOversampling = 2;
constexpr double kScale = kPngScale * kOversampling;
constexpr int kFixedPointBits = 4;  // of a pixel, in coordinates given to OpenCV

cv::Scalar bgr(Colour colour) {
    return {double(colour.blue), double(colour.green), double(colour.red)};
}

cv::Point fixed_point(Point point) {
    const double scale = kScale * (1 << kFixedPointBits);
    return {static_cast<int>(std::lround(point.x * scale)), static_cast<int>(std::lround(point.y * scale))};
}

std::vector<cv::Point> fixed_points(const std::vector<Point>& points) {
    return mapped(points, fixed_point);
}

/// The strokes of a dashed line.
std::vector<std::vector<Point>> dashes(const std::vector<Point>& points,
                                       const std::array<double, 2>& pattern) {
    const double dash = pattern[0], period = pattern[0] + pattern[1];
    std::vector<std::vector<Point>> pieces;
    double walked = 0;
    bool drawing = false;
    for (std::size_t i = 1; i < points.size(); ++i) {
        const auto a = points[i - 1], b = points[i];
        const double length = std::hypot(b.x - a.x, b.y - a.y);
        const auto at = [&](double distance) {
            return Point{a.x + distance / length * (b.x - a.x), a.y + distance / length * (b.y - a.y)};
        };
        for (double done = 0; done < length;) {
            const double phase = std::fmod(walked, period);
            const bool on = phase < dash;
            const double step = std::min(length - done, (on ? dash : period) - phase + 1e-9);
            if (on && !drawing) pieces.push_back({at(done)});
            if (on) pieces.back().push_back(at(done + step));
            drawing = on;
            done += step;
            walked += step;
        }
    }
    return pieces;
}

void draw(cv::Mat& image, const Line& line) {
    const int thickness = std::max(1, static_cast<int>(std::lround(line.width * kScale)));
    const auto stroke = [&](const std::vector<cv::Point>& points) {
        cv::polylines(image, points, false, bgr(line.colour), thickness, cv::LINE_AA, kFixedPointBits);
    };
    if (line.dashed) {
        for (const auto& dash : dashes(line.points, kDashes[line.pattern])) stroke(fixed_points(dash));
    } else {
        stroke(fixed_points(line.points));
    }
}

void fill(cv::Mat& image, const std::vector<cv::Point>& outline, Colour colour) {
    cv::fillPoly(image, std::vector<std::vector<cv::Point>>{outline}, bgr(colour), cv::LINE_AA,
                 kFixedPointBits);
}

void draw(cv::Mat& image, const Area& area) {
    auto outline = fixed_points(area.outline);
    if (area.opacity >= 1) return fill(image, outline, area.colour);
    constexpr int kUnit = 1 << kFixedPointBits;
    const auto bounds = cv::boundingRect(outline);
    const cv::Rect box = cv::Rect(bounds.x / kUnit - 1, bounds.y / kUnit - 1, bounds.width / kUnit + 3,
                                  bounds.height / kUnit + 3) &
                         cv::Rect({}, image.size());
    if (box.empty()) return;
    for (auto& point : outline) point -= kUnit * box.tl();
    cv::Mat below = image(box);
    cv::Mat painted = below.clone();
    fill(painted, outline, area.colour);
    cv::addWeighted(painted, area.opacity, below, 1 - area.opacity, 0, below);
}

/// Hershey's fonts have ASCII alone: each other character becomes a question mark.
std::string in_ascii(std::string text) {
    std::erase_if(text, continues_character);
    std::ranges::replace_if(
        text, [](char c) { return static_cast<unsigned char>(c) >= 0x80; }, '?');
    return text;
}

void draw(cv::Mat& image, const Text& words) {
    const auto text = in_ascii(words.text);
    // The height of a capital of Hershey's simplex is 21 of its units; that of a sans serif 0.72 em.
    const double scale = 0.66 * words.size * kScale / 21.0;
    const int thickness = static_cast<int>(std::lround((words.bold ? 1.8 : 1.1) * kScale * words.size / 13));
    const int width = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale, thickness, nullptr).width;
    const double shift = words.anchor == Anchor::start    ? 0
                         : words.anchor == Anchor::middle ? width / 2.0
                                                          : width;
    const cv::Point origin(static_cast<int>(words.position.x * kScale - shift),
                           static_cast<int>(words.position.y * kScale));
    cv::putText(image, text, origin, cv::FONT_HERSHEY_SIMPLEX, scale, bgr(words.colour), thickness,
                cv::LINE_AA);
}

std::string to_png(const Picture& picture) {
    cv::Mat large(static_cast<int>(picture.height * kScale), static_cast<int>(picture.width * kScale),
                  CV_8UC3, cv::Scalar::all(255));
    for (const auto& area : picture.areas) draw(large, area);
    for (const auto& line : picture.lines) draw(large, line);
    for (const auto& mark : picture.marks) draw(large, mark);
    for (const auto& words : picture.words) draw(large, words);
    cv::Mat image;
    cv::resize(large, image, {}, 1 / kOversampling, 1 / kOversampling, cv::INTER_AREA);
    std::vector<unsigned char> bytes;
    cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, 9});
    return {bytes.begin(), bytes.end()};
}

}  // namespace

std::string escaped(std::string_view text) {
    std::string out;
    for (const char c : printable(text)) {
        if (c == '&')
            out += "&amp;";
        else if (c == '<')
            out += "&lt;";
        else if (c == '>')
            out += "&gt;";
        else if (c == '"')
            out += "&quot;";
        else
            out += c;
    }
    return out;
}

std::string to_hex(Colour colour) {
    return fmt::format("#{:02x}{:02x}{:02x}", colour.red, colour.green, colour.blue);
}

Area rectangle(double left, double top, double right, double bottom, Colour colour, double opacity) {
    return {{{left, top}, {right, top}, {right, bottom}, {left, bottom}}, colour, opacity};
}

Area disc(Point centre, double radius, Colour colour, int corners) {
    Area area{.outline = {}, .colour = colour};
    for (int i = 0; i < corners; ++i) {
        const double angle = 2 * std::numbers::pi * i / corners;
        area.outline.push_back({centre.x + radius * std::cos(angle), centre.y + radius * std::sin(angle)});
    }
    return area;
}

Area diamond(Point centre, double radius, Colour colour) {
    return {{{centre.x, centre.y - radius},
             {centre.x + radius, centre.y},
             {centre.x, centre.y + radius},
             {centre.x - radius, centre.y}},
            colour};
}

double text_width(std::string_view text, double size, bool bold) {
    const auto characters =
        text.size() - static_cast<std::size_t>(std::ranges::count_if(text, continues_character));
    return (bold ? 0.63 : 0.57) * size * static_cast<double>(characters);
}

std::string to_svg(const Picture& picture, bool with_data) {
    std::string svg = fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
        "font-family=\"Helvetica, Arial, sans-serif\"{3}>\n<title>{2}</title>\n"
        "<rect width=\"{0}\" height=\"{1}\" fill=\"#ffffff\"/>\n",
        picture.width, picture.height, escaped(picture.title), with_data ? data_of(picture.panels) : "");
    const auto out = std::back_inserter(svg);
    for (const auto& area : picture.areas) svg += svg_element(area, with_data);
    for (const auto& line : picture.lines) {
        const auto [dash, space] = kDashes[line.pattern];
        fmt::format_to(out,
                       "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" "
                       "stroke-linejoin=\"round\"{}{}{} points=\"{}\"/>\n",
                       to_hex(line.colour), line.width,
                       line.dashed ? fmt::format(" stroke-dasharray=\"{} {}\"", dash, space) : "",
                       with_data ? data_of(line.of) : "", with_data ? data_of(line.samples) : "",
                       svg_points(line.points));
    }
    for (const auto& mark : picture.marks) svg += svg_element(mark, with_data);
    constexpr std::array<std::string_view, 3> kAnchors{"start", "middle", "end"};
    for (const auto& words : picture.words) {
        fmt::format_to(
            out,
            "<text x=\"{:.1f}\" y=\"{:.1f}\" fill=\"{}\" font-size=\"{}\" text-anchor=\"{}\"{}{}>{}</text>\n",
            words.position.x, words.position.y, to_hex(words.colour), words.size,
            kAnchors[static_cast<std::size_t>(words.anchor)], words.bold ? " font-weight=\"bold\"" : "",
            with_data ? data_of(words.of) : "", escaped(words.text));
    }
    return svg + "</svg>\n";
}

void write_picture(const Picture& picture, const std::filesystem::path& path) {
    const auto extension = path.extension();
    if (extension != ".svg" && extension != ".png")
        throw std::invalid_argument(
            fmt::format("cannot draw {}: its name must end in .svg or .png", path.string()));
    write_file_atomically(path, extension == ".svg" ? to_svg(picture) : to_png(picture));
}

}  // namespace cale
