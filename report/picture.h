// A picture as data, areas, lines and words, and its two renderings: SVG for documents and
// papers, PNG for pages that show no SVG.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace cale {

/// From the upper left corner, in pixels.
struct Point {
    double x = 0;
    double y = 0;
};

/// Of sRGB.
struct Colour {
    std::uint8_t red = 0;
    std::uint8_t green = 0;
    std::uint8_t blue = 0;
};

/// What an element of a figure belongs to, for a page whose reader may hide it.
struct Belonging {
    int series = -1;  // the number of a group of runs; -1: none
    int panel = -1;   // an index of Picture::panels; -1: none
};

/// What a point of a curve stands for.
struct Sample {
    double x = 0;  // its step, score or quantile
    double y = 0;
    double low = 0, high = 0;  // its interval; both are y where there is none
};

/// Straight lines from point to point.
struct Line {
    std::vector<Point> points;
    Colour colour;
    double width = 1;
    bool dashed = false;
    Belonging of{};
    std::vector<Sample> samples{};  // of a curve, by point
    std::size_t pattern = 0;        // which of kDashes, where it is dashed
};

/// Patterns of a dashed line: a stroke and the space behind it.
inline constexpr std::array<std::array<double, 2>, 3> kDashes{{{6, 4}, {2, 3}, {14, 5}}};

/// A filled polygon.
struct Area {
    std::vector<Point> outline;
    Colour colour;
    double opacity = 1;
    Belonging of{};
};

Area rectangle(double left, double top, double right, double bottom, Colour colour, double opacity = 1);
/// As a polygon with so many corners.
Area disc(Point centre, double radius, Colour colour, int corners = 20);
Area diamond(Point centre, double radius, Colour colour);

enum class Anchor { start, middle, end };

/// A line of text.
struct Text {
    std::string text;  // UTF-8; a PNG shows ASCII only
    Point position;    // of the baseline, where `anchor` says
    Colour colour;
    double size = 13;
    Anchor anchor = Anchor::start;
    bool bold = false;
    Belonging of{};
};

/// One of several coordinate systems of a picture, and where it is.
struct PanelPlace {
    std::string game{};
    double left = 0, top = 0;
};

/// Drawn in order on white: all areas, then all lines, marks and words.
struct Picture {
    int width = 800;
    int height = 450;
    std::string title{};  // for screen readers
    std::vector<Area> areas{};
    std::vector<Line> lines{};
    std::vector<Area> marks{};
    std::vector<Text> words{};
    std::vector<PanelPlace> panels{};  // those of games

    void write(std::string text, Point at, Colour colour, double size, Anchor anchor = Anchor::start,
               bool bold = false, Belonging of = {}) {
        words.push_back({std::move(text), at, colour, size, anchor, bold, of});
    }
};

/// About how wide `text` is drawn, rather more than less: fonts differ.
double text_width(std::string_view text, double size, bool bold = false);

/// printable(), without what XML and HTML would take for mark-up.
std::string escaped(std::string_view text);

/// "#rrggbb"
std::string to_hex(Colour colour);

/// `with_data`: also what its elements belong to and its curves stand for, as attributes that a page's script
/// reads.
std::string to_svg(const Picture& picture, bool with_data = false);

/// By the extension of `path`: .svg, or .png at twice the size.
/// Throws std::invalid_argument for any other, std::runtime_error if the file cannot be written: it is then
/// as it was.
void write_picture(const Picture& picture, const std::filesystem::path& path);

}  // namespace cale
