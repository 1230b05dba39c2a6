// A joystick that moves: how the stick, its button and the wires of a machine follow their commands, frame by
// frame of the console (1/60 s). CALE's own joystick reaches the commanded position at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "cale/action.h"
#include "cale/fields.h"
#include "cale/integer_range.h"

namespace cale {

/// The defaults are CALE's joystick, without mass or delay.
struct StickMotion {
    std::optional<double> stick_speed{};
    std::optional<double> stick_damping{};
    std::int64_t button_frames = 0;
    IntegerRange action_latency{};
    IntegerRange observation_latency{};
    double actuation_noise = 0;
};

template <class Visit>
void fields(StickMotion& motion, Visit&& visit) {
    visit("stick_speed", motion.stick_speed, Range{0.001, 2},
          "radii per frame; with damping the greatest speed from the centre to the rim; none: the stick is "
          "at once in the commanded position");
    visit("stick_damping", motion.stick_damping, Range{0.05, 5},
          "damping ratio of a stick with mass, 1 is critical; none: it moves at its speed, without mass");
    visit("button_frames", motion.button_frames, Range{0, 60},
          "frames that the button takes from up to down");
    visit("action_latency", motion.action_latency, Range{0, 240},
          "frames until an action reaches the stick; 0-8: drawn for every game");
    visit("observation_latency", motion.observation_latency, Range{0, 240},
          "frames until the agent sees a screen; 0-8: drawn for every game");
    visit("actuation_noise", motion.actuation_noise, Range{0, 1},
          "standard deviation, in radii, of the noise on the x and y of each agent step's command");
}

/// Returns whether the stick does not simply follow: any of its settings but observation_latency is on.
bool moves(const StickMotion& motion);
/// Returns the settings that differ from CALE's joystick: "stick_speed 0.2, action_latency 0-8".
std::string changed_settings(const StickMotion& motion);
/// Throws std::invalid_argument for a damping without a speed.
void check(const StickMotion& motion);

/// Gives back what it was given so many calls ago.
template <class Value>
class DelayLine {
  public:
    /// The next `delay` calls give back `first`.
    void start(std::int64_t delay, const Value& first) {
        line_.assign(static_cast<std::size_t>(delay), first);
        next_ = 0;
    }
    /// Swaps `value` for that of `delay` calls ago.
    void pass(Value& value) {
        if (line_.empty()) return;
        std::swap(value, line_[next_]);
        next_ = (next_ + 1) % line_.size();
    }

  private:
    std::vector<Value> line_;
    std::size_t next_ = 0;  // the oldest
};

/// The stick in its unit disc, x to the right and y upwards, and its button.
struct StickPosition {
    double x = 0;       // -1 to 1
    double y = 0;       // -1 to 1
    double button = 0;  // 0 is up, 1 is down
};

/// Where the joystick for `action` is: its coordinates are float32, as joystick_event() computes them.
StickPosition position_of(const ContinuousAction& action);

/// A stick on its way. Without mass it moves straight towards the commanded position, stick_speed a frame.
/// With a damping ratio zeta it obeys
///     x'' = omega^2 (target - x) - 2 zeta omega x',
/// solved exactly from frame to frame. omega is such that a stick which is commanded from the centre to the
/// rim reaches stick_speed at its fastest. At the rim it stops. The button moves at its own even speed.
class MovingStick {
  public:
    /// At rest in the centre. `motion` must have passed check(). `one_axis`: a paddle, which has noise in x
    /// alone.
    explicit MovingStick(const StickMotion& motion, bool one_axis = false);

    /// Starts a game: at rest in the centre, the button up. Draws the latency of the game from `random`.
    void centre(std::mt19937& random);
    /// Tells the stick where to be from now on; that is known to it after the latency. Draws the noise.
    void command(const ContinuousAction& action, std::mt19937& random);
    /// Moves on by a frame.
    void advance();

    /// Returns where it is after the newest frame.
    const StickPosition& position() const { return position_; }

  private:
    void move_at_even_speed(const StickPosition& target);
    void move_with_mass(const StickPosition& target);
    void stop_at_rim();

    /// What becomes of a displacement from the target and of a speed in one frame.
    struct Transition {
        double position_to_position = 1, speed_to_position = 0;
        double position_to_speed = 0, speed_to_speed = 0;
    };
    static Transition transition(double speed, double damping);

    StickMotion motion_;
    bool one_axis_;
    Transition transition_;
    DelayLine<StickPosition> wire_;
    StickPosition command_, position_;
    double speed_x_ = 0, speed_y_ = 0;  // radii per frame
};

/// Returns a number of `range`, all equally likely. Draws from `random` only where there is a choice.
std::int64_t draw(const IntegerRange& range, std::mt19937& random);

}  // namespace cale
