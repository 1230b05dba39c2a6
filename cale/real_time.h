// A game in real time: the console runs at 60 frames a second on a thread of its own and waits for nobody.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cale/env.h"
#include "world/world.h"

namespace cale {

/// The console's clock: called on its thread before each frame; returns when the frame is due, and how many
/// whole frames late. Returns a negative number to stop the console.
using FrameClock = std::function<std::int64_t()>;
/// Returns a clock of 60 frames a second, from its first call on. What was late is not made up for.
FrameClock console_clock();

/// One game as a world. The first action starts the console. An observation comes every frame_skip frames,
/// whether anybody looks or not. announce() puts an action on the stick at once, for the frames from now on;
/// step() does so too unless that action was announced, and returns with the newest observation; where there
/// is no new one, it waits for it. The rewards and the frames of observations that nobody looked at are added
/// to those of the one that it returns. A lost life that counts, or a game's end, is never passed over; the
/// next game begins without a pause, at rest.
///
/// Nothing can be repeated: record() is empty, and after resume() the first step() cuts the game
/// off that the caller saw, and a new one begins.
class RealTimeGame final : public World {
  public:
    /// Called on the console's thread after every frame_skip frames, with the game as it is then, for
    /// pictures of it. The console is late by the time that this takes.
    using Watch = std::function<void(const Env& game)>;
    /// Throws as Env does.
    RealTimeGame(const EnvConfig& config, std::uint32_t seed, FrameClock clock = console_clock(),
                 Watch watch = {});
    ~RealTimeGame() override;
    RealTimeGame(const RealTimeGame&) = delete;
    RealTimeGame& operator=(const RealTimeGame&) = delete;

    std::int64_t size() const override { return 1; }
    ActionSpace action_space() const override;
    ObservationSpace observation_space() const override;
    /// Must be called once.
    void reset(std::span<std::uint8_t> frames) override;
    /// Throws std::logic_error before reset(), std::invalid_argument or std::out_of_range for an impossible
    /// action, what the console's thread threw, and std::runtime_error where the clock stopped the console.
    void step(const Actions& actions, std::span<std::uint8_t> frames, std::span<std::uint8_t> final_frames,
              std::span<StepResult> results) override;
    void announce(const Actions& actions) override;
    void pause(bool paused) override;
    std::vector<EpisodeRecord> record() const override;
    void resume(std::span<const EpisodeRecord> records) override;

    /// realtime/missed_frames: frames that were played while there was an observation that nobody had looked
    /// at; realtime/late_frames: whole frames by which the console was behind its clock, added up, pauses
    /// apart.
    std::map<std::string, double> metrics() const override;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
