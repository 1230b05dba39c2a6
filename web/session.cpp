#include "web/session.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <utility>

#include "cale/emulator.h"
#include "cale/games.h"
#include "cale/seeds.h"
#include "web/settings.h"

namespace cale::web {
namespace {

constexpr const char* kRoms = "/roms";  // in the module's own file system, which is memory
constexpr std::size_t kDraws = 600;

/// "MsPacman" for ALE's "ms_pacman"; ALE's own name of a game that is none of all_games().
std::string display_name(const std::string& rom) {
    for (const auto& game : all_games())
        if (game.rom == rom) return std::string(game.name);
    return rom;
}

/// "Pong or Breakout"
std::string display_names(const std::vector<const Game*>& all) {
    std::string names;
    for (const auto* const game : all) names += (names.empty() ? "" : " or ") + std::string(game->name);
    return names;
}

/// Whether the policy chooses positions of the joystick, and not events.
bool chooses_positions(const PolicyInfo& info) {
    return info.actions.empty() || info.joystick == Joystick::factored;
}

/// Where a decision puts the joystick: an event is at the rim.
ContinuousAction stick_of(const PolicyInfo& info, const Decision& decision) {
    if (chooses_positions(info)) return decision.stick;
    return event_stick(decision.event);
}

}  // namespace

const lite::Policy& Session::policy() const {
    if (!policy_) throw std::logic_error("there is no policy yet");
    return *policy_;
}

const Env& Session::env() const {
    if (!env_) throw std::logic_error("there is no game yet: load a policy and drop its game's ROM");
    return *env_;
}

const Frame& Session::frame(int number) const {
    if (number < 0 || static_cast<std::size_t>(number) >= frame_count_)
        throw std::out_of_range("there is no frame " + std::to_string(number));
    return frames_[static_cast<std::size_t>(number)];
}

std::span<const std::uint8_t> Session::observation() const {
    static_cast<void>(env());  // throws where there is no game
    return stack_->data();
}

void Session::load_policy(std::string_view contents, const std::string& name) {
    auto policy = lite::Policy::parse(contents, name);
    auto trained = trained_env(policy.info());
    // A visitor's hand moves the joystick whatever the policy chooses among: Env takes both from here on.
    games_ = games_of(trained.game);
    // Of several games the first whose ROM was dropped already.
    const auto there = std::ranges::find_if(games_, [](const Game* game) {
        return std::filesystem::exists(std::filesystem::path(kRoms) / (std::string(game->rom) + ".bin"));
    });
    has_rom_ = there != games_.end();
    trained.game = (has_rom_ ? *there : games_.front())->rom;
    trained.rom_dir = kRoms;
    trained.action_space = ActionSet::continuous;
    trained.joystick = Joystick::polar;
    trained.terminal_on_life_loss = policy.info().life_loss_ends_episode;
    trained_ = trained;
    workspace_ = policy.workspace();
    policy_ = std::move(policy);
    env_.reset();
}

void Session::insert_rom(std::string_view bytes) {
    static_cast<void>(policy());  // there is one
    const std::string plays = "the policy plays " + display_names(games_);
    if (bytes.empty()) throw std::runtime_error("this file is empty: " + plays);
    std::filesystem::create_directories(kRoms);
    const auto dropped = std::filesystem::path(kRoms) / "dropped.bin";
    std::ofstream(dropped, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    const auto found = rom_name(dropped);
    if (found.empty()) {
        throw std::runtime_error("this file (MD5 " + rom_md5(dropped) +
                                 ") is no ROM that ALE knows: " + plays);
    }
    if (std::none_of(games_.begin(), games_.end(), [&](const Game* game) { return game->rom == found; }))
        throw std::runtime_error("this is the ROM of " + display_name(found) + ", but " + plays);
    std::filesystem::rename(dropped, std::filesystem::path(kRoms) / (found + ".bin"));
    trained_.game = found;
    has_rom_ = true;
}

void Session::start(std::string_view changes, std::uint64_t seed) {
    auto config = trained_;
    change(config, changes);
    if (!chooses_positions(policy().info()) && moves(config.motion) && !reaches_every_event(config)) {
        throw std::invalid_argument(
            "this policy chooses among joystick events, and a stick with a speed or a latency reaches all of "
            "them only with a threshold above 0 and below 0.7071 and event_map=symmetric: change the "
            "threshold, or leave speed and latency at 0");
    }
    Env made(config, derive_seed(seed, "play", 0));  // a game under way is kept where this one is refused
    env_ = std::move(made);
    const auto space = observation_space(config);
    frame_.resize(static_cast<std::size_t>(space.frame_size()));
    stack_.emplace(1, static_cast<std::size_t>(space.stack), frame_.size());
    frames_.resize(static_cast<std::size_t>(config.frame_skip));
    random_.seed(seed);
    begin_game();
}

void Session::begin_game() {
    env_->reset(frame_);
    stack_->clear(0);
    stack_->push(0, frame_);
    moment_ = {};
    frame_count_ = 0;
    keep_frame();
}

void Session::keep_frame() {
    auto& frame = frames_.at(frame_count_++);
    env_->screen_rgb(screen_);
    frame.rgba.resize(screen_.size() / 3 * 4, 0xFF);
    for (std::size_t from = 0, to = 0; from < screen_.size(); from += 3, to += 4)
        std::copy_n(screen_.begin() + static_cast<std::ptrdiff_t>(from), 3,
                    frame.rgba.begin() + static_cast<std::ptrdiff_t>(to));
    frame.stick = env_->stick();
}

const Moment& Session::step(const std::optional<ContinuousAction>& hand) {
    static_cast<void>(env());  // there is one
    if (moment_.result.episode_over) begin_game();
    const auto choice = info().evaluation_samples ? Choice::sampled : Choice::greedy;
    moment_.decision = policy().act(stack_->data(), *workspace_, choice, random_);
    moment_.by_hand = hand.has_value();
    moment_.commanded = hand.value_or(stick_of(info(), moment_.decision));
    FrameAction action = moment_.commanded;
    if (!hand && !chooses_positions(info())) action = moment_.decision.event;

    frame_count_ = 0;
    bool given = false;
    moment_.result = env_->step(
        [&]() -> std::optional<FrameAction> {
            if (std::exchange(given, true)) {
                keep_frame();  // the one before
                return std::nullopt;
            }
            return action;
        },
        frame_);
    keep_frame();
    stack_->follow(0, moment_.result, frame_);
    moment_.episode_return += static_cast<double>(moment_.result.reward);
    ++moment_.steps;
    return moment_;
}

std::span<const float> Session::draws() {
    draws_.clear();
    if (!info().actions.empty()) return draws_;
    const auto numbers = output();
    const auto size = numbers.size() / 2;
    if (normals_.size() != kDraws * size) {
        std::mt19937_64 random(1);
        std::normal_distribution<float> normal;
        normals_.resize(kDraws * size);
        std::generate(normals_.begin(), normals_.end(), [&] { return normal(random); });
    }
    std::vector<float> u(size);
    for (std::size_t draw = 0; draw < kDraws; ++draw) {
        for (std::size_t i = 0; i < size; ++i)
            u[i] = numbers[i] + std::exp(numbers[size + i]) * normals_[draw * size + i];
        const auto stick = lite::squashed_decision(info(), u).stick;
        draws_.insert(draws_.end(), {stick.radius * std::cos(stick.theta),
                                     stick.radius * std::sin(stick.theta), stick.fire});
    }
    return draws_;
}

std::span<const float> Session::event_values() {
    if (info().actions.empty()) return {};
    event_values_.fill(std::numeric_limits<float>::quiet_NaN());
    const auto numbers = output();
    for (std::size_t i = 0; i < numbers.size(); ++i)
        event_values_[static_cast<std::size_t>(info().actions[i])] = numbers[i];
    return event_values_;
}

}  // namespace cale::web
