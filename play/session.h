// Games played on the screen, by a policy or by a person.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "cale/env.h"
#include "evaluate/evaluation.h"
#include "play/keyboard.h"
#include "report/scene.h"

namespace cale {

/// The output of pictures and the source of the player's commands. Either may be empty.
struct Stage {
    std::function<void(const Image& picture, const std::string& title)> show{};
    /// Reads the player's input since the last call.
    std::function<Command(Hands& hands)> poll{};
};

/// What is played, and by whom.
struct PlayPlan {
    EnvConfig env{};
    Decide decide{};  // empty: the player plays
    std::uint64_t seed = 1;
    std::int64_t games = kNoLimit;  // it ends after these, or when the player quits
    double speed = 1;               // times that of the console; 0: as fast as it can; none with real_time
    bool real_time = false;         // the console waits for nobody: see RealTimeGame
    std::filesystem::path video{};  // an MP4 file of all that is shown; empty: none
    std::function<void(const EvaluatedGame& game)> ended{};  // called after each game that came to its end
    std::function<void(const EvaluatedGame& so_far)> stepped{};  // called after each agent step
};

/// What a session in real time missed.
struct RealTimeCounts {
    std::int64_t frames = 0;         // played
    std::int64_t missed_frames = 0;  // of these, see RealTimeGame::metrics()
    std::int64_t late_frames = 0;    // the same
};

/// Plays game after game, a picture per agent step. While it is paused nothing is filmed; in real time there
/// is no pause and no new game before the end. Returns what was missed in real time. Throws what the
/// environment, the stage, `decide` and the film throw.
RealTimeCounts play(const PlayPlan& plan, const Stage& stage);

/// The size of the pictures of a game, and where its dial is.
struct PictureSize {
    int width = 0;
    int height = 0;
    Dial dial{};
};
PictureSize picture_size(const EnvConfig& env);

}  // namespace cale
