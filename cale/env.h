// One Atari 2600 game under an experimental protocol: frame skip, sticky actions,
// life loss, truncation, and the 84x84 grayscale observation of the literature
// (Machado et al. 2018; Mnih et al. 2015), driven by joystick events or by CALE's
// continuous joystick (Farebrother & Castro 2024).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "cale/action.h"
#include "cale/fields.h"
#include "cale/frames.h"
#include "cale/games.h"
#include "cale/joystick.h"
#include "cale/stick_motion.h"
#include "world/spaces.h"
#include "world/step_result.h"

namespace cale {

/// The kind of actions: the joystick (r, theta, fire), or an index into the game's minimal or the full set of
/// events.
enum class ActionSet { continuous, minimal, full };
/// How far a paddle moves: as the paper has it, always all the way; or scaled by r, as ale-py does.
enum class PaddleStrength { one, radius };
/// How the paddle of a game that has one (has_paddle()) is moved. joystick: as in ALE, the stick pushes it
/// left or right, a step in each frame; absolute: it is where the action, (position, fire), says.
enum class Paddle { joystick, absolute };
/// What an agent sees: the screen as 84 x 84 grey pixels, or the console's 128 bytes of memory.
enum class Obs { pixels, ram };
std::span<const std::string_view> names_of(ActionSet);
std::span<const std::string_view> names_of(PaddleStrength);
std::span<const std::string_view> names_of(Paddle);
std::span<const std::string_view> names_of(Obs);

/// The game and the rules that it is played by. protocol_200m() and protocol_atari100k() fill it in.
struct EnvConfig {
    std::string game = "pong";  // of several environments also several: "pong,breakout", see games_of()
    std::string rom_dir;        // empty: see find_rom
    std::optional<std::int64_t> mode{};
    std::optional<std::int64_t> difficulty{};
    std::int64_t num_envs = 1;
    std::int64_t env_threads = 0;  // at most one per environment; 0: one per usable core
    Obs obs = Obs::pixels;
    bool observe_joystick = false;
    ActionSet action_space = ActionSet::continuous;
    Joystick joystick = Joystick::polar;
    double threshold = 0.5;
    EventMap event_map = EventMap::symmetric;
    PaddleStrength paddle_strength = PaddleStrength::one;
    Paddle paddle = Paddle::joystick;
    StickMotion motion{};
    double sticky_probability = 0.25;
    bool terminal_on_life_loss = false;
    std::int64_t frame_skip = 4;
    std::int64_t frame_stack = 4;
    std::int64_t max_frames_per_episode = 108'000;
    bool truncation_is_terminal = false;
    std::int64_t noop_max = 0;
};

template <class Visit>
void fields(EnvConfig& config, Visit&& visit) {
    visit("game", config.game,
          "the game: pong, Pong or ALE/Pong-v5; pong,breakout: the environments play them in turn");
    visit("rom_dir", config.rom_dir,
          "folder of the ROM files; empty: ALE_ROMS_DIR, else what scripts/setup installed");
    visit("mode", config.mode, Range{0, 255}, "the game's mode (cale games GAME); none: its default");
    visit("difficulty", config.difficulty, Range{0, 3},
          "the console's difficulty switches (cale games GAME); none: 0, or the lowest that the game has");
    visit("num_envs", config.num_envs, Range{1, 1024}, "environments that step together");
    visit("env_threads", config.env_threads, Range{0, 1024},
          "threads that step them, at most one for each; 0: as many as there are cores");
    visit("obs", config.obs,
          "pixels: the screen as 84 x 84 grey pixels; ram: the console's 128 bytes (encoder mlp or flat)");
    visit("observe_joystick", config.observe_joystick,
          "with obs ram an observation also has the joystick's command, its position, and the event that the "
          "console saw in each frame");
    visit("action_space", config.action_space,
          "continuous joystick, or the game's minimal or full set of events");
    visit("joystick", config.joystick,
          "coordinates of the continuous joystick; polar: (r, theta, fire), the paper's; cartesian: (x, y, "
          "fire); direction: (cos theta, sin theta, r, fire); factored: x and y three ways each, fire two, "
          "for agents that choose among actions; paddle: (position, fire), those of env.paddle=absolute");
    visit("threshold", config.threshold, Range{0, 1},
          "tau: how far the joystick must be pushed to count, as a part of its radius");
    visit("event_map", config.event_map,
          "symmetric: the paper's nine zones; ale_0_10: the map of ALE 0.10-0.11, without a centre");
    visit("paddle_strength", config.paddle_strength,
          "one: the paper's fixed paddle displacement; radius: scaled by r, as ale-py does");
    visit("paddle", config.paddle,
          "joystick: the stick pushes the paddle; absolute: the action is the paddle's position and fire, "
          "whatever env.joystick says, in games with a paddle (cale games)");
    fields(config.motion, visit);
    visit("sticky_probability", config.sticky_probability, Range{0, 1},
          "probability that a frame repeats the action before");
    visit("terminal_on_life_loss", config.terminal_on_life_loss,
          "a lost life ends the agent's episode (the game continues)");
    visit("frame_skip", config.frame_skip, Range{1, 64}, "emulated frames per agent step");
    visit("frame_stack", config.frame_stack, Range{1, 64},
          "newest screens, or states of the memory, that an observation holds");
    visit("max_frames_per_episode", config.max_frames_per_episode, Range{1, 1e9},
          "frames after which an episode is cut off");
    visit("truncation_is_terminal", config.truncation_is_terminal,
          "treat that cut as a real end: no bootstrapping (as Dopamine does)");
    visit("noop_max", config.noop_max, Range{0, 1000},
          "every game starts with 0 to this many no-op agent steps");
}

/// Returns the game of settings that name one. Throws std::invalid_argument for several.
const Game& only_game(const EnvConfig& config);
/// Returns the configuration of environment `number`, from 0: several games are played in turn.
EnvConfig config_of(const EnvConfig& config, std::int64_t number);

/// Returns whether a mode or a difficulty is chosen: scores do not compare with those published for the game.
bool is_variant(const EnvConfig& config);
/// Returns whether positions of the joystick at its rim stand for all 18 events: not where the diagonals are
/// within the threshold, nor where it is 0 and x or y are rounded beyond it, nor without a centre.
bool reaches_every_event(const EnvConfig& config);
/// Returns the game's name in headers and of runs' folders: "Pong", "Pong-mode1-difficulty0" of a variant,
/// "Pong+Breakout" or "26games" of several.
std::string variant_name(const EnvConfig& config);

/// The 200M-frame protocol of Machado et al.: sticky actions, whole games.
EnvConfig protocol_200m(std::string game);
/// Atari 100k: no sticky actions, a lost life ends the agent's episode.
EnvConfig protocol_atari100k(std::string game);

/// Returns the coordinates in which an agent moves the continuous joystick, or the paddle.
Joystick coordinates(const EnvConfig& config);
/// Returns the action space as far as the settings alone determine it: a game's minimal set counts as 18
/// actions. Throws std::invalid_argument for settings that do not go together.
ActionSpace action_space(const EnvConfig& config);
/// Returns the observation space: frame_stack screens {84, 84}, or as many times the bytes of memory {128},
/// with observe_joystick those of write_joystick_log() after them. Throws std::invalid_argument where
/// observe_joystick is to be seen in pixels.
ObservationSpace observation_space(const EnvConfig& config);

/// The ROM of `game` in `rom_dir`; if that is empty, in the folder named by ALE_ROMS_DIR, else in the `roms`
/// folder of scripts/setup. Throws std::runtime_error that names the file, every folder searched and the
/// remedy, and std::invalid_argument for an unknown game.
std::filesystem::path find_rom(std::string_view game, const std::string& rom_dir);
/// Returns the ROMs of the games of env.game, in their order. Throws as games_of() and find_rom() do.
std::vector<std::filesystem::path> find_roms(const EnvConfig& config);

/// What a frame of a game is played with: the joystick, or an event.
using FrameAction = std::variant<ContinuousAction, Event>;

/// A game's start and its actions since: sufficient to restore it exactly. (An emulator state is not: in ALE
/// 0.12.1 it lacks a field without which Q*bert diverges.)
struct GameRecord {
    std::string start;                       // the emulator and the generators before the game's reset
    std::vector<Event> events;               // the joystick event of each agent step
    std::vector<float> strengths;            // the paddle's strength in each agent step
    std::vector<ContinuousAction> commands;  // instead of these, where the stick moves or places a paddle
};

/// One game. Different environments may be used on different threads at the same time; one of them by one
/// thread at a time. After its construction a step allocates no memory (a game of more than 27,000 steps
/// apart); reset() does.
class Env {
  public:
    /// `seed` drives the sticky actions (as ALE's `random_seed` would), the no-op starts, and what is random
    /// about a stick that moves.
    /// Throws std::invalid_argument for an unknown game or an impossible setting, such as an absolute paddle
    /// in a game without one, and std::runtime_error for a ROM file that is missing or not the game's.
    Env(const EnvConfig& config, std::uint32_t seed);
    ~Env();
    Env(Env&&) noexcept;
    Env& operator=(Env&&) noexcept;

