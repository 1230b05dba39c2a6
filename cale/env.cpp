#include "cale/env.h"

#include <algorithm>
#include <cmath>
#include <locale>
#include <random>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "cale/emulator.h"
#include "cale/joystick_log.h"
#include "cale/setting.h"

namespace cale {
namespace {

constexpr std::int64_t kMostNamedGames = 3;     // in the names of folders
constexpr double kMiddle = 0.5;                 // of a paddle's way
constexpr std::size_t kReservedSteps = 27'000;  // of the longest game of the paper's protocols

/// Throws std::invalid_argument for values that no text of a setting is read as.
void check_ranges(EnvConfig config) {
    for (const auto& [name, help, range, member] : setting_fields(config))
        read_setting(name, range, written_setting(member), member);
}

std::vector<Event> chosen_actions(const Emulator& emulator, ActionSet space) {
    if (space == ActionSet::continuous) return {};
    const auto actions = space == ActionSet::full ? emulator.legal_actions() : emulator.minimal_actions();
    return {actions.begin(), actions.end()};
}

/// An absolute paddle is placed by coordinates of its own, in games that have one.
void check_paddle(const EnvConfig& config) {
    if (config.paddle == Paddle::joystick) {
        if (config.joystick != Joystick::paddle) return;
        throw std::invalid_argument(
            "env.joystick=paddle: these are the coordinates of env.paddle=absolute; set that");
    }
    for (const auto* const game : games_of(config.game)) {
        if (has_paddle(*game)) continue;
        std::string with_one;
        for (const auto& other : all_games())
            if (has_paddle(other)) with_one += (with_one.empty() ? "" : ", ") + std::string(other.rom);
        throw std::invalid_argument("env.paddle=absolute: " + std::string(game->name) +
                                    " has no paddle; the games with one are " + with_one);
    }
    const auto require = [](bool fits, const std::string& setting, const char* remedy) {
        if (!fits) throw std::invalid_argument("env.paddle=absolute does not go with " + setting + remedy);
    };
    require(config.action_space == ActionSet::continuous,
            "env.action_space=" + std::string(name_of(config.action_space)),
            ": set that to continuous, and choose an agent of continuous actions (sac, ppo)");
    require(config.joystick != Joystick::factored, "env.joystick=factored",
            ": its action is a position, not one of several; leave that out, and choose an agent of "
            "continuous actions (sac, ppo)");
    require(config.paddle_strength == PaddleStrength::one, "env.paddle_strength=radius",
            ", which scales the steps of a joystick: leave that out");
}

/// Several games have one action space, and as many environments each.
void check_games(const EnvConfig& config) {
    const auto games = std::ssize(games_of(config.game));
    if (games == 1) return;
    if (config.num_envs % games != 0) {
        throw std::invalid_argument(
            "env.game=" + config.game + ": env.num_envs must be a multiple of the " + std::to_string(games) +
            " games that the environments play in turn, and it is " + std::to_string(config.num_envs) +
            "; for a run of each game there is `cale sweep`");
    }
    if (config.action_space == ActionSet::minimal) {
        throw std::invalid_argument("env.game=" + config.game +
                                    ": the minimal sets of actions of several games differ; set "
                                    "env.action_space to full or continuous");
    }
    if (config.action_space == ActionSet::full &&
        std::ranges::any_of(games_of(config.game), [](const Game* game) { return game->rom == "skiing"; })) {
        throw std::invalid_argument("env.game=" + config.game +
                                    ": Skiing has no button and so fewer actions than the other games; leave "
                                    "it out, or set env.action_space to continuous");
    }
}

/// Other coordinates than (r, theta, fire) are of the continuous joystick alone.
void check_joystick(const EnvConfig& config) {
    if (config.action_space == ActionSet::continuous || config.joystick == Joystick::polar) return;
    throw std::invalid_argument("env.joystick=" + std::string(name_of(config.joystick)) +
                                " needs env.action_space=continuous, and that is " +
                                std::string(name_of(config.action_space)) +
                                ": set it to continuous, or leave env.joystick at polar");
}

/// A joystick that moves turns numbered actions into positions, its events' at the rim.
void check_numbered_actions(const EnvConfig& config) {
    if (config.action_space == ActionSet::continuous || !moves(config.motion)) return;
    if (reaches_every_event(config)) return;
    throw std::invalid_argument(
        "env.action_space=" + std::string(name_of(config.action_space)) + " and a joystick that moves (" +
        changed_settings(config.motion) +
        ") need env.threshold above 0 and below 0.7071, where its diagonals are, and "
        "env.event_map=symmetric: change these, or set env.action_space to continuous");
}

/// Throws std::invalid_argument, in one sentence, for settings that do not go together.
void check_together(const EnvConfig& config) {
    check_games(config);
    check_paddle(config);
    check_joystick(config);
    check(config.motion);
    check_numbered_actions(config);
}

// A stream of random numbers that is not correlated with the sticky actions of the same seed.
std::mt19937 stream(std::uint32_t seed, std::uint32_t number) {
    std::seed_seq sequence{seed, number};
    return std::mt19937(sequence);
}
constexpr std::uint32_t kNoopStream = 0x6e6f6f70, kMotionStream = 0x6d6f7665;

bool is_valid(const ContinuousAction& action) {
    try {
        validate(action);
        return true;
    } catch (const std::invalid_argument&) {
        return false;
    }
}

/// The joystick of an action.
ContinuousAction stick_of(const FrameAction& action) {
    const auto* const event = std::get_if<Event>(&action);
    return event != nullptr ? event_stick(*event) : std::get<ContinuousAction>(action);
}

}  // namespace

std::span<const std::string_view> names_of(ActionSet) {
    static constexpr std::string_view kNames[] = {"continuous", "minimal", "full"};
    return kNames;
}

std::span<const std::string_view> names_of(Obs) {
    static constexpr std::string_view kNames[] = {"pixels", "ram"};
    return kNames;
}

std::span<const std::string_view> names_of(PaddleStrength) {
    static constexpr std::string_view kNames[] = {"one", "radius"};
    return kNames;
}

std::span<const std::string_view> names_of(Paddle) {
    static constexpr std::string_view kNames[] = {"joystick", "absolute"};
    return kNames;
}

Joystick coordinates(const EnvConfig& config) {
    return config.paddle == Paddle::absolute ? Joystick::paddle : config.joystick;
}

ActionSpace action_space(const EnvConfig& config) {
    check_together(config);
    if (config.action_space == ActionSet::continuous) return joystick_space(coordinates(config));
    return Discrete{kEventCount};
}

ObservationSpace observation_space(const EnvConfig& config) {
    if (config.obs == Obs::ram) {
        const auto joystick = config.observe_joystick ? joystick_log_size(config.frame_skip) : 0;
        return {.stack = config.frame_stack, .shape = {std::int64_t{kRamSize} + joystick}};
    }
    if (config.observe_joystick) {
        throw std::invalid_argument(
            "env.observe_joystick is for observations of the memory: set env.obs to ram (agent.encoder mlp "
            "or flat), or leave it out");
    }
    return {.stack = config.frame_stack, .shape = {kFrameHeight, kFrameWidth}};
}

bool is_variant(const EnvConfig& config) {
    return config.mode || config.difficulty;
}

bool reaches_every_event(const EnvConfig& config) {
    const auto threshold = static_cast<float>(config.threshold);
    for (std::int64_t action = 0; action < kEventCount; ++action) {
        if (joystick_event(factored_stick(action), threshold, config.event_map) !=
            factored_events()[static_cast<std::size_t>(action)])
            return false;
    }
    return true;
}

const Game& only_game(const EnvConfig& config) {
    const auto games = games_of(config.game);
    if (games.size() == 1) return *games.front();
    throw std::invalid_argument(
        "env.game=" + config.game +
        " names several games, where one is played: name one of them, as in env.game=" +
        std::string(games.front()->rom));
}

EnvConfig config_of(const EnvConfig& config, std::int64_t number) {
    const auto games = games_of(config.game);
    auto own = config;
    own.game = games[static_cast<std::size_t>(number % std::ssize(games))]->rom;
    return own;
}

std::string variant_name(const EnvConfig& config) {
    const auto games = std::ssize(games_of(config.game));
    std::string name = games > kMostNamedGames ? std::to_string(games) + "games" : game_names(config.game);
    if (config.mode) name += "-mode" + std::to_string(*config.mode);
    if (config.difficulty) name += "-difficulty" + std::to_string(*config.difficulty);
    return name;
}

EnvConfig protocol_200m(std::string game) {
    EnvConfig config;
    config.game = std::move(game);
    config.sticky_probability = 0.25;
    config.terminal_on_life_loss = false;
    return config;
}

EnvConfig protocol_atari100k(std::string game) {
    EnvConfig config;
    config.game = std::move(game);
    config.sticky_probability = 0;
    config.terminal_on_life_loss = true;
    return config;
}

namespace {

const EnvConfig& checked(const EnvConfig& config) {
    check_ranges(config);
    only_game(config);
    check_together(config);
    return config;
}

}  // namespace

struct Env::Impl {
    Impl(const EnvConfig& env_config, std::uint32_t seed)
        : config(checked(env_config)),
          observation_size(static_cast<std::size_t>(observation_space(config).frame_size())),
          emulator(only_game(config), find_rom(config.game, config.rom_dir),
                   places_paddle() ? 0.0F : static_cast<float>(config.sticky_probability), seed,
                   {config.mode, config.difficulty}),
          frames(emulator.screen_height(), emulator.gray_palette()),
          actions(chosen_actions(emulator, config.action_space)),
          noop_generator(stream(seed, kNoopStream)),
          motion_generator(stream(seed, kMotionStream)) {
        if (moves(config.motion)) moving_stick.emplace(config.motion, places_paddle());
        // So that no step allocates.
        const auto longest = static_cast<std::size_t>(config.max_frames_per_episode / config.frame_skip + 1);
        const auto steps = std::min(longest, kReservedSteps);
        if (records_commands()) {
            record.commands.reserve(steps);
        } else {
            record.events.reserve(steps);
            record.strengths.reserve(steps);
        }
    }

