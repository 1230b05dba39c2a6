// A policy that plays its game, or a person in its place: what the page does, without the page.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cale/env.h"
#include "cale/games.h"
#include "policy/policy_lite.h"

namespace cale::web {

/// An agent step.
struct Moment {
    bool by_hand = false;
    ContinuousAction commanded{};  // of the stick, by whoever held it
    Decision decision{};           // what the policy wants, whoever plays
    StepResult result{};
    double episode_return = 0;  // so far, or of the whole game at its end
    std::int64_t steps = 0;     // of the game, this one included
};

/// A frame of the newest agent step.
struct Frame {
    std::vector<std::uint8_t> rgba;      // screen_height() x screen_width() x 4
    std::optional<StickPosition> stick;  // none: it is in the commanded position
};

/// Loads, starts and plays. Every function throws a std::exception whose text is a sentence for the visitor.
class Session {
  public:
    /// Reads a policy file. `name` stands for it in errors. There is then no game.
    void load_policy(std::string_view contents, const std::string& name);
    /// Reads the ROM of the policy's game, or of one of its games, which is played from the next start() on.
    /// Throws std::runtime_error that says whose ROM it is instead.
    void insert_rom(std::string_view bytes);

    bool has_game() const { return env_.has_value(); }
    /// Returns whether the ROM of the policy's game, or of one of its games, was dropped.
    bool has_rom() const { return has_rom_; }
    const PolicyInfo& info() const { return policy().info(); }
    /// Returns whether the numbers of output() are values of actions.
    bool gives_action_values() const { return policy().gives_action_values(); }

    /// Returns the environment that the policy was trained in.
    const EnvConfig& trained() const { return trained_; }
    /// Starts a first game in that environment with changes as change() reads them. With the same seed,
    /// changes and actions games are the same; without changes, and by a policy that draws nothing, they are
    /// those of `cale play --seed`.
    void start(std::string_view changes, std::uint64_t seed);

    /// One agent step, by the policy or by `hand`. Begins a new game where the one before has ended.
    const Moment& step(const std::optional<ContinuousAction>& hand = std::nullopt);

    /// Returns the frames of the newest step, the newest last; before the first step the game's first screen.
    std::span<const Frame> frames() const { return {frames_.data(), frame_count_}; }
    /// Returns one of them. Throws std::out_of_range.
    const Frame& frame(int number) const;
    int screen_height() const { return env().screen_height(); }
    int screen_width() const { return env().screen_width(); }
    /// Returns what the policy sees next: [stack, 84, 84] or [stack, 128] bytes, more with
    /// env.observe_joystick.
    std::span<const std::uint8_t> observation() const;
    /// Returns the network's output for the newest decision: see lite::Policy::output_size().
    std::span<const float> output() const { return policy().newest_output(*workspace_); }
    /// Returns draws (x, y, fire) of the policy's Gaussian for the newest decision, three numbers each,
    /// always from the same normal numbers. Empty of policies that choose among actions.
    std::span<const float> draws();
    /// Returns the output for each Event; NaN for those that no action of the policy presses. Empty of
    /// Gaussians.
    std::span<const float> event_values();

  private:
    const lite::Policy& policy() const;
    const Env& env() const;
    void begin_game();
    void keep_frame();

    std::optional<lite::Policy> policy_;
    std::optional<lite::Workspace> workspace_;
    EnvConfig trained_;
    std::vector<const Game*> games_;  // the policy's
    bool has_rom_ = false;            // of one of them
    std::optional<Env> env_;
    std::optional<FrameStack> stack_;
    std::mt19937_64 random_;  // the policy's draws
    Moment moment_;
    std::vector<std::uint8_t> frame_, screen_;
    std::vector<Frame> frames_;
    std::size_t frame_count_ = 0;
    std::vector<float> normals_, draws_;
    std::array<float, kEventCount> event_values_{};
};

}  // namespace cale::web