    /// Starts a new game. Writes its first observation, frame_size() bytes of observation_space(), to
    /// `observation`. Throws std::invalid_argument, here and in step(), for another size, and for a variant
    /// of the game (env.mode, env.difficulty) that is over as soon as it begins.
    void reset(std::span<std::uint8_t> observation);

    /// One agent step: the action for frame_skip frames, fewer if the agent's episode ends before.
    /// Writes the brighter of the last two screens to `observation`, or the memory after the last frame, and
    /// the joystick of the step, which is known at once whatever the latency of the observation.
    /// Throws std::invalid_argument, naming the value, for NaN or out-of-range coordinates, and
    /// std::logic_error before the first reset() and after `episode_over`.
    StepResult step(const ContinuousAction& action, std::span<std::uint8_t> observation);
    /// The same with an index into actions(). Throws std::out_of_range.
    StepResult step(std::int64_t action, std::span<std::uint8_t> observation);

    /// The same for a console that does not wait for its player: `next_action` is asked before each frame;
    /// where it returns none, the action before stays, at first the joystick at rest. Its games cannot be
    /// recorded: record() is empty. Takes coordinates and events, whatever the action space. Throws as step()
    /// does, and what `next_action` throws.
    StepResult step(const std::function<std::optional<FrameAction>()>& next_action,
                    std::span<std::uint8_t> observation);