    void start_game() {
        // Until the first action nothing is pressed. With numbered actions that is NOOP, and not the stick's
        // centre, of which env.event_map ale_0_10 makes another event.
        held = actions.empty() ? FrameAction(ContinuousAction{}) : FrameAction(Event::noop);
        seen_paddle = Push{.paddle = kMiddle};
        emulator.reset();
        if (emulator.game_over()) {
            throw std::invalid_argument(
                "in ALE " + variant_name(config) +
                " is over as soon as it begins: choose another env.mode or env.difficulty (cale games " +
                config.game + " lists them)");
        }
        frames.start(emulator.screen());
        if (moving_stick) moving_stick->centre(motion_generator);
        if (sees_late()) {
            see_present();
            delay.start(draw(config.motion.observation_latency, motion_generator), seen);
        }
        lives = emulator.lives();
        episode_over = false;
    }

    /// What the emulator is given for a frame: an event, or the place of a paddle.
    struct Push {
        Event event = Event::noop;
        float strength = 1;              // of a paddle
        std::optional<double> paddle{};  // where it is placed, instead of the event
        bool fire = false;               // with it
    };

    Push push_of(const ContinuousAction& action) const {
        if (places_paddle()) return push_of(position_of(action));
        return {joystick_event(action, static_cast<float>(config.threshold), config.event_map),
                config.paddle_strength == PaddleStrength::radius ? action.radius : 1};
    }
    Push push_of(Event event) const {
        return places_paddle() ? push_of(event_stick(event)) : Push{.event = event};
    }
    Push push_of(const StickPosition& stick) const {
        const auto x = static_cast<float>(stick.x), y = static_cast<float>(stick.y);
        const auto threshold = static_cast<float>(config.threshold);
        if (places_paddle()) {
            return {.paddle = std::clamp(paddle_position(stick.x), 0.0, 1.0),
                    .fire = static_cast<float>(stick.button) > threshold};
        }
        return {joystick_event_at(x, y, static_cast<float>(stick.button), threshold, config.event_map),
                config.paddle_strength == PaddleStrength::radius ? std::min(std::hypot(x, y), 1.0F) : 1};
    }

