// What any environment is to an agent and to the training loop: `VectorEnv` (cale/vector_env.h) is one, and
// so is whatever else has actions, observations and rewards (examples/custom_environment, examples/pendulum).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "world/spaces.h"
#include "world/step_result.h"

namespace cale {

/// One action for each environment: N vectors of a box, row by row, or N numbers of a discrete space.
using Actions = std::variant<std::span<const float>, std::span<const std::int64_t>>;

/// The state needed to reproduce everything that follows in one environment, as named bytes.
using EpisodeRecord = std::map<std::string, std::vector<std::uint8_t>>;

/// N environments that step together; one whose episode ended is reset within the same step. The caller keeps
/// the stack of observations: an environment writes the newest array alone, observation_space().frame_size()
/// bytes. One thread at a time may call an object. The same seeds and actions must give the same results,
/// except in real time.
class World {
  public:
    virtual ~World() = default;

    /// Returns the number of environments, N.
    virtual std::int64_t size() const = 0;
    /// Returns what step() takes.
    virtual ActionSpace action_space() const = 0;
    /// Returns what an agent sees.
    virtual ObservationSpace observation_space() const = 0;

    /// Starts a new episode everywhere. `frames`: N x frame_size bytes, the first observations.
    virtual void reset(std::span<std::uint8_t> frames) = 0;

    /// One agent step of every environment, written straight into the caller's memory.
    ///   frames        N x frame_size: the newest array, or the next episode's first
    ///   final_frames  N x frame_size: an episode's last array, written only where one is over
    ///   results       N
    /// Throws for an impossible action, such as std::invalid_argument, after all environments have finished
    /// the step.
    virtual void step(const Actions& actions, std::span<std::uint8_t> frames,
                      std::span<std::uint8_t> final_frames, std::span<StepResult> results) = 0;

    // Of worlds that run by themselves, in real time; the others have no use for these two.
    /// Tells what step() will be called with next, so that it counts from now on.
    virtual void announce(const Actions& /*actions*/) {}
    /// Stops the world's time, or lets it continue.
    virtual void pause(bool /*paused*/) {}

    /// Returns named figures for the log, by their tags; none of most worlds.
    virtual std::map<std::string, double> metrics() const { return {}; }

    /// Returns, for each environment, what resume() needs. Not while a step is under way.
    virtual std::vector<EpisodeRecord> record() const = 0;
    /// Continues in every environment as the one would that was recorded. The newest observations are not
    /// written: the caller has them. Throws std::runtime_error for a record that is damaged or another
    /// world's; for another number of them it may be std::invalid_argument.
    virtual void resume(std::span<const EpisodeRecord> records) = 0;
};

/// Makes the environments that have these seeds, one for each.
using MakeWorld = std::function<std::unique_ptr<World>(std::span<const std::uint32_t> seeds)>;

}  // namespace cale
