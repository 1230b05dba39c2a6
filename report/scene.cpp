#include "report/scene.h"

#include <fmt/format.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

namespace cale {
namespace {

constexpr int kScale = 3;
constexpr int kGap = 24;
constexpr int kPanelWidth = kScale * kFrameWidth;
constexpr int kViewTop = kGap + 26;  // what the agent sees
constexpr int kDialTop = kViewTop + kScale * kFrameHeight + 50;
constexpr int kDialRadius = 88;
constexpr int kTextTop = kDialTop + 2 * kDialRadius + 22;  // the event, and below it the numbers

// Colours are RGB, as the image is.
const cv::Scalar kBackground(22, 25, 31);
const cv::Scalar kFaint(70, 77, 89);
const cv::Scalar kText(222, 226, 233);
const cv::Scalar kStick(255, 196, 61);
const cv::Scalar kFire(232, 77, 61);

constexpr int kFixedPointBits = 4;
cv::Point fixed_point(cv::Point2d point) {
    return {static_cast<int>(std::lround(point.x * (1 << kFixedPointBits))),
            static_cast<int>(std::lround(point.y * (1 << kFixedPointBits)))};
}

void draw_line(cv::Mat& image, cv::Point2d a, cv::Point2d b, const cv::Scalar& colour, int width) {
    cv::line(image, fixed_point(a), fixed_point(b), colour, width, cv::LINE_AA, kFixedPointBits);
}

void draw_circle(cv::Mat& image, cv::Point2d centre, double radius, const cv::Scalar& colour, int width) {
    cv::circle(image, fixed_point(centre), static_cast<int>(std::lround(radius * (1 << kFixedPointBits))),
               colour, width, cv::LINE_AA, kFixedPointBits);
}

void draw_text(cv::Mat& image, const std::string& words, cv::Point position, double size,
               const cv::Scalar& colour) {
    cv::putText(image, words, position, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
}

/// Where the stick is in the unit disc, y up, and how far the button is pressed.
struct StickState {
    cv::Point2d stick;
    double fire;
};

StickState commanded(const Scene& scene) {
    const auto action = scene.action.value_or(event_stick(scene.event));
    return {{action.radius * std::cos(action.theta), action.radius * std::sin(action.theta)}, action.fire};
}

void draw_joystick(cv::Mat& image, const Scene& scene, cv::Point2d centre, double radius) {
    const auto target = commanded(scene);
    const auto [stick, fire] =
        scene.stick ? StickState{{scene.stick->x, scene.stick->y}, scene.stick->button} : target;
    const auto at = [&](double x, double y) { return centre + radius * cv::Point2d(x, -y); };

    draw_circle(image, centre, radius, kFaint, 2);
    if (scene.paddle) {
        draw_line(image, at(-1, 0), at(1, 0), kFaint, 1);
    } else if (scene.action || scene.stick) {
        const double tau = scene.threshold, reach = std::sqrt(std::max(0.0, 1 - tau * tau));
        for (const double side : {-tau, tau}) {
            draw_line(image, at(side, -reach), at(side, reach), kFaint, 1);
            draw_line(image, at(-reach, side), at(reach, side), kFaint, 1);
        }
    }
    if (scene.stick && scene.action) draw_circle(image, at(target.stick.x, target.stick.y), 8, kText, 2);
    draw_line(image, centre, at(stick.x, stick.y), kStick, 3);
    draw_circle(image, at(stick.x, stick.y), 8, kStick, cv::FILLED);

    const cv::Point2d meter(centre.x + radius + 30, centre.y + radius);  // its lower left corner
    constexpr double width = 26;
    const double height = 2 * radius;
    cv::rectangle(image, cv::Point2d(meter.x, meter.y - height * fire), cv::Point2d(meter.x + width, meter.y),
                  kFire, cv::FILLED);
    cv::rectangle(image, cv::Point2d(meter.x, meter.y - height), cv::Point2d(meter.x + width, meter.y),
                  kFaint, 2);
    if (scene.action || scene.stick) {
        const double mark = meter.y - height * scene.threshold;
        draw_line(image, {meter.x - 5, mark}, {meter.x + width + 5, mark}, kText, 1);
    }
}

}  // namespace

Image compose_frame(const Scene& scene) {
    const auto screen_bytes =
        std::size_t{3} * static_cast<std::size_t>(scene.screen_width * scene.screen_height);
    // The joystick's bytes after the memory are not drawn: it has a dial of its own.
    const bool memory = scene.observation.size() >= kRamSize && scene.observation.size() < kFrameSize;
    if (scene.screen.size() != screen_bytes || (!memory && scene.observation.size() != kFrameSize)) {
        throw std::invalid_argument(
            fmt::format("a scene needs {} bytes of screen and {} of observation, but has {} and {}",
                        screen_bytes, kFrameSize, scene.screen.size(), scene.observation.size()));
    }
    Image image;
    image.width = kScale * scene.screen_width + kGap + kPanelWidth + kGap;
    image.height = kScale * scene.screen_height;
    image.width += image.width % 2;
    image.height += image.height % 2;
    image.rgb.resize(std::size_t{3} * static_cast<std::size_t>(image.width * image.height));
    cv::Mat canvas(image.height, image.width, CV_8UC3, image.rgb.data());
    canvas.setTo(kBackground);

    const cv::Mat screen(scene.screen_height, scene.screen_width, CV_8UC3,
                         const_cast<std::uint8_t*>(scene.screen.data()));
    const cv::Rect left(0, 0, kScale * scene.screen_width, kScale * scene.screen_height);
    cv::resize(screen, canvas(left), left.size(), 0, 0, cv::INTER_NEAREST);

    const int x = left.width + kGap;
    draw_text(canvas, "what the agent sees", {x, kViewTop - 14}, 0.5, kText);
    const cv::Mat grey(memory ? 8 : kFrameHeight, memory ? 16 : kFrameWidth, CV_8UC1,
                       const_cast<std::uint8_t*>(scene.observation.data()));
    cv::Mat observation;
    cv::cvtColor(grey, observation, cv::COLOR_GRAY2RGB);
    const cv::Rect view(x, kViewTop, kPanelWidth, kScale * kFrameHeight);
    cv::resize(observation, canvas(view), view.size(), 0, 0, cv::INTER_NEAREST);

    draw_text(canvas, "what it does", {x, kDialTop - 16}, 0.5, kText);
    const Dial dial = joystick_dial(scene.screen_width);
    draw_joystick(canvas, scene, {dial.x, dial.y}, dial.radius);
    draw_text(canvas, "fire", {x + 206, kTextTop}, 0.5, kText);
    draw_text(canvas, std::string(event_name(scene.event)), {x, kTextTop}, 0.55, kStick);
    draw_text(canvas, fmt::format("return {:.10g}", scene.episode_return), {x, kTextTop + 38}, 0.75, kText);
    if (scene.value)
        draw_text(canvas, fmt::format("value {:.3g}", *scene.value), {x, kTextTop + 64}, 0.5, kText);
    return image;
}

Image compose_frame(const Env& env, Scene scene) {
    std::vector<std::uint8_t> screen;
    env.screen_rgb(screen);
    scene.screen = screen;
    scene.screen_width = env.screen_width();
    scene.screen_height = env.screen_height();
    return compose_frame(scene);
}

Dial joystick_dial(int screen_width) {
    return {.x = kScale * screen_width + kGap + kDialRadius + 2.0,
            .y = kDialTop + static_cast<double>(kDialRadius),
            .radius = kDialRadius};
}

}  // namespace cale
