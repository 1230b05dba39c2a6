#include "play/stick_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

#include <fmt/format.h>

#include "report/csv.h"
#include "report/panel.h"

namespace cale {
namespace {

constexpr double kFramesPerSecond = 60;
constexpr double kLongestLog = 600, kLongestGap = 0.1;  // seconds
constexpr double kLeastMotion = 0.05;                   // radii
constexpr double kRounding = 5.1e-4;      // seconds that a time, given to the millisecond, may be off by
constexpr std::size_t kMostLatency = 60;  // frames
constexpr double kSlowest = 0.001, kFastest = 2, kLightest = 0.05, kHeaviest = 5;

[[noreturn]] void refuse(const CsvTable& table, std::size_t row, const std::string& what) {
    throw std::runtime_error(fmt::format("{}:{}: {}", table.path.string(), table.lines[row], what));
}

/// The log's rows, and their times from the first one on.
struct Rows {
    std::vector<double> seconds;
    std::vector<StickSample> commanded, measured;
};

Rows rows_of(const CsvTable& table) {
    std::array<std::size_t, 5> columns{};
    constexpr std::array kNames{"seconds", "command_x", "command_y", "x", "y"};
    for (std::size_t i = 0; i < columns.size(); ++i) {
        const auto found = table.find(kNames[i]);
        if (!found) {
            throw std::runtime_error(
                fmt::format("{}: there is no column '{}'; it needs seconds,command_x,command_y,x,y",
                            table.path.string(), kNames[i]));
        }
        columns[i] = *found;
    }
    Rows rows;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
        const auto number = [&](std::size_t i) { return table.number(row, columns[i]); };
        rows.seconds.push_back(number(0) - table.number(0, columns[0]));
        rows.commanded.push_back({number(1), number(2)});
        rows.measured.push_back({number(3), number(4)});
        if (row > 0 && rows.seconds[row] <= rows.seconds[row - 1])
            refuse(table, row, "the seconds must increase from row to row");
        for (const auto& [x, y] : {rows.commanded.back(), rows.measured.back()}) {
            if (std::hypot(x, y) > 1.2) {
                refuse(table, row,
                       fmt::format("({:g}, {:g}) is more than 1.2 radii from the centre: positions are in "
                                   "radii of the stick's travel",
                                   x, y));
            }
        }
    }
    return rows;
}

/// Throws where the stick moved between two rows that lie too far apart to say how.
void require_no_gaps(const CsvTable& table, const Rows& rows) {
    for (std::size_t row = 1; row < rows.seconds.size(); ++row) {
        const double gap = rows.seconds[row] - rows.seconds[row - 1];
        const auto &from = rows.measured[row - 1], &to = rows.measured[row];
        const double moved = std::hypot(to.x - from.x, to.y - from.y);
        if (gap > kLongestGap + kRounding && moved > kLeastMotion)
            refuse(table, row,
                   fmt::format(
                       "the stick moved by {:.2g} radii in the {:.3g} s before this row: log it every {} "
                       "s or more often while it moves",
                       moved, gap, kLongestGap));
    }
}

StickSample between(const StickSample& a, const StickSample& b, double part) {
    return {a.x + part * (b.x - a.x), a.y + part * (b.y - a.y)};
}

/// The square of the distance between a path that is `latency` frames late and what was measured, summed.
double squared_error(const std::vector<StickSample>& path, const std::vector<StickSample>& measured,
                     std::size_t latency) {
    double sum = 0;
    for (std::size_t i = 0; i < measured.size(); ++i) {
        const StickSample at = i < latency ? StickSample{} : path[i - latency];
        const double x = at.x - measured[i].x, y = at.y - measured[i].y;
        sum += x * x + y * y;
    }
    return sum;
}

struct Candidate {
    double speed = 0, damping = 0;  // damping 0: without mass
    std::size_t latency = 0;
    double error = std::numeric_limits<double>::infinity();
};

StickMotion motion_of(const Candidate& candidate) {
    const auto latency = static_cast<std::int64_t>(candidate.latency);
    StickMotion motion{.stick_speed = candidate.speed, .action_latency = {latency, latency}};
    if (candidate.damping > 0) motion.stick_damping = candidate.damping;
    return motion;
}

/// The candidate with its best latency and its error.
Candidate with_latency(const StickLog& log, Candidate candidate) {
    candidate.latency = 0;
    const auto path = simulated(motion_of(candidate), log.commanded);
    for (std::size_t latency = 0; latency <= std::min(kMostLatency, log.commanded.size() - 1); ++latency) {
        const double error = squared_error(path, log.measured, latency);
        if (error < candidate.error) {
            candidate.error = error;
            candidate.latency = latency;
        }
    }
    return candidate;
}

/// Searches a grid over the logarithms, and then ever closer around the best.
Candidate search(const StickLog& log, bool mass) {
    constexpr int kSpeeds = 48, kDampings = 24;
    double speed_step = std::pow(kFastest / kSlowest, 1.0 / kSpeeds);
    double damping_step = std::pow(kHeaviest / kLightest, 1.0 / kDampings);
    Candidate best;
    const auto consider = [&](double speed, double damping) {
        const auto candidate = with_latency(log, {std::clamp(speed, kSlowest, kFastest),
                                                  mass ? std::clamp(damping, kLightest, kHeaviest) : 0.0, 0,
                                                  std::numeric_limits<double>::infinity()});
        if (candidate.error >= best.error) return false;
        best = candidate;
        return true;
    };
    for (int i = 0; i <= kSpeeds; ++i)
        for (int j = 0; j <= (mass ? kDampings : 0); ++j)
            consider(kSlowest * std::pow(speed_step, i), kLightest * std::pow(damping_step, j));
    while (speed_step > 1.0001) {
        const auto [speed, damping, latency, error] = best;
        bool better = false;
        for (const double a : {1 / speed_step, 1.0, speed_step})
            for (const double b : {1 / damping_step, 1.0, damping_step})
                better = consider(a * speed, b * damping) || better;
        if (better) continue;
        speed_step = std::sqrt(speed_step);
        damping_step = std::sqrt(damping_step);
    }
    return best;
}

FittedStick fitted(const StickLog& log, bool mass) {
    const auto best = search(log, mass);
    return {motion_of(best), std::sqrt(best.error / static_cast<double>(log.measured.size()))};
}

Line curve(const Panel& panel, const std::vector<double>& values, Colour colour, double width) {
    Line line{.points = {}, .colour = colour, .width = width};
    for (std::size_t i = 0; i < values.size(); ++i)
        line.points.push_back({panel.to_x(static_cast<double>(i)), panel.to_y(values[i])});
    return line;
}

/// The log frame by frame.
StickLog by_frames(const Rows& rows) {
    StickLog log;
    std::size_t row = 0;
    const auto row_at = [&](double seconds) {
        while (row + 1 < rows.seconds.size() && rows.seconds[row + 1] <= seconds + kRounding) ++row;
        return row;
    };
    for (std::size_t frame = 1;
         static_cast<double>(frame) / kFramesPerSecond <= rows.seconds.back() + kRounding; ++frame) {
        // The frame's command is that of its middle, so that commands given between frames are as often early
        // as late; the position is that of its end.
        log.commanded.push_back(
            rows.commanded[row_at((static_cast<double>(frame) - 0.5) / kFramesPerSecond)]);
        const double end = static_cast<double>(frame) / kFramesPerSecond;
        const std::size_t at = row_at(end), next = std::min(at + 1, rows.seconds.size() - 1);
        const double length = rows.seconds[next] - rows.seconds[at];
        const double part = length > 0 ? std::max(0.0, end - rows.seconds[at]) / length : 0;
        log.measured.push_back(between(rows.measured[at], rows.measured[next], part));
    }
    return log;
}

std::vector<double> along(const std::vector<StickSample>& samples, double StickSample::*axis) {
    std::vector<double> values(samples.size());
    std::ranges::transform(samples, values.begin(), axis);
    return values;
}

}  // namespace

