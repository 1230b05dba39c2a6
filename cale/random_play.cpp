#include "cale/random_play.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "cale/fields.h"

namespace cale {
namespace {

constexpr RandomPlay kScores[] = {
#include "joystick_random_scores.inc"  // made of data/joystick_random_scores.csv by CMake
};

// Dopamine cuts games off after 100,000 frames, the papers after 108,000: no difference to random play.
constexpr std::int64_t kShortestCap = 100'000;

/// Null where it was not measured.
const RandomPlay* find_play(std::string_view game, std::string_view protocol, Joystick joystick) {
    const auto* const found = std::ranges::find_if(kScores, [&](const RandomPlay& play) {
        return play.game == game && play.protocol == protocol && play.joystick == joystick;
    });
    return found == std::end(kScores) ? nullptr : found;
}

}  // namespace

ContinuousAction random_stick(Joystick joystick, std::mt19937& random) {
    if (joystick == Joystick::factored)
        return factored_stick(std::uniform_int_distribution<std::int64_t>(0, kEventCount - 1)(random));
    std::vector<float> action;
    for (const auto& [name, low, high] : stick_coordinates(joystick))
        action.push_back(std::uniform_real_distribution<float>(low, high)(random));
    return stick(joystick, action);
}

std::span<const RandomPlay> joystick_random_scores() {
    return kScores;
}

const RandomPlay& joystick_random(std::string_view game, std::string_view protocol, Joystick joystick) {
    const auto name = find_game(game).name;
    if (const auto* play = find_play(name, protocol, joystick)) return *play;
    throw std::invalid_argument("random play was not measured in " + std::string(name) +
                                " under a protocol '" + std::string(protocol) + "' with a joystick '" +
                                std::string(name_of(joystick)) +
                                "': the games are the sixty, the protocols 200m and atari100k, the joysticks "
                                "polar and cartesian");
}

namespace {

/// Whether games are as long as those of random play, whose scores grow with it.
bool has_usual_length(const EnvConfig& config) {
    const EnvConfig usual;
    return config.frame_skip == usual.frame_skip && !cuts_games_short(config) &&
           config.max_frames_per_episode <= usual.max_frames_per_episode;
}

}  // namespace

bool cuts_games_short(const EnvConfig& config) {
    return config.max_frames_per_episode < kShortestCap;
}

std::optional<RandomPlay> joystick_random(const EnvConfig& config) {
    if (is_variant(config) || games_of(config.game).size() > 1) return std::nullopt;
    const EnvConfig measured = protocol_200m(config.game);
    const Game& game = find_game(config.game);
    const bool same_rules = config.action_space == measured.action_space &&
                            config.threshold == measured.threshold &&
                            config.event_map == measured.event_map && !moves(config.motion) &&
                            (config.paddle_strength == measured.paddle_strength || !has_paddle(game));
    const bool sticky = config.sticky_probability == measured.sticky_probability;
    if (!same_rules || !has_usual_length(config) || (!sticky && config.sticky_probability != 0))
        return std::nullopt;
    const auto* const play = find_play(game.name, sticky ? "200m" : "atari100k", coordinates(config));
    return play == nullptr ? std::nullopt : std::optional(*play);
}

std::optional<double> random_floor(const EnvConfig& config) {
    const bool events = config.action_space != ActionSet::continuous ||
                        (config.joystick == Joystick::factored && reaches_every_event(config));
    if (games_of(config.game).size() > 1) return std::nullopt;
    if (events && !is_variant(config) && !moves(config.motion) && has_usual_length(config))
        return find_game(config.game).random_score;
    const auto play = joystick_random(config);
    return play ? std::optional(play->mean) : std::nullopt;
}

}  // namespace cale