    /// Whether the action says where the paddle is.
    bool places_paddle() const { return config.paddle == Paddle::absolute; }
    /// Whether a game is recorded as its commands: the events do not follow from the settings alone.
    bool records_commands() const { return moving_stick || places_paddle(); }

    /// One frame. Returns the reward.
    int act(const Push& push) {
        if (!push.paddle) return emulator.act(push.event, push.strength);
        // ALE's sticky actions would repeat a paddle's step, where its place is to be repeated.
        const bool sticks = config.sticky_probability > 0 &&
                            static_cast<double>(motion_generator()) / 0x1p32 < config.sticky_probability;
        if (!sticks) seen_paddle = push;
        return emulator.act_paddle(*seen_paddle.paddle, seen_paddle.fire);
    }

    /// What a step did, as an event: that of its last push, or the way that the paddle has gone since
    /// `before`.
    Event event_of_step(const Push& last, double before) const {
        if (!last.paddle) return last.event;
        const double now = emulator.paddle();
        return event_of(int{now > before} - int{now < before}, 0, last.fire);
    }

    /// One agent step, but for the observation, with what next_push() returns for each frame.
    template <class NextPush>
    StepResult advance(const NextPush& next_push) {
        if (episode_over)
            throw std::logic_error("the episode is over, or none was started: call reset() first");
        StepResult result{.frames = 0, .stick_moves = moving_stick.has_value()};
        const double paddle_before = places_paddle() ? emulator.paddle() : 0;
        bool game_over = false;
        do {
            const Push push = next_push();
            result.reward += static_cast<float>(act(push));
            result.event = static_cast<std::uint8_t>(event_of_step(push, paddle_before));
            result.frame_events[static_cast<std::size_t>(result.frames)] =
                static_cast<std::uint8_t>(emulator.seen_event());
            ++result.frames;
            look(config.frame_skip - result.frames);

            game_over = emulator.game_over();
            const int lives_before = std::exchange(lives, emulator.lives());
            result.terminal = game_over || (config.terminal_on_life_loss && lives < lives_before);
            result.truncated = !game_over && emulator.episode_frame_number() >= config.max_frames_per_episode;
        } while (result.frames < config.frame_skip && !result.terminal && !result.truncated);

        result.lives = lives;
        result.episode_over = game_over || result.truncated;
        result.terminal |= result.truncated && config.truncation_is_terminal;
        episode_over = result.episode_over;
        return result;
    }

