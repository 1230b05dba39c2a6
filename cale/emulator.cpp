#include "cale/emulator.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <locale>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <zlib.h>

#include <ale/ale_interface.hpp>
#include <ale/common/ColourPalette.hpp>
#include <ale/common/Log.hpp>
#include <ale/emucore/MD5.hxx>
#include <ale/emucore/OSystem.hxx>
#include <ale/games/Roms.hpp>

namespace cale {
namespace {

using Switches = ale::stella::Event;

// A reset of Double Dunk takes some 20 / (1 - p) frames: with p = 1 it would never end.
constexpr float kMostStickyMenu = 0.99F;

std::vector<std::uint8_t> rom_bytes(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(stream), {}};
    if (!stream.is_open() || bytes.empty())
        throw std::runtime_error("the ROM file " + file.string() + " is empty or cannot be read");
    return bytes;
}

// ALE ends the process when it does not like a file, so the file is examined beforehand.
void check_rom(const Game& game, const std::filesystem::path& file) {
    const std::string name = "the ROM file " + file.string();
    const auto bytes = rom_bytes(file);
    const std::string md5 = ale::stella::MD5(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
    const std::unique_ptr<const ale::RomSettings> known(ale::buildRomRLWrapper(std::string(game.rom), md5));
    if (known == nullptr)
        throw std::runtime_error("this ALE does not know the game " + std::string(game.rom));
    if (known->rom() == game.rom && known->md5() == md5) return;
    const std::string content = known->md5() == md5 ? std::string("the game ") + known->rom()
                                                    : std::to_string(bytes.size()) + " bytes with MD5 " + md5;
    throw std::runtime_error(name + " is not the " + std::string(game.rom) + " that ALE supports but " +
                             content + ": replace it by the one that scripts/setup installs");
}

// ALE accepts many invalid states.
unsigned long checksum(const std::string& bytes) {
    return crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size()));
}

std::vector<Event> events(const ale::ActionVect& actions) {
    std::vector<Event> result;
    for (const ale::Action action : actions) result.push_back(static_cast<Event>(action));
    return result;
}

/// The resistances at the ends of a paddle's way: a game may have ends of its own.
std::pair<int, int> paddle_ends(ale::ALEInterface& ale) {
    const int right = ale.getInt("paddle_min"), left = ale.getInt("paddle_max");
    return {left == -1 ? PADDLE_MAX : left, right == -1 ? PADDLE_MIN : right};
}

/// As ALE finds out.
bool plays_with_paddles(const ale::ALEInterface& ale) {
    const auto& properties = ale.theOSystem->console().properties();
    return properties.get(ale::stella::Controller_Left) == "PADDLES" ||
           properties.get(ale::stella::Controller_Right) == "PADDLES";
}

std::unique_ptr<ale::ALEInterface> load(const Game& game, const std::filesystem::path& rom_file,
                                        float sticky_probability, std::uint32_t seed) {
    check_rom(game, rom_file);
    if (game.rom == "double_dunk" && sticky_probability > kMostStickyMenu) {
        std::ostringstream probability;
        probability << sticky_probability;
        throw std::invalid_argument(
            "env.sticky_probability is " + probability.str() +
            ": Double Dunk's menu, which ALE works with sticky actions in every reset, needs 0.99 or less");
    }
    // The logger is shared by all of ALE, so it is configured once.
    static const bool quiet = [] {
        ale::Logger::setMode(ale::Logger::Error);
        return true;
    }();
    static_cast<void>(quiet);
    auto ale = std::make_unique<ale::ALEInterface>();
    // ALE seeds -1 by the clock, so that seed shares its neighbour's draws. Other negative seeds are asserted
    // against, which a release build of ALE, such as scripts/setup's, leaves out.
    ale->setInt("random_seed", std::bit_cast<std::int32_t>(std::min(seed, 0xFFFFFFFEu)));
    ale->setFloat("repeat_action_probability", sticky_probability);
    ale->setInt("frame_skip", 1);
    ale->setBool("color_averaging", false);
    ale->setInt("max_num_frames_per_episode", 0);
    ale->loadROM(rom_file);
    return ale;
}

