#include "play/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "play/window.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

EnvConfig breakout() {
    EnvConfig env = protocol_atari100k("breakout");
    env.max_frames_per_episode = 160;
    return env;
}

/// A player whose hands are told, step by step, what to do, and who leaves after `steps` of them.
struct Player {
    std::function<Command(int step, Hands&)> moves{};
    int steps = 0;
    std::vector<std::string> titles{};
    std::set<std::string> pictures{};

    Stage stage() {
        return {.show =
                    [this](const Image& picture, const std::string& title) {
                        titles.push_back(title);
                        pictures.emplace(picture.rgb.begin(), picture.rgb.end());
                    },
                .poll =
                    [this](Hands& hands) {
                        ++steps;
                        return moves(steps, hands);
                    }};
    }
};

TEST(PlayEmulator, TheHandsServeTheBall) {
    std::map<bool, std::size_t> pictures;
    for (const bool serves : {true, false}) {
        Player player;
        player.moves = [&](int step, Hands& hands) {
            press(hands, "Space", serves && step < 5);
            return Command::none;
        };
        std::vector<std::int64_t> lengths;
        PlayPlan plan{.env = breakout(), .games = 2, .speed = 0};
        plan.ended = [&](const EvaluatedGame& game) { lengths.push_back(game.length); };
        play(plan, player.stage());
        ASSERT_EQ(lengths.size(), 2u);
        EXPECT_EQ(player.titles.size(), static_cast<std::size_t>(lengths[0] + lengths[1]));
        EXPECT_THAT(player.titles.front(), testing::HasSubstr("Breakout: return 0"));
        pictures[serves] = player.pictures.size();
    }
    EXPECT_LT(pictures[false], 5u);  // nothing moves
    EXPECT_GT(pictures[true], 12u);  // the ball does
}

TEST(PlayEmulator, QuitEndsItAndAnotherGameBegins) {
    Player player;
    player.moves = [](int step, Hands&) {
        return step == 10 ? Command::new_game : step == 15 ? Command::quit : Command::none;
    };
    int ended = 0;
    PlayPlan plan{.env = breakout(), .speed = 0};
    plan.ended = [&](const EvaluatedGame&) { ++ended; };
    play(plan, player.stage());
    EXPECT_EQ(player.steps, 15);
    EXPECT_EQ(ended, 0);
}

TEST(PlayEmulator, AGameThatIsGivenUpIsNoneOfThoseToPlay) {
    Player player;
    player.moves = [](int step, Hands&) { return step == 10 ? Command::new_game : Command::none; };
    std::vector<std::int64_t> lengths;
    PlayPlan plan{.env = breakout(), .games = 1, .speed = 0};
    plan.ended = [&](const EvaluatedGame& game) { lengths.push_back(game.length); };
    play(plan, player.stage());
    ASSERT_EQ(lengths.size(), 1u);
    EXPECT_GE(player.steps, 9 + lengths.front()) << "beside the nine steps of the game before";
}

TEST(PlayEmulator, AGameThatEndsAsThePlayerLeavesCounts) {
    std::vector<std::int64_t> lengths;
    PlayPlan plan{.env = breakout(), .games = 1, .speed = 0};
    plan.ended = [&](const EvaluatedGame& game) { lengths.push_back(game.length); };
    Player player;
    player.moves = [](int, Hands&) { return Command::none; };
    play(plan, player.stage());
    ASSERT_EQ(lengths.size(), 1u);
    for (const auto command : {Command::quit, Command::new_game}) {
        player.steps = 0;
        player.moves = [&](int step, Hands&) { return step == lengths[0] ? command : Command::none; };
        play(plan, player.stage());
        EXPECT_EQ(player.steps, lengths[0]);
    }
    EXPECT_THAT(lengths, testing::ElementsAre(lengths[0], lengths[0], lengths[0]));
}

TEST(PlayEmulator, APausedGameStandsStill) {
    Player player;
    std::size_t before = 0, after = 0;
    player.moves = [&](int step, Hands& hands) {
        press(hands, "Space", step < 5);  // the ball of a game that continues moves in every step
        if (step == 6) before = player.pictures.size();
        if (step == 34) after = player.pictures.size();
        if (step == 6 || step == 34) return Command::pause;
        return step == 44 ? Command::quit : Command::none;
    };
    play({.env = breakout(), .speed = 0}, player.stage());
    EXPECT_EQ(after, before);
    EXPECT_GT(player.pictures.size(), after + 5);
    EXPECT_THAT(player.titles[20], testing::HasSubstr("paused"));
    EXPECT_THAT(player.titles.back(), testing::Not(testing::HasSubstr("paused")));
}

TEST(PlayEmulator, APlayerWhoLeavesIsHeardWithinAStep) {
    Player player;
    player.moves = [](int step, Hands&) { return step == 3 ? Command::quit : Command::none; };
    play({.env = breakout(), .speed = 0.001}, player.stage());  // a step takes a minute
    EXPECT_EQ(player.steps, 3);
    EXPECT_EQ(player.titles.size(), 1u);
}