    /// Returns where the stick and the button are after the newest frame; none where they do not move (see
    /// moves()).
    std::optional<StickPosition> stick() const;

    /// Returns where the paddle of env.paddle=absolute is after the newest frame, 0 to 1; none without it.
    std::optional<double> paddle() const;

    /// Returns the record of the current game; empty before the first reset().
    const GameRecord& record() const;
    /// Replays a recorded game and then continues exactly as the environment that recorded it, which must
    /// have had the same configuration. Takes as long as the game's emulation: about 15 s for 108,000 frames.
    /// Does not write the newest observation, which the caller must have saved. Throws std::runtime_error for
    /// a record that is damaged or of another game; reset() must then be called.
    void resume(const GameRecord& record);

    /// The discrete action set: empty where the action space is continuous.
    std::span<const Event> actions() const;
    int lives() const;                          // left in the game; 0 in games that have none
    std::int64_t frame_number() const;          // frames acted since the ROM was loaded
    std::span<const std::uint8_t> ram() const;  // the console's 128 bytes, as long as this object
    /// The game's screen in colour, rows x columns x RGB, for videos.
    void screen_rgb(std::vector<std::uint8_t>& pixels) const;
    int screen_height() const;  // rows: 210 in nearly all games
    int screen_width() const;   // columns: 160

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