    /// The same with the stick on its way.
    StepResult advance_moving(const ContinuousAction& command) {
        moving_stick->command(command, motion_generator);
        return advance([this] {
            moving_stick->advance();
            return push_of(moving_stick->position());
        });
    }

    /// The same with an action that may change in every frame.
    StepResult advance_live(const std::function<std::optional<FrameAction>()>& next_action) {
        record = {};
        return advance([&] {
            if (const auto action = next_action()) {
                const auto command = stick_of(*action);
                validate(command);
                held = *action;
                if (moving_stick) moving_stick->command(command, motion_generator);
            }
            if (!moving_stick)
                return std::visit([this](const auto& action) { return push_of(action); }, held);
            moving_stick->advance();
            return push_of(moving_stick->position());
        });
    }

    /// Whether the agent sees what was there some frames ago.
    bool sees_late() const { return config.motion.observation_latency.high > 0; }
    /// What there is to see now: a screen, or the memory.
    std::span<const std::uint8_t> present() const {
        return config.obs == Obs::ram ? emulator.ram() : emulator.screen();
    }
    /// What the agent sees of it.
    std::span<const std::uint8_t> visible() const { return sees_late() ? seen : present(); }

    void see_present() {
        const auto now = present();
        seen.assign(now.begin(), now.end());
    }