TEST(PlayEmulator, AKnobStaysWhereItIsLeft) {
    EnvConfig env = breakout();
    env.paddle = Paddle::absolute;
    Player player;
    player.moves = [](int step, Hands& hands) {
        hands.pointer.reset();
        if (step < 4) hands.pointer = Stick{.x = -0.8};
        return step == 12 ? Command::quit : Command::none;
    };
    play({.env = env, .speed = 0}, player.stage());
    const auto placed = player.pictures;
    player = {};
    player.moves = [](int step, Hands& hands) {
        hands.pointer = Stick{.x = -0.8};
        return step == 12 ? Command::quit : Command::none;
    };
    play({.env = env, .speed = 0}, player.stage());
    EXPECT_TRUE(player.pictures == placed);
}

TEST(PlayEmulator, InRealTimeTheGamesHaveTheFramesThatThereWere) {
    PlayPlan plan{.env = breakout(), .games = 2, .real_time = true};
    plan.env.max_frames_per_episode = 40;
    std::vector<std::int64_t> frames;
    plan.ended = [&](const EvaluatedGame& game) { frames.push_back(game.frames); };
    Player player;
    player.moves = [](int, Hands&) { return Command::pause; };  // which a console knows not
    const auto counts = play(plan, player.stage());
    ASSERT_EQ(frames.size(), 2u);
    EXPECT_GE(frames[0], 40);
    EXPECT_EQ(frames[0] + frames[1], counts.frames);
    EXPECT_EQ(std::ranges::count_if(player.titles,
                                    [](const auto& title) { return title.find("paused") != title.npos; }),
              0);
}

TEST(PlayEmulator, APolicyPlaysWithoutHandsAndIsFilmed) {
    const test::TemporaryFolder folder;
    const auto film = folder / "policy.mp4";
    std::int64_t decisions = 0;
    PlayPlan plan{.env = breakout(), .games = 1, .speed = 0, .video = film};
    plan.env.action_space = ActionSet::minimal;
    plan.decide = [&](const torch::Tensor& observations, std::span<const std::int64_t> games) {
        EXPECT_EQ(observations.sizes(), (std::vector<std::int64_t>{1, 4, 84, 84}));
        EXPECT_EQ(games.size(), 1u);
        ++decisions;
        return Chosen{.actions = torch::ones({1}, torch::kInt64)};
    };
    EvaluatedGame result;
    plan.ended = [&](const EvaluatedGame& game) { result = game; };
    play(plan, {});
    EXPECT_EQ(result.length, decisions);
    EXPECT_GT(std::filesystem::file_size(film), 1000u);
}

TEST(PlayEmulator, PicturesHaveTheSizeThatIsSaidBefore) {
    const PictureSize size = picture_size(breakout());
    Player player;
    int width = 0;
    player.moves = [](int, Hands&) { return Command::quit; };
    auto stage = player.stage();
    stage.show = [&](const Image& picture, const std::string&) { width = picture.width; };
    play({.env = breakout(), .speed = 0}, stage);
    EXPECT_EQ(width, size.width);
    EXPECT_GT(size.dial.x, 3 * 160);
    EXPECT_LT(size.dial.x + size.dial.radius, size.width);
}

/// A window without a display: SDL's dummy driver.
class WindowTest : public testing::Test {
  protected:
    void SetUp() override {
        setenv("SDL_VIDEODRIVER", "dummy", 1);
        try {
            const Window window(64, 48, {});
        } catch (const std::runtime_error& error) {
            ASSERT_THAT(error.what(), testing::HasSubstr("libsdl2-dev"));
            GTEST_SKIP() << error.what();
        }
    }
    void TearDown() override { unsetenv("SDL_VIDEODRIVER"); }
};

TEST_F(WindowTest, ShowsPicturesOfItsSizeAlone) {
    Window window(64, 48, {});
    Image picture{.width = 64, .height = 48, .rgb = std::vector<std::uint8_t>(64 * 48 * 3)};
    EXPECT_NO_THROW(window.show(picture, "title"));
    picture.width = 32;
    EXPECT_THROW(window.show(picture, "title"), std::invalid_argument);
}

TEST_F(WindowTest, CtrlCIsAWishToLeave) {
    Window window(64, 48, {});
    Hands hands;
    EXPECT_EQ(window.poll(hands), Command::none);
    std::raise(SIGINT);
    EXPECT_EQ(window.poll(hands), Command::quit);
    EXPECT_EQ(window.poll(hands), Command::none);
}

TEST(WindowWithoutDisplay, SaysSo) {
    setenv("SDL_VIDEODRIVER", "no_such_driver", 1);
    EXPECT_THROW(Window(64, 48, {}), std::runtime_error);
    unsetenv("SDL_VIDEODRIVER");
}

TEST(WindowWithoutDisplay, IsNoneThatNobodySees) {
    for (const auto* name : {"DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR"}) unsetenv(name);
    for (const bool empty : {false, true}) {
        if (empty) setenv("SDL_VIDEODRIVER", "", 1);
        EXPECT_THROW(Window(64, 48, {}), std::runtime_error) << empty;
    }
    unsetenv("SDL_VIDEODRIVER");
}

}  // namespace
}  // namespace cale
