#include "cale/env.h"

#include <algorithm>
#include <array>
#include <random>
#include <sstream>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "cale/emulator.h"
#include "cale/games.h"

namespace cale {
namespace {

constexpr std::size_t kReservedSteps = 27'000;  // of the longest game of the paper's protocols

void check_ranges(EnvConfig config) {
    fields(config, [](std::string_view name, const auto& value, const auto& range, const auto&...) {
        if constexpr (std::is_same_v<std::remove_cvref_t<decltype(range)>, Range>) {
            const auto number = static_cast<double>(value);
            if (number >= range.low && number <= range.high) return;
            std::ostringstream message;
            message << name << " is " << value << ": it must lie in [" << range.low << ", " << range.high
                    << "]";
            throw std::invalid_argument(message.str());
        }
    });
}

std::vector<Event> chosen_actions(const Emulator& emulator, ActionSet space) {
    if (space == ActionSet::continuous) return {};
    const auto actions = space == ActionSet::full ? emulator.legal_actions() : emulator.minimal_actions();
    return {actions.begin(), actions.end()};
}

/// Other coordinates than (r, theta, fire) are of the continuous joystick alone.
void check_joystick(const EnvConfig& config) {
    if (config.action_space == ActionSet::continuous || config.joystick == Joystick::polar) return;
    throw std::invalid_argument(
        "env.joystick=" + std::string(names_of(config.joystick)[static_cast<std::size_t>(config.joystick)]) +
        " needs env.action_space=continuous, and that is " +
        std::string(names_of(config.action_space)[static_cast<std::size_t>(config.action_space)]) +
        ": set it to continuous, or leave env.joystick at polar");
}

// The no-op starts must not be correlated with the sticky actions of the same seed.
std::mt19937 noop_stream(std::uint32_t seed) {
    std::seed_seq sequence{seed, std::uint32_t{0x6e6f6f70}};
    return std::mt19937(sequence);
}

}  // namespace

std::span<const std::string_view> names_of(ActionSet) {
    static constexpr std::array<std::string_view, 3> kNames{"continuous", "minimal", "full"};
    return kNames;
}

std::span<const std::string_view> names_of(Obs) {
    static constexpr std::array<std::string_view, 2> kNames{"pixels", "ram"};
    return kNames;
}

std::span<const std::string_view> names_of(PaddleStrength) {
    static constexpr std::array<std::string_view, 2> kNames{"one", "radius"};
    return kNames;
}

ActionSpace action_space(const EnvConfig& config) {
    if (config.action_space == ActionSet::continuous) return joystick_space(config.joystick);
    check_joystick(config);
    return Discrete{kEventCount};
}

ObservationSpace observation_space(const EnvConfig& config) {
    if (config.obs == Obs::ram) return {.stack = config.frame_stack, .shape = {std::int64_t{kRamSize}}};
    return {.stack = config.frame_stack, .shape = {kFrameHeight, kFrameWidth}};
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

struct Env::Impl {
    Impl(const EnvConfig& env_config, std::uint32_t seed)
        : config((check_ranges(env_config), check_joystick(env_config), env_config)),
          emulator(find_game(config.game), find_rom(config.game, config.rom_dir),
                   static_cast<float>(config.sticky_probability), seed),
          frames(emulator.screen_height(), emulator.gray_palette()),
          actions(chosen_actions(emulator, config.action_space)),
          noop_generator(noop_stream(seed)) {
        // So that no step allocates.
        const auto longest = static_cast<std::size_t>(config.max_frames_per_episode / config.frame_skip + 1);
        record.events.reserve(std::min(longest, kReservedSteps));
        record.strengths.reserve(std::min(longest, kReservedSteps));
    }

    void start_game() {
        emulator.reset();
        frames.start(emulator.screen());
        lives = emulator.lives();
        episode_over = false;
    }

    // One agent step, but for the observation.
    StepResult advance(Event event, float strength) {
        if (episode_over)
            throw std::logic_error("the episode is over, or none was started: call reset() first");
        StepResult result{.event = static_cast<std::uint8_t>(event), .frames = 0};
        bool game_over = false;
        do {
            result.reward += static_cast<float>(emulator.act(event, strength));
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

    // Keeps the last two screens of a step; the only one of a step of one frame.
    void look(std::int64_t frames_left) {
        if (config.obs == Obs::ram) return;
        if (frames_left == 0 && config.frame_skip > 1) {
            frames.set_second(emulator.screen());
        } else if (frames_left <= 1) {
            frames.set_first(emulator.screen());
        }
    }

    void observe(std::span<std::uint8_t> observation) {
        if (config.obs == Obs::pixels) return frames.write(observation);
        const auto ram = emulator.ram();
        if (observation.size() != ram.size()) {
            throw std::invalid_argument("an observation of the memory has " + std::to_string(ram.size()) +
                                        " bytes, not " + std::to_string(observation.size()));
        }
        std::ranges::copy(ram, observation.begin());
    }

    void reset() {
        std::ostringstream generator;
        generator << noop_generator << '\n';
        record.start = generator.str() + emulator.state();
        record.events.clear();
        record.strengths.clear();
        start_game();
        const auto choices = static_cast<std::uint64_t>(config.noop_max) + 1;
        const std::uint64_t noops = (noop_generator() * choices) >> 32;
        for (std::uint64_t i = 0; i < noops; ++i) {
            advance(Event::noop, 1);
            if (episode_over) start_game();
        }
    }

    StepResult step(Event event, float strength) {
        const auto result = advance(event, strength);
        record.events.push_back(event);
        record.strengths.push_back(strength);
        return result;
    }

    void resume(const GameRecord& recorded) {
        const auto require = [](bool intact) {
            if (!intact) throw std::runtime_error("a recorded game is damaged, or another configuration's");
        };
        std::istringstream text(recorded.start);
        text >> noop_generator;
        require(text.get() == '\n' && recorded.events.size() == recorded.strengths.size());
        episode_over = true;
        emulator.restore(recorded.start.substr(static_cast<std::size_t>(text.tellg())));
        reset();
        record.start = recorded.start;
        for (std::size_t i = 0; i < recorded.events.size(); ++i) {
            const float strength = recorded.strengths[i];
            require(!episode_over && recorded.events[i] <= Event::down_left_fire && strength >= 0 &&
                    strength <= 1);
            step(recorded.events[i], strength);
        }
    }

    EnvConfig config;
    Emulator emulator;
    FramePipeline frames;
    std::vector<Event> actions;
    std::mt19937 noop_generator;
    GameRecord record;
    int lives = 0;
    bool episode_over = true;
};

Env::Env(const EnvConfig& config, std::uint32_t seed) : impl_(std::make_unique<Impl>(config, seed)) {}
Env::~Env() = default;
Env::Env(Env&&) noexcept = default;
Env& Env::operator=(Env&&) noexcept = default;

void Env::reset(std::span<std::uint8_t> observation) {
    impl_->reset();
    impl_->observe(observation);
}

StepResult Env::step(const ContinuousAction& action, std::span<std::uint8_t> observation) {
    const EnvConfig& config = impl_->config;
    if (config.action_space != ActionSet::continuous) {
        throw std::invalid_argument(
            "this environment was made for discrete actions: step it with the index of one");
    }
    validate(action);
    const Event event = joystick_event(action, static_cast<float>(config.threshold), config.event_map);
    const auto result =
        impl_->step(event, config.paddle_strength == PaddleStrength::radius ? action.radius : 1);
    impl_->observe(observation);
    return result;
}

StepResult Env::step(std::int64_t action, std::span<std::uint8_t> observation) {
    const auto& actions = impl_->actions;
    if (action < 0 || action >= std::ssize(actions)) {
        throw std::out_of_range("there is no action " + std::to_string(action) + " among the " +
                                std::to_string(actions.size()) + " discrete actions of this environment");
    }
    const auto result = impl_->step(actions[static_cast<std::size_t>(action)], 1);
    impl_->observe(observation);
    return result;
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