    // Keeps the last two screens of a step; the only one of a step of one frame.
    void look(std::int64_t frames_left) {
        if (sees_late()) {
            see_present();
            delay.pass(seen);
        }
        if (config.obs == Obs::ram) return;
        if (frames_left == 0 && config.frame_skip > 1) {
            frames.set_second(visible());
        } else if (frames_left <= 1) {
            frames.set_first(visible());
        }
    }

    /// Before anything is played that could not be shown.
    void require_room(std::span<const std::uint8_t> observation) const {
        if (observation.size() == observation_size) return;
        throw std::invalid_argument("an observation has " + std::to_string(observation_size) +
                                    " bytes, not " + std::to_string(observation.size()));
    }

    void observe(std::span<std::uint8_t> observation, const StepResult& step = {.frames = 0}) {
        if (config.obs == Obs::pixels) return frames.write(observation);
        std::ranges::copy(visible(), observation.begin());
        if (!config.observe_joystick) return;
        const auto command = stick_of(held);
        write_joystick_log(
            {.command = command,
             .position = moving_stick ? moving_stick->position() : position_of(command),
             .events = std::span(step.frame_events).first(static_cast<std::size_t>(step.frames))},
            observation.subspan(kRamSize));
    }

    /// Whether a game draws from motion_generator.
    bool draws_motion() const { return records_commands() || sees_late(); }

    void reset() {
        std::ostringstream generators;
        generators.imbue(std::locale::classic());
        generators << noop_generator << '\n';
        if (draws_motion()) generators << motion_generator << '\n';
        record.start = generators.str() + emulator.state();
        record.events.clear();
        record.strengths.clear();
        record.commands.clear();
        start_game();
        const auto choices = static_cast<std::uint64_t>(config.noop_max) + 1;
        const std::uint64_t noops = (noop_generator() * choices) >> 32;
        for (std::uint64_t i = 0; i < noops; ++i) {
            if (moving_stick) {
                advance_moving(ContinuousAction{});
            } else {
                // Nothing is pressed, whatever env.event_map makes of a stick in its centre.
                advance([this] { return places_paddle() ? push_of(ContinuousAction{}) : Push{}; });
            }
            if (episode_over) start_game();
        }
    }

    StepResult step(const ContinuousAction& action) {
        held = action;
        if (!records_commands()) return step(push_of(action));
        const auto result = moving_stick ? advance_moving(action) : advance([&] { return push_of(action); });
        record.commands.push_back(action);
        return result;
    }
    StepResult step(Event event) {
        if (moving_stick) return step(event_stick(event));
        held = event;
        return step(push_of(event));
    }
    StepResult step(const Push& push) {
        const auto result = advance([&push] { return push; });
        record.events.push_back(push.event);
        record.strengths.push_back(push.strength);
        return result;
    }

    void resume(const GameRecord& recorded) {
        const auto require = [this](bool intact) {
            if (intact) return;
            episode_over = true;  // part of a game is none: reset() must follow
            throw std::runtime_error("a recorded game is damaged, or another configuration's");
        };
        std::istringstream text(recorded.start);
        text.imbue(std::locale::classic());
        auto noops = noop_generator, motion = motion_generator;
        text >> noops;
        require(text.get() == '\n' && recorded.events.size() == recorded.strengths.size());
        require(records_commands() ? recorded.events.empty() : recorded.commands.empty());
        if (draws_motion()) {
            text >> motion;
            require(text.get() == '\n');
        }
        episode_over = true;
        emulator.restore(recorded.start.substr(static_cast<std::size_t>(text.tellg())));
        noop_generator = noops;
        motion_generator = motion;
        reset();
        record.start = recorded.start;
        for (std::size_t i = 0; i < recorded.events.size(); ++i) {
            const float strength = recorded.strengths[i];
            require(!episode_over && recorded.events[i] <= Event::down_left_fire && strength >= 0 &&
                    strength <= 1);
            step(Push{recorded.events[i], strength});
        }
        for (const auto& command : recorded.commands) {
            require(!episode_over && is_valid(command));
            step(command);
        }
    }