StickLog read_stick_log(const std::filesystem::path& csv) {
    const auto table = read_csv_by_hand(csv);
    const auto rows = rows_of(table);
    if (rows.seconds.empty() || rows.seconds.back() < 0.5) {
        throw std::runtime_error(
            fmt::format("{}: it is shorter than half a second: no motion can be seen in it", csv.string()));
    }
    if (rows.seconds.back() > kLongestLog) {
        throw std::runtime_error(
            fmt::format("{}: it lasts {:.6g} s: at most {:.0f} s can be fitted; are these seconds?",
                        csv.string(), rows.seconds.back(), kLongestLog));
    }
    if (std::hypot(rows.measured[0].x, rows.measured[0].y) > 0.2)
        refuse(table, 0, "the stick must begin at rest in its centre, (0, 0)");
    const auto moves = [](const StickSample& at) { return std::hypot(at.x, at.y) > kLeastMotion; };
    for (const auto& [name, samples] :
         {std::pair("commanded to move", &rows.commanded), std::pair("moved", &rows.measured)}) {
        if (std::ranges::any_of(*samples, moves)) continue;
        throw std::runtime_error(fmt::format(
            "{}: the stick is never {} by more than 0.05 radii: nothing can be fitted", csv.string(), name));
    }
    require_no_gaps(table, rows);
    return by_frames(rows);
}

