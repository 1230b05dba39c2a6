// A game's agent steps as a table: what was commanded, what the console saw, what came of it. The input of
// offline data sets.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include "cale/action.h"
#include "cale/stick_motion.h"
#include "world/step_result.h"

namespace cale {

/// What an agent step commands: the joystick, or the number of an event.
struct StepCommand {
    std::optional<ContinuousAction> stick{};
    std::int64_t number = -1;
};

/// Keeps the rows of a game and writes them at its end. The columns:
///   step                        from 1
///   action, r, theta, fire      the number of a discrete action, or the joystick's coordinates
///   x, y, button                where a stick that moves is after the step
///   event, frames               StepResult::event by its name; emulated frames
///   seen                        the event that the console saw in each frame, sticky actions included
///   reward, lives, terminal, truncated
class StepLog {
  public:
    explicit StepLog(std::filesystem::path file) : file_(std::move(file)) {}

    /// `position`: of a stick that moves.
    void add(const StepCommand& command, const StepResult& result,
             const std::optional<StickPosition>& position);
    /// Throws std::runtime_error, naming the file, where it cannot be written.
    void write() const;

  private:
    std::filesystem::path file_;
    std::int64_t steps_ = 0;
    std::string rows_;
};

}  // namespace cale
