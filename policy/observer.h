// Turns a game's screens, or its memory, into a policy's observations, exactly as in training. RGB screens of
// Air Raid are the exception: two of its colours are one in RGB and two in ALE's gray.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "cale/frames.h"
#include "policy/policy_info.h"

namespace cale {

/// The observations of one game. The program calls start() with its first screen and see() with the screen
/// after every emulated frame; whenever due() returns true, the next action is chosen on observation().
///
///     Observer observer(policy.info(), 210);
///     observer.start(game.screen());
///     while (!game.over()) {
///         const auto decision = policy.act(observer.observation(), ...);
///         do {
///             game.press(decision.event);
///             observer.see(game.screen());
///             if (game.lost_a_life()) observer.lose_life();
///         } while (!observer.due() && !game.over());
///     }
///
/// Screens have 160 columns, and 210 rows in nearly all games. They are either gray, a byte per pixel as
/// ALE's getScreenGrayscale gives it, or RGB, three bytes per pixel. A policy that reads_memory() is given
/// the console's bytes in their place. Nothing is allocated after construction.
class Observer {
  public:
    /// Whether frames are what it makes: 84x84, or memory.
    static bool observes(const PolicyInfo& info);
    /// Throws std::invalid_argument where observes() does not hold, or for rows that no console's screen has:
    /// fewer than 84, or more than 1024. A policy that reads memory takes no part of the rows.
    explicit Observer(const PolicyInfo& info, int screen_height = 210);

    /// A game has begun. Throws std::invalid_argument for a screen of another size.
    void start(std::span<const std::uint8_t> screen);
    /// One more emulated frame; the first after a decision was due begins the next step. Throws as start()
    /// does.
    void see(std::span<const std::uint8_t> screen);
    /// Must be called when a life was lost in the newest frame. Where that ends an episode
    /// (PolicyInfo::life_loss_ends_episode), the next decision is due at once, on a stack of one frame only.
    /// As in training that is of the newest two among the screens before a decision (the last two of a whole
    /// step): screens of a step that the life cut short may have no part in it.
    void lose_life();

    /// Whether a decision is due: at the start, then after every frame_skip frames.
    bool due() const { return frames_left_ == 0; }
    /// Whether start() and see() are to be given the console's memory, PolicyInfo::frame_width bytes.
    bool reads_memory() const { return !pipeline_; }
    /// Returns [stack, 84, 84] or [stack, bytes], as of the newest decision that was due.
    std::span<const std::uint8_t> observation() const { return stack_.data(); }

  private:
    void require_size(std::span<const std::uint8_t> screen) const;
    std::span<const std::uint8_t> gray(std::span<const std::uint8_t> screen);
    void complete_step();

    std::int64_t frame_skip_;
    bool life_loss_ends_episode_;
    std::optional<FramePipeline> pipeline_;  // of screens
    FrameStack stack_;
    std::vector<std::uint8_t> gray_;   // an RGB screen in gray
    std::vector<std::uint8_t> frame_;  // 84 x 84, or the memory
    std::int64_t frames_left_ = 0;     // until the next decision
};

/// The luminance that ALE gives a colour: 0.2989 R + 0.587 G + 0.114 B, rounded.
std::uint8_t luminance(std::uint8_t red, std::uint8_t green, std::uint8_t blue);

}  // namespace cale