std::vector<StickSample> simulated(const StickMotion& motion, const std::vector<StickSample>& commanded) {
    std::mt19937 random;  // of a fixed latency and without noise nothing is drawn
    MovingStick stick(motion);
    stick.centre(random);
    std::vector<StickSample> path;
    path.reserve(commanded.size());
    for (const auto& [x, y] : commanded) {
        const double radius = std::min(1.0, std::hypot(x, y)), theta = std::atan2(y, x);
        stick.command({static_cast<float>(radius), static_cast<float>(theta), 0}, random);
        stick.advance();
        path.push_back({stick.position().x, stick.position().y});
    }
    return path;
}

StickFit fit_stick(const StickLog& log) {
    return {.without_mass = fitted(log, false), .with_mass = fitted(log, true)};
}

Picture stick_fit_picture(const StickLog& log, const StickFit& fit) {
    constexpr double kWidth = 860, kHeight = 170, kLeft = 66, kTop = 84, kBetween = 46;
    auto picture = titled_picture("A joystick's motion and its fit", kWidth);
    draw_legend(picture, {"commanded", "measured", "fitted"}, kLeft, kWidth - kMargin, 46);
    const auto path = simulated(fit.best().motion, log.commanded);
    double top = kTop;
    for (const auto& [name, axis] : {std::pair("x", &StickSample::x), std::pair("y", &StickSample::y)}) {
        const Panel panel{.left = kLeft,
                          .top = top,
                          .right = kWidth - kMargin,
                          .bottom = top + kHeight,
                          .x = {0, static_cast<double>(log.commanded.size() - 1)},
                          .y = {-1.15, 1.15}};
        draw_axes(picture, panel, 8, 5);
        picture.lines.push_back(curve(panel, along(log.commanded, axis), series_colour(0), 1.2));
        picture.lines.push_back(curve(panel, along(log.measured, axis), series_colour(1), 2.5));
        picture.lines.push_back(curve(panel, along(path, axis), series_colour(2), 1.5));
        picture.words.push_back({name, {kMargin, top + kHeight / 2}, kInk, 13, Anchor::start, true});
        top += kHeight + kBetween;
    }
    finish_picture(
        picture, top - 12,
        fmt::format(
            "Frames of 1/60 s; positions in radii. The fit's error is {:.3f} radii (root mean square).",
            fit.best().error));
    return picture;
}

namespace {

/// The motion of a stick that is commanded to the right with the button, and then back to the centre.
struct StepResponse {
    std::vector<double> commanded{0}, x{0}, button{0};  // before the first frame, and after each
    std::vector<Event> events;                          // of each frame
};

/// Frames rounded up to whole agent steps: a stick is commanded once in each.
std::int64_t whole_steps(const EnvConfig& env, std::int64_t frames) {
    return (frames + env.frame_skip - 1) / env.frame_skip * env.frame_skip;
}

StepResponse step_response(const EnvConfig& env, std::int64_t frames_held) {
    frames_held = whole_steps(env, frames_held);
    auto motion = env.motion;
    motion.action_latency.low = motion.action_latency.high;
    std::mt19937 random(1);
    MovingStick stick(motion);
    stick.centre(random);
    const auto threshold = static_cast<float>(env.threshold);
    StepResponse response;
    float target = 0;
    for (std::int64_t frame = 0; frame < 2 * frames_held; ++frame) {
        if (frame % env.frame_skip == 0) {
            target = frame < frames_held ? 1 : 0;
            stick.command({target, 0, target}, random);
        }
        stick.advance();
        const auto& [x, y, button] = stick.position();
        response.commanded.push_back(target);
        response.x.push_back(x);
        response.button.push_back(button);
        response.events.push_back(joystick_event_at(static_cast<float>(x), static_cast<float>(y),
                                                    static_cast<float>(button), threshold, env.event_map));
    }
    return response;
}

/// A sentence where the fit is far from the log, and one for each value that lies where the search ended;
/// else empty.
std::string warnings(const FittedStick& fit) {
    constexpr double kFar = 0.25;  // radii; a stick that follows its commands is nearer in any log
    const auto& motion = fit.motion;
    std::string text;
    if (fit.error > kFar)
        text += fmt::format(
            "# Warning: the fitted stick is {:.2f} radii away from the log's: are x and y in their columns, "
            "y up, and is there a row for every moment?\n",
            fit.error);
    const auto warn = [&text](bool at_end, const char* name) {
        if (!at_end) return;
        text += fmt::format(
            "# Warning: {} is at the end of what was searched: are the log's units radii and seconds?\n",
            name);
    };
    const auto near = [](double value, double end) { return std::abs(value / end - 1) < 1e-3; };
    warn(near(*motion.stick_speed, kSlowest) || near(*motion.stick_speed, kFastest), "stick_speed");
    warn(motion.stick_damping &&
             (near(*motion.stick_damping, kLightest) || near(*motion.stick_damping, kHeaviest)),
         "stick_damping");
    warn(motion.action_latency.low == static_cast<std::int64_t>(kMostLatency), "action_latency");
    return text;
}

}  // namespace

