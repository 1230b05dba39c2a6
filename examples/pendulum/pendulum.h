// The pendulum of Gymnasium (Pendulum-v1), seen as pictures; an action is the torque.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <random>
#include <span>
#include <string>

#include <cale/fields.h>
#include <world/environments.h>

namespace example {

// Gymnasium's rules and constants.
class Pendulum {
  public:
    static constexpr int kSide = 32;  // rows and columns of a frame
    static constexpr float kMaxTorque = 2;

    explicit Pendulum(std::uint32_t seed) : random_(seed) {}

    static cale::ActionSpace action_space() {
        return cale::Box{.low = {-kMaxTorque}, .high = {kMaxTorque}, .names = {"torque"}};
    }
    // How fast it turns can be seen from two frames.
    static cale::ObservationSpace observation_space() { return {.stack = 3, .shape = {kSide, kSide}}; }

    void reset() {
        angle_ = between(-std::numbers::pi, std::numbers::pi);
        speed_ = between(-1, 1);
        steps_ = 0;
    }

    cale::StepResult step(std::span<const float> action) {
        constexpr double kTimeStep = 0.05, kGravity = 10, kMaxSpeed = 8;
        const double torque = action[0];
        const double from_top = std::remainder(angle_, 2 * std::numbers::pi);
        const double cost = from_top * from_top + 0.1 * speed_ * speed_ + 0.001 * torque * torque;
        speed_ += (1.5 * kGravity * std::sin(angle_) + 3 * torque) * kTimeStep;
        speed_ = std::clamp(speed_, -kMaxSpeed, kMaxSpeed);
        angle_ += speed_ * kTimeStep;
        cale::StepResult result;
        result.reward = static_cast<float>(-cost);
        // Cut off, not terminal: the last state has a value.
        result.truncated = result.episode_over = ++steps_ == 200;
        return result;
    }

    // The rod from the middle, bright where a pixel's centre is near it.
    void draw(std::span<std::uint8_t> frame) const {
        constexpr double kMiddle = (kSide - 1) / 2.0, kLength = kSide / 2.0 - 2;
        const double right = std::sin(angle_), up = std::cos(angle_);
        for (int y = 0; y < kSide; ++y) {
            for (int x = 0; x < kSide; ++x) {
                const double dx = x - kMiddle, dy = kMiddle - y;
                const double along = std::clamp(dx * right + dy * up, 0.0, kLength);
                const double distance = std::hypot(dx - along * right, dy - along * up);
                const double light = std::clamp(2 - distance, 0.0, 1.0);
                frame[static_cast<std::size_t>(y * kSide + x)] =
                    static_cast<std::uint8_t>(std::lround(255 * light));
            }
        }
    }

    // What a checkpoint holds of it.
    template <class Visit>
    void visit_state(Visit&& visit) {
        visit("random", random_);
        visit("angle", angle_);
        visit("speed", speed_);
        visit("steps", steps_);
    }

  private:
    double between(double low, double high) {
        return low + (high - low) * static_cast<double>(random_()) / 4294967296.0;
    }

    std::mt19937 random_;
    double angle_ = 0, speed_ = 0;  // radians from the top, radians a second
    int steps_ = 0;
};

// Section env of the configuration.
struct PendulumConfig {
    std::int64_t num_envs = 1;
};

template <class Visit>
void fields(PendulumConfig& config, Visit&& visit) {
    visit("num_envs", config.num_envs, cale::Range{1, 1024}, "environments that step together");
}

// The functions that the training programs require of a world: see train/training_world.h.
inline std::string world_name(const PendulumConfig&) {
    return "Pendulum";
}
inline cale::ActionSpace action_space(const PendulumConfig&) {
    return Pendulum::action_space();
}
inline cale::ObservationSpace observation_space(const PendulumConfig&) {
    return Pendulum::observation_space();
}
inline std::unique_ptr<cale::World> make_world(const PendulumConfig&, std::span<const std::uint32_t> seeds) {
    return std::make_unique<cale::Environments<Pendulum>>(seeds);
}

}  // namespace example
