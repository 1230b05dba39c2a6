// One Atari 2600 with one game: a wrapper of the Arcade Learning Environment.
// emulator.cpp is the only file of this project that includes ALE.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cale/action.h"
#include "cale/games.h"

namespace cale {

/// The MD5 of a file in 32 hexadecimal digits, by which ALE tells ROMs apart. Throws std::runtime_error,
/// naming the file, where it is empty or cannot be read.
std::string rom_md5(const std::filesystem::path& rom_file);

/// ALE's name of the game whose ROM the file is, by its MD5: "ms_pacman". Empty where ALE does not support
/// it; it has some games more than games(). Throws as rom_md5() does.
std::string rom_name(const std::filesystem::path& rom_file);

/// Which of a game's variants is played, as the console's switches choose it.
struct GameVariant {
    std::optional<std::int64_t> mode;        // none: the game's own default
    std::optional<std::int64_t> difficulty;  // none: 0, or the lowest that the game has
};

/// Different emulators may be used on different threads at the same time.
class Emulator {
  public:
    /// Loads the game and, as ALE does, resets it once. `sticky_probability` is the chance that
    /// a frame repeats the action of the frame before (Machado et al. 2018). ALE draws it, with
    /// `random_seed` = `seed` and `repeat_action_probability` = `sticky_probability`; the seed 2^32-1, which
    /// ALE would replace by the time, is replaced by 2^32-2. Throws std::runtime_error for a file that is not
    /// this game's ROM, naming both, and std::invalid_argument for a variant that the game does not have, and
    /// for Double Dunk with a sticky_probability above 0.99: its menu could not be operated.
    Emulator(const Game& game, const std::filesystem::path& rom_file, float sticky_probability,
             std::uint32_t seed, const GameVariant& variant = {});
    ~Emulator();
    Emulator(Emulator&&) noexcept;
    Emulator& operator=(Emulator&&) noexcept;

    /// Starts a new game. The menus of Double Dunk and Berzerk are operated with sticky actions too, so these
    /// two games draw in a reset, and Double Dunk's takes a varying number of frames.
    void reset();
    /// One frame, 1/60 s. `strength`, 0 to 1, scales how far a paddle moves (Pong, Breakout) and
    /// is ignored by joysticks. Returns the reward. Once the game is over it changes nothing but what sticky
    /// actions draw.
    int act(Event event, float strength);

    /// Whether the game is played with a paddle, as ALE's properties of the ROM say.
    bool has_paddle() const;
    /// One frame with the paddle at `position`, 0 to 1, from the left end of the way that ALE gives it to the
    /// right one, and the button. Must be a game with a paddle, and one that does not stick. Returns the
    /// reward.
    int act_paddle(double position, bool fire);
    /// Returns where the paddle is.
    double paddle() const;

    /// Returns the event that the console saw in the last frame: that of act(), or, where it stuck, of the
    /// frame before. Of a game with paddles it is the paddle's movement, of which there is none at its end.
    Event seen_event() const;

    /// Returns the state needed to reproduce everything after reset(), as bytes: the console, the score, the
    /// generator of the sticky actions.
    std::string state() const;
    /// Restores what state() returned; reset() must be called next, which sets what ALE 0.12.1 omits from its
    /// state: whether the last frame was cut short, and the previous action, which would stick. Throws
    /// std::runtime_error for invalid bytes, after which the console must be reset.
    void restore(const std::string& state);

    bool game_over() const;  // until reset()
    int lives() const;       // 0 in games that have none
    /// Frames acted since the ROM was loaded, and since the game began. Of the frames of a reset, only those
    /// count in which menus are operated, as in a few games and for many a mode.
    std::int64_t frame_number() const;
    std::int64_t episode_frame_number() const;  // since the game began
    std::span<const std::uint8_t> ram() const;  // the console's 128 bytes

    int screen_height() const;  // rows: 210 in nearly all games
    int screen_width() const;   // columns: 160
    /// The current screen, row by row, as indices into the palette.
    std::span<const std::uint8_t> screen() const;
    /// The luminance of each index as ALE's getScreenGrayscale() has it; index 0 is black, and so is 255.
    const std::array<std::uint8_t, 256>& gray_palette() const;
    /// The colour of each index: red, green, blue.
    const std::array<std::array<std::uint8_t, 3>, 256>& rgb_palette() const;

    /// The events that make a difference in this game, and all that it accepts.
    std::span<const Event> minimal_actions() const;
    std::span<const Event> legal_actions() const;  // all eighteen; nine in Skiing
    /// The modes that the game has for one player.
    std::vector<std::int64_t> modes() const;
    /// The positions of the difficulty switches that make a difference.
    std::vector<std::int64_t> difficulties() const;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
