// N environments stepped together on threads of their own.
//
//     cale::EnvConfig config = cale::protocol_200m("pong");
//     config.num_envs = 8;
//     cale::VectorEnv envs(config, seeds);              // 8 seeds
//     envs.reset(frames);                               // 8 x kFrameSize bytes
//     envs.step(actions, frames, final_frames, results);
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "cale/env.h"
#include "world/world.h"

namespace cale {

/// Environments are distributed over threads; a thread that has finished its own helps another. Results are
/// in the order of the environments and do not depend on which thread stepped them. An environment whose
/// episode ended is reset within the same step.
///
/// All memory is the caller's and may be reused in every step; only steps in which an episode ends allocate.
/// Only one thread at a time may call an object.
class VectorEnv final : public World {
  public:
    /// One seed per environment: config.num_envs of them. Several games are played in turn: environment i
    /// plays number i modulo their number. Throws as Env does, and std::invalid_argument for
    /// another number of seeds.
    VectorEnv(const EnvConfig& config, std::span<const std::uint32_t> seeds);
    ~VectorEnv() override;
    VectorEnv(VectorEnv&&) noexcept;
    VectorEnv& operator=(VectorEnv&&) noexcept;

    /// How many threads step the environments of such a configuration, the caller's included.
    static std::int64_t threads(const EnvConfig& config);

    /// Returns about how many bytes an environment of such a configuration takes (measured).
    static std::int64_t memory_per_env(const EnvConfig& config);

    std::int64_t size() const override;  // how many environments
    ActionSpace action_space() const override;
    ObservationSpace observation_space() const override;
    /// The discrete action set: empty where the action space is continuous.
    std::span<const Event> actions() const;

    /// Starts a new game everywhere. `frames`: size() x frame_size bytes, kFrameSize of pixels, where the
    /// first observations are written. Throws std::invalid_argument for another size.
    void reset(std::span<std::uint8_t> frames) override;

    /// One agent step of every environment, written straight into the caller's memory.
    ///   actions       size() of them
    ///   frames        size() x frame_size: the newest frame; where the episode was over,
    ///                 the first frame of the next one
    ///   final_frames  size() x frame_size: written only where the episode was over, with
    ///                 its last frame
    ///   results       size() of them
    /// An exception in any environment (a bad action, say) reaches the caller, after all
    /// environments have finished the step; nothing hangs.
    void step(std::span<const ContinuousAction> actions, std::span<std::uint8_t> frames,
              std::span<std::uint8_t> final_frames, std::span<StepResult> results);
    /// The same with what action_space() describes: indices into actions(), coordinates of
    /// EnvConfig::joystick, or numbers of its factored actions. Throws std::out_of_range for an invalid
    /// index, and std::invalid_argument for the other kind of actions.
    void step(const Actions& actions, std::span<std::uint8_t> frames, std::span<std::uint8_t> final_frames,
              std::span<StepResult> results) override;

    /// Env::record() of each as bytes: start, events, strengths, and the commands of a joystick that moves or
    /// places a paddle. Not while a step is under way.
    std::vector<EpisodeRecord> record() const override;
    /// Env::resume() of each. Throws as it does, and std::invalid_argument for another number of records.
    void resume(std::span<const EpisodeRecord> records) override;

    /// For callers that decide for themselves what becomes of an episode that is over, and where each
    /// environment writes: calls work(i) for every environment, each on its thread, and returns when all are
    /// done. Throws what the first of those that threw had thrown. `work` may call, for its `i`:
    void for_each(const std::function<void(std::int64_t index)>& work);
    /// One agent step by row `index` of `actions`, which must have passed check(). Writes the newest frame to
    /// `frame`, and resets nothing.
    StepResult step(std::int64_t index, const Actions& actions, std::span<std::uint8_t> frame);
    /// Starts a new game.
    void reset(std::int64_t index, std::span<std::uint8_t> frame);
    /// Replaces the environment by a new one with this seed, to be reset.
    void renew(std::int64_t index, std::uint32_t seed);
    /// Env::resume(). Throws as it does.
    void resume(std::int64_t index, const EpisodeRecord& record);

    /// Throws std::invalid_argument for the other kind or another number of actions than step() takes.
    void check(const Actions& actions) const;
    /// Env::record() of one as bytes; not while a step is under way.
    EpisodeRecord record(std::int64_t index) const;
    /// For videos and tests; not while a step is under way.
    const Env& env(std::int64_t index) const;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