    EnvConfig config;
    std::size_t observation_size;
    Emulator emulator;
    FramePipeline frames;
    std::vector<Event> actions;
    std::mt19937 noop_generator;
    std::mt19937 motion_generator;  // latencies, the noise of commands, and where a placed paddle sticks
    std::optional<MovingStick> moving_stick;
    FrameAction held;                // the newest action, which a console that does not wait keeps
    Push seen_paddle;                // by the console in the last frame, where the action places the paddle
    std::vector<std::uint8_t> seen;  // where the agent sees late
    DelayLine<std::vector<std::uint8_t>> delay;
    GameRecord record;
    int lives = 0;
    bool episode_over = true;
};

Env::Env(const EnvConfig& config, std::uint32_t seed) : impl_(std::make_unique<Impl>(config, seed)) {}
Env::~Env() = default;
Env::Env(Env&&) noexcept = default;
Env& Env::operator=(Env&&) noexcept = default;

void Env::reset(std::span<std::uint8_t> observation) {
    impl_->require_room(observation);
    impl_->reset();
    impl_->observe(observation);
}

StepResult Env::step(const ContinuousAction& action, std::span<std::uint8_t> observation) {
    if (impl_->config.action_space != ActionSet::continuous) {
        throw std::invalid_argument(
            "this environment was made for discrete actions: step it with the index of one");
    }
    validate(action);
    impl_->require_room(observation);
    const auto result = impl_->step(action);
    impl_->observe(observation, result);
    return result;
}

StepResult Env::step(std::int64_t action, std::span<std::uint8_t> observation) {
    const auto& actions = impl_->actions;
    if (action < 0 || action >= std::ssize(actions)) {
        throw std::out_of_range("there is no action " + std::to_string(action) + " among the " +
                                std::to_string(actions.size()) + " discrete actions of this environment");
    }
    impl_->require_room(observation);
    const auto result = impl_->step(actions[static_cast<std::size_t>(action)]);
    impl_->observe(observation, result);
    return result;
}

StepResult Env::step(const std::function<std::optional<FrameAction>()>& next_action,
                     std::span<std::uint8_t> observation) {
    impl_->require_room(observation);
    const auto result = impl_->advance_live(next_action);
    impl_->observe(observation, result);
    return result;
}

std::optional<StickPosition> Env::stick() const {
    if (!impl_->moving_stick) return std::nullopt;
    return impl_->moving_stick->position();
}

std::optional<double> Env::paddle() const {
    if (!impl_->places_paddle()) return std::nullopt;
    return impl_->emulator.paddle();
}

const GameRecord& Env::record() const {
    return impl_->record;
}
void Env::resume(const GameRecord& record) {
    impl_->resume(GameRecord(record));  // it may be this environment's own
}

std::span<const Event> Env::actions() const {
    return impl_->actions;
}
int Env::lives() const {
    return impl_->emulator.lives();
}
std::int64_t Env::frame_number() const {
    return impl_->emulator.frame_number();
}
std::span<const std::uint8_t> Env::ram() const {
    return impl_->emulator.ram();
}

void Env::screen_rgb(std::vector<std::uint8_t>& pixels) const {
    const auto screen = impl_->emulator.screen();
    const auto& palette = impl_->emulator.rgb_palette();
    pixels.resize(screen.size() * 3);
    auto next = pixels.begin();
    for (const std::uint8_t index : screen) next = std::ranges::copy(palette[index], next).out;
}

int Env::screen_height() const {
    return impl_->emulator.screen_height();
}
int Env::screen_width() const {
    return impl_->emulator.screen_width();
}

}  // namespace cale
