#include "report/picture.h"

#include <fmt/format.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string_view>

namespace cale {
namespace {

std::string escaped(std::string_view text) {
    std::string out;
    for (const char c : text) {
        if (c == '&')
            out += "&amp;";
        else if (c == '<')
            out += "&lt;";
        else if (c == '>')
            out += "&gt;";
        else if (c == '"')
            out += "&quot;";
        else if (static_cast<unsigned char>(c) >= 0x20)
            out += c;
    }
    return out;
}

std::string hex(Colour colour) {
    return fmt::format("#{:02x}{:02x}{:02x}", colour.red, colour.green, colour.blue);
}

std::string_view svg_name(Anchor anchor) {
    return anchor == Anchor::start ? "start" : anchor == Anchor::middle ? "middle" : "end";
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

void draw(cv::Mat& image, const Line& line) {
    const int thickness = std::max(1, static_cast<int>(std::lround(line.width * kScale)));
    const auto stroke = [&](const std::vector<cv::Point>& points) {
        cv::polylines(image, points, false, bgr(line.colour), thickness, cv::LINE_AA, kFixedPointBits);
    };
    std::vector<cv::Point> points;
    if (!line.dashed || line.points.size() != 2) {
        for (const auto& point : line.points) points.push_back(fixed_point(point));
        return stroke(points);
    }
    const auto [a, b] = std::pair(line.points[0], line.points[1]);
    const double length = std::hypot(b.x - a.x, b.y - a.y);
    const auto at = [&](double distance) {
        const double part = std::min(distance / length, 1.0);
        return fixed_point({a.x + part * (b.x - a.x), a.y + part * (b.y - a.y)});
    };
    for (double start = 0; start < length; start += 10) stroke({at(start), at(start + 6)});
}

void draw(cv::Mat& image, const Words& words) {
    // The height of a capital of Hershey's simplex is 21 of its units; that of a sans serif 0.72 em.
    const double scale = 0.66 * words.size * kScale / 21.0;
    const int thickness = static_cast<int>(std::lround((words.bold ? 1.8 : 1.1) * kScale * words.size / 13));
    const int width = cv::getTextSize(words.text, cv::FONT_HERSHEY_SIMPLEX, scale, thickness, nullptr).width;
    const double shift = words.anchor == Anchor::start    ? 0
                         : words.anchor == Anchor::middle ? width / 2.0
                                                          : width;
    const cv::Point origin(static_cast<int>(words.position.x * kScale - shift),
                           static_cast<int>(words.position.y * kScale));
    cv::putText(image, words.text, origin, cv::FONT_HERSHEY_SIMPLEX, scale, bgr(words.colour), thickness,
                cv::LINE_AA);
}

std::vector<unsigned char> to_png(const Picture& picture) {
    cv::Mat large(static_cast<int>(picture.height * kScale), static_cast<int>(picture.width * kScale),
                  CV_8UC3, cv::Scalar::all(255));
    for (const auto& line : picture.lines) draw(large, line);
    for (const auto& words : picture.words) draw(large, words);
    cv::Mat image;
    cv::resize(large, image, {}, 1 / kOversampling, 1 / kOversampling, cv::INTER_AREA);
    std::vector<unsigned char> bytes;
    cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, 9});
    return bytes;
}

}  // namespace

std::string to_svg(const Picture& picture) {
    std::string svg = fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
        "font-family=\"Helvetica, Arial, sans-serif\">\n<title>{2}</title>\n"
        "<rect width=\"{0}\" height=\"{1}\" fill=\"#ffffff\"/>\n",
        picture.width, picture.height, escaped(picture.title));
    const auto out = std::back_inserter(svg);
    for (const auto& line : picture.lines) {
        fmt::format_to(
            out,
            "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"{} points=\"",
            hex(line.colour), line.width, line.dashed ? " stroke-dasharray=\"6 4\"" : "");
        const char* separator = "";
        for (const auto& point : line.points) {
            fmt::format_to(out, "{}{:.1f},{:.1f}", separator, point.x, point.y);
            separator = " ";
        }
        svg += "\"/>\n";
    }
    for (const auto& words : picture.words) {
        fmt::format_to(
            out,
            "<text x=\"{:.1f}\" y=\"{:.1f}\" fill=\"{}\" font-size=\"{}\" text-anchor=\"{}\"{}>{}</text>\n",
            words.position.x, words.position.y, hex(words.colour), words.size, svg_name(words.anchor),
            words.bold ? " font-weight=\"bold\"" : "", escaped(words.text));
    }
    return svg + "</svg>\n";
}

void write_picture(const Picture& picture, const std::filesystem::path& path) {
    std::string bytes;
    if (path.extension() == ".svg") {
        bytes = to_svg(picture);
    } else if (path.extension() == ".png") {
        const auto png = to_png(picture);
        bytes.assign(png.begin(), png.end());
    } else {
        throw std::invalid_argument(
            fmt::format("cannot draw {}: its name must end in .svg or .png", path.string()));
    }
    std::ofstream file(path, std::ios::binary);
    file << bytes;
    file.close();
    if (!file)
        throw std::runtime_error(fmt::format("cannot write {}: {}", path.string(), std::strerror(errno)));
}

}  // namespace cale
