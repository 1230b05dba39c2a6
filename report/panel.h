// The elements of a report's figures: a palette, coordinate systems, ticks, legends, bands.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "report/aggregate.h"
#include "report/picture.h"

namespace cale {

inline constexpr Colour kPaper{0xff, 0xff, 0xff};
inline constexpr Colour kInk{0x33, 0x3a, 0x45};
inline constexpr Colour kFaintInk{0x6b, 0x73, 0x80};
inline constexpr Colour kGrid{0xe6, 0xe9, 0xed};

/// The colour of the group with this index: colours that the colour-blind tell apart (Okabe and Ito 2008,
/// without their yellow, which is too faint on white). The lines of the first seven groups are solid, those
/// of each seven after them dashed in another way, 28 in all.
Colour series_colour(std::size_t index);

/// Between `low` and `high`, inclusive, about `count` multiples of 1, 2 or 5 times a power of ten.
std::vector<double> nice_ticks(double low, double high, int count);

/// All in the same unit: 0, 5000, 10000 -> "0", "5k", "10k".
std::vector<std::string> tick_texts(const std::vector<double>& ticks);

/// A range of an axis.
struct Interval {
    double low = 0;
    double high = 1;
};

/// The interval that holds all of `values`, with a little room on either side; never empty.
Interval room_for(std::span<const double> values);

inline constexpr double kMargin = 24;  // of a figure, left and right

/// A picture with a title, as wide as it and `width` need.
Picture titled_picture(const std::string& title, double width);
/// Writes how the figure was computed below `bottom`, and sets the picture's height.
void finish_picture(Picture& picture, double bottom, const std::string& method);

/// A rectangle of a picture with a coordinate system of its own.
struct Panel {
    double left = 0, top = 0, right = 0, bottom = 0;  // in the picture, in pixels
    Interval x{}, y{};                                // what they stand for

    double to_x(double value) const { return left + (value - x.low) / (x.high - x.low) * (right - left); }
    double to_y(double value) const { return bottom - (value - y.low) / (y.high - y.low) * (bottom - top); }
};

/// How much of a picture there is.
struct Extent {
    std::size_t areas = 0, lines = 0, marks = 0, words = 0;
};
Extent extent_of(const Picture& picture);
/// Says that what was drawn since there was `before` is the panel of a game.
void assign_panel(Picture& picture, const Extent& before, const Panel& panel, std::string_view game);

/// About `count` ticks on the x axis, fewer where their words would touch.
std::vector<double> fitting_ticks(const Panel& panel, int count, double text_size);

/// A line under everything else, straight across a panel.
void draw_grid_line_at_x(Picture& picture, const Panel& panel, double value);

/// Grid lines with their values to the left, ticks with theirs below, about as many as given.
void draw_axes(Picture& picture, const Panel& panel, int x_ticks, int y_ticks, double text_size = 12);

/// A line through the values, and where `with_band` a band between low and high.
void draw_curve(Picture& picture, const Panel& panel, const std::vector<double>& x,
                const std::vector<Estimate>& y, std::size_t series, bool with_band);

/// A sample of each series that has a name, and the name, in as many rows as are needed between `left` and
/// `right`.
/// Returns the height in pixels below `top` that they take.
double draw_legend(Picture& picture, const std::vector<std::string>& names, double left, double right,
                   double top);

double widest(const std::vector<std::string>& texts, double size, bool bold = false);

/// `text` in lines no longer than `width` pixels.
std::vector<std::string> wrapped(std::string_view text, double width, double size);

}  // namespace cale
