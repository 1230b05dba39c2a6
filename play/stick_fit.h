// The motion of a real joystick from a log of commanded and measured positions (cale/stick_motion.h).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "cale/env.h"
#include "cale/stick_motion.h"
#include "report/picture.h"

namespace cale {

/// A position of the stick along both axes, in radii.
struct StickSample {
    double x = 0, y = 0;
};

/// The commanded position of a stick in each frame of 1/60 s, and the measured one at its end.
struct StickLog {
    std::vector<StickSample> commanded, measured;  // of one size
};

/// Reads a table with the columns seconds, command_x, command_y, x, y; others are ignored. A command holds
/// until the next row; between two rows the measured position is interpolated. Throws std::runtime_error,
/// naming the file, where it cannot be read, times do not increase, a position is more than 1.2 radii from
/// the centre, the stick does not begin in its centre, is never commanded to move or never moves by more than
/// 0.05 radii, does so between two rows that are more than 0.1 s apart, or the log is shorter than half a
/// second or longer than 600 s.
StickLog read_stick_log(const std::filesystem::path& csv);

/// Returns where a stick that moves so is in each frame of the log, which begins at rest in the centre. The
/// motion must have passed check().
std::vector<StickSample> simulated(const StickMotion& motion, const std::vector<StickSample>& commanded);

/// A model of a stick's motion, and how far it is from what was measured.
struct FittedStick {
    StickMotion motion;
    double error = 0;  // root mean square distance from what was measured, in radii
};

/// The speed and the latency, up to 60 frames, that explain a log best, without mass or with it.
struct StickFit {
    FittedStick without_mass, with_mass;
    /// With mass, if that lowers the error by a twentieth.
    const FittedStick& best() const {
        return with_mass.error < 0.95 * without_mass.error ? with_mass : without_mass;
    }
};
StickFit fit_stick(const StickLog& log);

/// The best fit as the section env of a configuration file, and the errors of both fits as its comments.
std::string stick_fit_text(const StickLog& log, const StickFit& fit);
/// x and y of the log over time: commanded, measured, and of the best fit.
Picture stick_fit_picture(const StickLog& log, const StickFit& fit);

/// The step response, see below, as a table: frame, x, button, event.
std::string step_response_text(const EnvConfig& env, std::int64_t frames_held);
/// The step response of the environment's joystick: it is commanded to the right with the button, and in
/// the first agent step after `frames_held` frames to return. x and the button over time, the threshold, and
/// below it the event of each frame. A latency that is drawn is the longest.
Picture step_response_picture(const EnvConfig& env, std::int64_t frames_held);

}  // namespace cale