std::string stick_fit_text(const StickLog& log, const StickFit& fit) {
    const auto& best = fit.best();
    std::string text = fmt::format(
        "# Fitted to {} frames of 1/60 s; error {:.4f} radii (root mean square), {:.4f} without mass and "
        "{:.4f} with it.\nenv:\n  stick_speed: {:.4g}\n",
        log.commanded.size(), best.error, fit.without_mass.error, fit.with_mass.error,
        *best.motion.stick_speed);
    if (best.motion.stick_damping)
        text += fmt::format("  stick_damping: {:.4g}\n", *best.motion.stick_damping);
    text += fmt::format("  action_latency: {}\n", best.motion.action_latency.low);
    return warnings(best) + text;
}

std::string step_response_text(const EnvConfig& env, std::int64_t frames_held) {
    const auto response = step_response(env, frames_held);
    std::string text = "frame      x  button  event\n";
    for (std::size_t frame = 0; frame < response.events.size(); ++frame) {
        text += fmt::format("{:>5}  {:>5.2f}  {:>6.2f}  {}\n", frame + 1, response.x[frame + 1] + 0.0,
                            response.button[frame + 1], event_name(response.events[frame]));
    }
    return text;
}

Picture step_response_picture(const EnvConfig& env, std::int64_t frames_held) {
    constexpr double kWidth = 860, kLeft = 66, kTop = 72, kBottom = 318, kStrip = 30;
    const auto settings = changed_settings(env.motion);
    auto picture = titled_picture("The step response of a joystick", kWidth);
    draw_legend(picture, {"commanded", "stick", "button"}, kLeft, kWidth - kMargin, 46);
    const auto [commanded, x, button, events] = step_response(env, frames_held);
    const auto frames = events.size();
    const Panel panel{.left = kLeft,
                      .top = kTop,
                      .right = kWidth - kMargin,
                      .bottom = kBottom,
                      .x = {0, static_cast<double>(frames)},
                      .y = {std::min(0.0, *std::ranges::min_element(x)) - 0.06, 1.06}};
    draw_axes(picture, panel, 10, 6);
    const double line = panel.to_y(env.threshold);
    picture.lines.push_back({{{panel.left, line}, {panel.right, line}}, kFaintInk, 1, true});
    picture.words.push_back({"threshold", {panel.right, line - 5}, kFaintInk, 11, Anchor::end});
    picture.lines.push_back(curve(panel, commanded, series_colour(0), 1.2));
    picture.lines.push_back(curve(panel, x, series_colour(1), 2.5));
    picture.lines.push_back(curve(panel, button, series_colour(2), 1.5));
    // The events, from frame to frame: a strip with a field for each stretch of the same one.
    const double top = kBottom + 34;
    for (std::size_t first = 0, last = 0; first < frames; first = last) {
        while (last < frames && events[last] == events[first]) ++last;
        const double left = panel.to_x(static_cast<double>(first)),
                     right = panel.to_x(static_cast<double>(last));
        const bool nothing = events[first] == Event::noop;
        picture.areas.push_back(rectangle(left + 0.5, top, right - 0.5, top + kStrip,
                                          nothing ? kGrid : series_colour(1), nothing ? 1 : 0.25));
        const std::string name(event_name(events[first]));
        if (text_width(name, 11) < right - left)
            picture.words.push_back({name, {(left + right) / 2, top + 19}, kInk, 11, Anchor::middle});
    }
    finish_picture(
        picture, top + kStrip + 6,
        fmt::format("Frames of 1/60 s. {}. Commanded to the right with the button for {} frames, "
                    "then back to the centre. Below: the event that the console sees.",
                    settings.empty() ? "CALE's own joystick" : settings, whole_steps(env, frames_held)));
    return picture;
}

}  // namespace cale
