#include "report/joystick_map.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <functional>
#include <string_view>

#include "cale/fields.h"
#include "report/panel.h"
#include "report/ranges.h"

namespace cale {
namespace {

using Polygon = std::vector<Point>;

/// The part of a convex polygon where `height` is positive; it is linear. (Sutherland and Hodgman 1974)
Polygon cut(const Polygon& polygon, const std::function<double(Point)>& height) {
    Polygon kept;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const auto a = polygon[i], b = polygon[(i + 1) % polygon.size()];
        const double above_a = height(a), above_b = height(b);
        if (above_a > 0) kept.push_back(a);
        if ((above_a > 0) != (above_b > 0)) {
            const double part = above_a / (above_a - above_b);
            kept.push_back({a.x + part * (b.x - a.x), a.y + part * (b.y - a.y)});
        }
    }
    return kept;
}

Point centre_of(const Polygon& polygon) {
    Point centre;
    for (const auto& corner : polygon) {
        centre.x += corner.x / static_cast<double>(polygon.size());
        centre.y += corner.y / static_cast<double>(polygon.size());
    }
    return centre;
}

/// Without the button.
Event event_at(Point stick, double threshold) {
    const ContinuousAction action{.radius = static_cast<float>(std::hypot(stick.x, stick.y)),
                                  .theta = static_cast<float>(std::atan2(stick.y, stick.x)),
                                  .fire = 0};
    return joystick_event(action, static_cast<float>(threshold));
}

/// -1, 0 or 1 to the right and up.
Point direction_of(Event event) {
    const auto stick = event_stick(event);
    return {std::round(stick.radius * std::cos(stick.theta)),
            std::round(stick.radius * std::sin(stick.theta))};
}

/// The event of the same region with the button pressed.
Event with_fire(Event event) {
    const auto direction = direction_of(event);
    return event_of(static_cast<int>(direction.x), static_cast<int>(direction.y), true);
}

Colour region_colour(Point direction) {
    if (direction.x == 0 && direction.y == 0) return series_colour(6);
    return series_colour(direction.x != 0 && direction.y != 0 ? 2 : 0);
}

void draw_disc(Picture& picture, Point centre, double radius, bool fire, double threshold,
               const std::vector<double>& shares) {
    const auto to_picture = [&](Point p) { return Point{centre.x + radius * p.x, centre.y - radius * p.y}; };
    for (const auto& region : joystick_regions(threshold)) {
        auto outline = mapped(region.outline, to_picture);
        const auto direction = direction_of(region.event);
        picture.areas.push_back({outline, region_colour(direction), fire ? 0.5 : 0.25});
        outline.push_back(outline.front());
        picture.lines.push_back({outline, kInk, 1.2});

        const auto event = fire ? with_fire(region.event) : region.event;
        const double share = shares[static_cast<std::size_t>(event)];
        const double length = std::hypot(direction.x, direction.y);
        auto at =
            length > 0 ? to_picture({1.07 * direction.x / length, 1.07 * direction.y / length}) : centre;
        at.y += direction.y > 0 ? -16 : direction.y < 0 ? 12 : length > 0 ? -3 : -2;
        const auto anchor = direction.x > 0 ? Anchor::start : direction.x < 0 ? Anchor::end : Anchor::middle;
        picture.write(std::string(event_name(event)), at, kInk, 12.5, anchor, true);
        picture.write(fmt::format("{:.1f}%", 100 * share), {at.x, at.y + 15}, kFaintInk, 11.5, anchor);
    }
}

}  // namespace

std::vector<JoystickRegion> joystick_regions(double threshold) {
    const auto part = [&](Polygon polygon, double Point::*axis, int side) {
        if (side != 0) return cut(polygon, [&](Point p) { return side * p.*axis - threshold; });
        for (const int bound : {1, -1})
            polygon = cut(polygon, [&](Point p) { return threshold - bound * p.*axis; });
        return polygon;
    };
    const auto whole = disc({}, 1, {}, 720).outline;
    std::vector<JoystickRegion> regions;
    for (const int vertical : {1, 0, -1}) {
        for (const int horizontal : {-1, 0, 1}) {
            auto outline = part(part(whole, &Point::x, horizontal), &Point::y, vertical);
            if (outline.size() < 3) continue;
            const auto event = event_at(centre_of(outline), threshold);
            regions.push_back({event, std::move(outline)});
        }
    }
    return regions;
}