void require_one_of(const std::vector<std::int64_t>& choices, std::int64_t value, const char* what,
                    const Game& game) {
    if (std::ranges::find(choices, value) != choices.end()) return;
    std::ostringstream message;
    message << "env." << what << " is " << value << ", which " << game.name << " does not have: it has";
    for (const auto choice : choices) message << (choice == choices.front() ? " " : ", ") << choice;
    throw std::invalid_argument(message.str());
}

}  // namespace

std::string rom_md5(const std::filesystem::path& rom_file) {
    const auto bytes = rom_bytes(rom_file);
    return ale::stella::MD5(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
}

std::string rom_name(const std::filesystem::path& rom_file) {
    const std::unique_ptr<const ale::RomSettings> known(ale::buildRomRLWrapper("", rom_md5(rom_file)));
    return known == nullptr ? "" : known->rom();
}

struct Emulator::Impl {
    Impl(const Game& game, const std::filesystem::path& rom_file, float sticky, std::uint32_t seed)
        : ale(load(game, rom_file, sticky, seed)),
          minimal_actions(events(ale->getMinimalActionSet())),
          legal_actions(events(ale->getLegalActionSet())),
          has_paddles(plays_with_paddles(*ale)),
          ends(paddle_ends(*ale)) {
        const auto& palette = ale->theOSystem->colourPalette();
        for (int index = 0; index < 256; ++index) {
            const std::uint32_t colour = palette.getRGB(index);
            rgb[static_cast<std::size_t>(index)] = {static_cast<std::uint8_t>(colour >> 16),
                                                    static_cast<std::uint8_t>(colour >> 8),
                                                    static_cast<std::uint8_t>(colour)};
        }
        // ALE takes an index's gray from the entry after it. For 255 it reads past the end of its table. Only
        // Air Raid shows that index, as its missiles: the sole PAL game, whose table another one follows,
        // beginning with black.
        for (int index = 0; index < 255; ++index)
            gray[static_cast<std::size_t>(index)] = static_cast<std::uint8_t>(palette.getRGB(index + 1));
        gray[255] = 0;
    }

    /// The controllers as the console sees them.
    const Switches& switches() const { return *ale->theOSystem->event(); }

    std::unique_ptr<ale::ALEInterface> ale;
    std::vector<Event> minimal_actions;
    std::vector<Event> legal_actions;
    bool has_paddles;
    std::pair<int, int> ends;  // the paddle's resistances on the left and on the right
    int resistance = 0;        // of the paddle, before the last frame
    std::array<std::uint8_t, 256> gray{};
    std::array<std::array<std::uint8_t, 3>, 256> rgb{};
};

Emulator::Emulator(const Game& game, const std::filesystem::path& rom_file, float sticky_probability,
                   std::uint32_t seed, const GameVariant& variant)
    : impl_(std::make_unique<Impl>(game, rom_file, sticky_probability, seed)) {
    // Both count from the next reset on.
    if (variant.mode) {
        require_one_of(modes(), *variant.mode, "mode", game);
        impl_->ale->setMode(static_cast<ale::game_mode_t>(*variant.mode));
    }
    const auto known = difficulties();
    if (variant.difficulty) require_one_of(known, *variant.difficulty, "difficulty", game);
    // ALE begins with difficulty 0, in which Backgammon only sets up its board.
    const bool has_default = std::ranges::find(known, 0) != known.end();
    if (variant.difficulty || !has_default)
        impl_->ale->setDifficulty(static_cast<ale::difficulty_t>(variant.difficulty.value_or(known.front())));
}
Emulator::~Emulator() = default;
Emulator::Emulator(Emulator&&) noexcept = default;
Emulator& Emulator::operator=(Emulator&&) noexcept = default;

void Emulator::reset() {
    impl_->ale->reset_game();
}

int Emulator::act(Event event, float strength) {
    impl_->resistance = impl_->switches().get(Switches::PaddleZeroResistance);
    return impl_->ale->act(static_cast<ale::Action>(event), strength);
}

bool Emulator::has_paddle() const {
    return impl_->has_paddles;
}

int Emulator::act_paddle(double position, bool fire) {
    const auto [left, right] = impl_->ends;
    const int wanted = left + static_cast<int>(std::lround(position * (right - left)));
    const int change = wanted - impl_->switches().get(Switches::PaddleZeroResistance);
    // ALE moves a paddle by its step times the strength, cut to an integer: half more is cut off exactly.
    const float strength = (static_cast<float>(std::abs(change)) + 0.5F) / PADDLE_DELTA;
    return act(event_of(int{change < 0} - int{change > 0}, 0, fire), strength);
}

double Emulator::paddle() const {
    const auto [left, right] = impl_->ends;
    return static_cast<double>(impl_->switches().get(Switches::PaddleZeroResistance) - left) / (right - left);
}

Event Emulator::seen_event() const {
    const Switches& switches = impl_->switches();
    const auto on = [&](Switches::Type type) { return switches.get(type) != 0; };
    if (impl_->has_paddles) {  // the resistance falls to the right
        const int resistance = switches.get(Switches::PaddleZeroResistance), before = impl_->resistance;
        return event_of(int{resistance < before} - int{resistance > before}, 0, on(Switches::PaddleZeroFire));
    }
    const int x = int{on(Switches::JoystickZeroRight)} - int{on(Switches::JoystickZeroLeft)};
    const int y = int{on(Switches::JoystickZeroUp)} - int{on(Switches::JoystickZeroDown)};
    return event_of(x, y, on(Switches::JoystickZeroFire));
}

std::string Emulator::state() const {
    const std::string console = impl_->ale->cloneState(/*include_rng=*/true).serialize();
    return std::to_string(checksum(console)) + '\n' + console;
}

void Emulator::restore(const std::string& state) {
    std::istringstream text(state);
    text.imbue(std::locale::classic());
    unsigned long expected = 0;
    text >> expected;
    const bool readable = text.get() == '\n';
    try {
        if (!readable) throw std::invalid_argument("its first line");
        const auto console = state.substr(static_cast<std::size_t>(text.tellg()));
        if (checksum(console) != expected) throw std::invalid_argument("its checksum");
        impl_->ale->restoreState(ale::ALEState(console));
    } catch (...) {  // ALE throws texts as well as exceptions
        throw std::runtime_error("a stored state of the emulator is damaged, or another game's");
    }
}

bool Emulator::game_over() const {
    return impl_->ale->game_over();
}
int Emulator::lives() const {
    return impl_->ale->lives();
}
std::int64_t Emulator::frame_number() const {
    return impl_->ale->getFrameNumber();
}
std::int64_t Emulator::episode_frame_number() const {
    return impl_->ale->getEpisodeFrameNumber();
}

std::span<const std::uint8_t> Emulator::ram() const {
    const ale::ALERAM& ram = impl_->ale->getRAM();
    return {ram.array(), ram.size()};
}

int Emulator::screen_height() const {
    return static_cast<int>(impl_->ale->getScreen().height());
}
int Emulator::screen_width() const {
    return static_cast<int>(impl_->ale->getScreen().width());
}

std::span<const std::uint8_t> Emulator::screen() const {
    const ale::ALEScreen& screen = impl_->ale->getScreen();
    return {screen.getArray(), screen.arraySize()};
}

const std::array<std::uint8_t, 256>& Emulator::gray_palette() const {
    return impl_->gray;
}
const std::array<std::array<std::uint8_t, 3>, 256>& Emulator::rgb_palette() const {
    return impl_->rgb;
}
std::vector<std::int64_t> Emulator::modes() const {
    const auto modes = impl_->ale->getAvailableModes();
    return {modes.begin(), modes.end()};
}
std::vector<std::int64_t> Emulator::difficulties() const {
    const auto difficulties = impl_->ale->getAvailableDifficulties();
    return {difficulties.begin(), difficulties.end()};
}
std::span<const Event> Emulator::minimal_actions() const {
    return impl_->minimal_actions;
}
std::span<const Event> Emulator::legal_actions() const {
    return impl_->legal_actions;
}

}  // namespace cale
