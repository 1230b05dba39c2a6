#include "cale/stick_motion.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "cale/setting.h"

namespace cale {
namespace {

/// The greatest speed of a unit step from rest with omega = 1.
double peak_speed(double damping) {
    if (damping == 1) return 1 / std::numbers::e;
    const double root = std::sqrt(std::abs(1 - damping * damping));
    const double phase = damping < 1 ? std::atan2(root, damping) : std::atanh(root / damping);
    return std::exp(-damping / root * phase);
}

/// A normal number by the polar method, so that every standard library draws the same.
double normal(std::mt19937& random) {
    const auto uniform = [&] { return 2 * (static_cast<double>(random()) + 0.5) / 0x1p32 - 1; };
    while (true) {
        const double u = uniform(), v = uniform(), square = u * u + v * v;
        if (square < 1) return u * std::sqrt(-2 * std::log(square) / square);
    }
}

}  // namespace

bool moves(const StickMotion& motion) {
    return motion.stick_speed || motion.button_frames > 0 || motion.action_latency.high > 0 ||
           motion.actuation_noise > 0;
}

namespace {

/// The names of the settings and their values.
std::vector<std::pair<std::string, std::string>> settings_of(StickMotion motion) {
    std::vector<std::pair<std::string, std::string>> settings;
    for (const auto& [name, help, range, member] : setting_fields(motion))
        settings.emplace_back(name, written_setting(member));
    return settings;
}

}  // namespace

std::string changed_settings(const StickMotion& motion) {
    const auto usual = settings_of({}), settings = settings_of(motion);
    std::string text;
    for (std::size_t i = 0; i < settings.size(); ++i) {
        const auto& [name, value] = settings[i];
        if (value == usual[i].second) continue;
        if (!text.empty()) text += ", ";
        text.append(name).append(1, ' ').append(value);
    }
    return text;
}

void check(const StickMotion& motion) {
    if (!motion.stick_damping || motion.stick_speed) return;
    throw std::invalid_argument(
        "env.stick_damping is set, but env.stick_speed is none: a stick that is at once in its commanded "
        "position has no mass; set env.stick_speed too, such as 0.2");
}

StickPosition position_of(const ContinuousAction& action) {
    return {.x = action.radius * std::cos(action.theta),
            .y = action.radius * std::sin(action.theta),
            .button = action.fire};
}

MovingStick::MovingStick(const StickMotion& motion, bool one_axis) : motion_(motion), one_axis_(one_axis) {
    if (motion.stick_damping) transition_ = transition(*motion.stick_speed, *motion.stick_damping);
}

void MovingStick::centre(std::mt19937& random) {
    wire_.start(draw(motion_.action_latency, random), {});
    command_ = position_ = {};
    speed_x_ = speed_y_ = 0;
}

void MovingStick::command(const ContinuousAction& action, std::mt19937& random) {
    command_ = position_of(action);
    if (one_axis_) command_.y = 0;
    if (motion_.actuation_noise == 0) return;
    command_.x += motion_.actuation_noise * normal(random);
    if (!one_axis_) command_.y += motion_.actuation_noise * normal(random);
    const double radius = std::hypot(command_.x, command_.y);
    if (radius <= 1) return;
    command_.x /= radius;
    command_.y /= radius;
}

void MovingStick::advance() {
    StickPosition target = command_;
    wire_.pass(target);
    if (motion_.stick_damping) {
        move_with_mass(target);
    } else {
        move_at_even_speed(target);
    }
    if (motion_.button_frames == 0) {
        position_.button = target.button;
    } else {
        const double step = 1.0 / static_cast<double>(motion_.button_frames);
        position_.button += std::clamp(target.button - position_.button, -step, step);
    }
}

void MovingStick::move_at_even_speed(const StickPosition& target) {
    const double x = target.x - position_.x, y = target.y - position_.y, distance = std::hypot(x, y);
    if (!motion_.stick_speed || distance <= *motion_.stick_speed) {
        position_.x = target.x;
        position_.y = target.y;
        return;
    }
    position_.x += x * *motion_.stick_speed / distance;
    position_.y += y * *motion_.stick_speed / distance;
}

void MovingStick::move_with_mass(const StickPosition& target) {
    const auto move = [this](double& position, double& speed, double to) {
        const double away = position - to;
        position = to + transition_.position_to_position * away + transition_.speed_to_position * speed;
        speed = transition_.position_to_speed * away + transition_.speed_to_speed * speed;
    };
    move(position_.x, speed_x_, target.x);
    move(position_.y, speed_y_, target.y);
    stop_at_rim();
}

void MovingStick::stop_at_rim() {
    const double radius = std::hypot(position_.x, position_.y);
    if (radius <= 1) return;
    const double x = position_.x / radius, y = position_.y / radius;
    position_.x = x;
    position_.y = y;
    const double outwards = std::max(0.0, x * speed_x_ + y * speed_y_);
    speed_x_ -= outwards * x;
    speed_y_ -= outwards * y;
}

MovingStick::Transition MovingStick::transition(double speed, double damping) {
    const double omega = speed / peak_speed(damping), decay = std::exp(-damping * omega);
    // The solution of the oscillator after one frame; sine is that of the frequency divided by it.
    double cosine = 1, sine = 1;
    const double frequency = omega * std::sqrt(std::abs(1 - damping * damping));
    if (frequency > 0) {
        cosine = damping < 1 ? std::cos(frequency) : std::cosh(frequency);
        sine = (damping < 1 ? std::sin(frequency) : std::sinh(frequency)) / frequency;
    }
    return {.position_to_position = decay * (cosine + damping * omega * sine),
            .speed_to_position = decay * sine,
            .position_to_speed = -decay * omega * omega * sine,
            .speed_to_speed = decay * (cosine - damping * omega * sine)};
}

std::int64_t draw(const IntegerRange& range, std::mt19937& random) {
    if (range.low == range.high) return range.low;
    const auto choices = static_cast<std::uint64_t>(range.high - range.low) + 1;
    return range.low + static_cast<std::int64_t>((random() * choices) >> 32);
}

}  // namespace cale