namespace {

/// Calls `visit` with a joystick in each cell of a fine grid over the coordinates but the button, and its
/// share.
template <class Visit>
void visit_positions(Joystick joystick, Visit&& visit) {
    if (joystick == Joystick::factored) {
        for (std::int64_t action = 0; action < kEventCount; action += 2)
            visit(factored_stick(action), 2.0 / kEventCount);
        return;
    }
    const auto coordinates = stick_coordinates(joystick);
    const std::size_t axes = coordinates.size() - 1;                                          // without fire
    const std::size_t count = 1'000'000, cells = axes == 1 ? count : axes == 2 ? 1000 : 100;  // along an axis
    std::vector<float> action(axes + 1, 0.0F);
    for (std::size_t cell = 0; cell < count; ++cell) {
        for (std::size_t axis = 0, rest = cell; axis < axes; ++axis, rest /= cells) {
            const auto& [name, low, high] = coordinates[axis];
            const double part = (static_cast<double>(rest % cells) + 0.5) / static_cast<double>(cells);
            action[axis] = static_cast<float>(low + part * (high - low));
        }
        visit(stick(joystick, action), 1.0 / static_cast<double>(count));
    }
}

std::string title_of(double threshold, Joystick joystick) {
    return fmt::format("Joystick events at threshold {:g}, {} actions", threshold, name_of(joystick));
}

}  // namespace

std::vector<double> event_shares_of_random_actions(double threshold, Joystick joystick) {
    const double pressed = joystick == Joystick::factored ? 0.5 : 1 - threshold;
    std::vector<double> shares(kEventCount, 0.0);
    visit_positions(joystick, [&](ContinuousAction action, double part) {
        for (const bool fire : {false, true}) {
            action.fire = fire ? 1 : 0;
            const auto event = joystick_event(action, static_cast<float>(threshold));
            shares[static_cast<std::size_t>(event)] += part * (fire ? pressed : 1 - pressed);
        }
    });
    return shares;
}

Picture joystick_map(double threshold, Joystick joystick) {
    constexpr double kRadius = 150, kRoom = 130, kTop = 130;
    constexpr double kCell = 2 * (kRadius + kRoom);
    const auto shares = event_shares_of_random_actions(threshold, joystick);
    Picture picture = titled_picture(title_of(threshold, joystick), 2 * kCell);
    for (const bool fire : {false, true}) {
        const Point centre{kCell * (fire ? 1.5 : 0.5), kTop + kRadius};
        picture.write(
            fire ? fmt::format("fire > {:g}", threshold) : fmt::format("fire up to {:g}", threshold),
            {centre.x, 72}, kInk, 14, Anchor::middle, true);
        draw_disc(picture, centre, kRadius, fire, threshold, shares);
    }
    finish_picture(
        picture, kTop + 2 * kRadius + 50,
        "The disc of the stick: its distance from the centre is r, its angle theta, counter-clockwise from "
        "the right. Percentages: the part of uniformly random actions in the agent's coordinates.");
    return picture;
}

std::string joystick_map_text(double threshold, Joystick joystick) {
    constexpr int kRows = 21, kColumns = 43;  // a character is about twice as high as it is wide
    const auto sign = [](Point direction) {
        constexpr std::array<std::string_view, 3> kSigns{"/v\\", "<.>", "\\^/"};
        return kSigns[static_cast<std::size_t>(direction.y + 1)][static_cast<std::size_t>(direction.x + 1)];
    };
    std::string text = title_of(threshold, joystick) + "\n\n";
    for (int row = 0; row < kRows; ++row) {
        std::string line;
        for (int column = 0; column < kColumns; ++column) {
            const Point stick{2 * (column + 0.5) / kColumns - 1, 1 - 2 * (row + 0.5) / kRows};
            const bool inside = std::hypot(stick.x, stick.y) <= 1;
            line += inside ? sign(direction_of(event_at(stick, threshold))) : ' ';
        }
        text += "  " + line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
    }
    text += fmt::format("\nof uniformly random actions   fire up to {0:g}       fire > {0:g}\n", threshold);
    const auto shares = event_shares_of_random_actions(threshold, joystick);
    for (int i = 0; i < kEventCount; ++i) {
        const auto event = static_cast<Event>(i);
        if (event_name(event).find("FIRE") != std::string_view::npos) continue;
        const auto share = [&](Event of) { return 100 * shares[static_cast<std::size_t>(of)]; };
        text += fmt::format("  {}  {:<9}  {:>17.1f} %  {:>13.1f} %  {}\n", sign(direction_of(event)),
                            event_name(event), share(event), share(with_fire(event)),
                            event_name(with_fire(event)));
    }
    return text;
}

}  // namespace cale
