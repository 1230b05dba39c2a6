#include <array>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/fields.h"
#include "cale/random_play.h"
#include "cale/text.h"
#include "message_of.h"

namespace {

using testing::HasSubstr;

TEST(RandomPlay, HoldsEveryGameUnderBothProtocols) {
    EXPECT_EQ(cale::joystick_random_scores().size(), 240u);
    for (const auto& game : cale::games()) {
        for (const auto* protocol : {"200m", "atari100k"}) {
            for (const auto joystick : {cale::Joystick::polar, cale::Joystick::cartesian}) {
                const auto& play = cale::joystick_random(game.rom, protocol, joystick);
                SCOPED_TRACE(std::string(game.name) + " " + protocol);
                EXPECT_EQ(play.game, game.name);
                EXPECT_EQ(play.protocol, protocol);
                EXPECT_EQ(play.joystick, joystick);
                EXPECT_TRUE(play.games >= 100 || play.agent_steps >= 30'000);
                EXPECT_LE(play.cut_games, play.games);
                EXPECT_LE(play.low, play.mean);
                EXPECT_GE(play.high, play.mean);
                EXPECT_GE(play.rewarded_share, 0);
                EXPECT_LE(play.rewarded_share, 1);
            }
        }
    }
}

TEST(RandomPlay, TheCompiledTableIsTheShippedOne) {
    std::ifstream file(CALE_SOURCE_DIR "/data/joystick_random_scores.csv");
    std::string line;
    ASSERT_TRUE(std::getline(file, line));
    EXPECT_EQ(line, "game,protocol,joystick,games,cut_games,agent_steps,mean,low,high,rewarded_share");
    for (const auto& play : cale::joystick_random_scores()) {
        ASSERT_TRUE(std::getline(file, line));
        const auto cells = cale::split(line, ',');
        ASSERT_EQ(cells.size(), 10u) << line;
        EXPECT_EQ(cells[0], play.game);
        EXPECT_EQ(cells[1], play.protocol);
        EXPECT_EQ(cells[2], cale::name_of(play.joystick));
        EXPECT_EQ(cale::number_in<std::int64_t>(cells[3]), play.games) << line;
        EXPECT_EQ(cale::number_in<std::int64_t>(cells[4]), play.cut_games) << line;
        EXPECT_EQ(cale::number_in<std::int64_t>(cells[5]), play.agent_steps) << line;
        EXPECT_EQ(cale::number_in<double>(cells[6]), play.mean) << line;
        EXPECT_EQ(cale::number_in<double>(cells[7]), play.low) << line;
        EXPECT_EQ(cale::number_in<double>(cells[8]), play.high) << line;
        EXPECT_EQ(cale::number_in<double>(cells[9]), play.rewarded_share) << line;
    }
    EXPECT_FALSE(std::getline(file, line)) << line;
}

// The joystick at random does hardly anything in these games, and the published random agent does.
TEST(RandomPlay, IsNotThePublishedRandomScore) {
    EXPECT_LT(cale::joystick_random("RoadRunner", "atari100k").high, 11.5);
    EXPECT_LT(cale::joystick_random("kung_fu_master", "200m").high, 258.5);
    EXPECT_GT(cale::joystick_random("UpNDown", "atari100k").low, 533.4);
}

TEST(RandomPlay, BelongsToTheRulesThatItWasMeasuredUnder) {
    const auto protocol_of = [](const cale::EnvConfig& config) {
        const auto play = cale::joystick_random(config);
        return play ? std::string(play->protocol) : "none";
    };
    EXPECT_EQ(protocol_of(cale::protocol_200m("ALE/Pong-v5")), "200m");
    auto config = cale::protocol_atari100k("pong");
    EXPECT_EQ(protocol_of(config), "atari100k");
    config.terminal_on_life_loss = false;
    EXPECT_EQ(protocol_of(config), "atari100k");
    const auto changed = [&](auto change) {
        auto other = config;
        change(other);
        return protocol_of(other);
    };
    EXPECT_EQ(changed([](auto& env) { env.sticky_probability = 0.1; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.threshold = 0.4; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.event_map = cale::EventMap::ale_0_10; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.paddle_strength = cale::PaddleStrength::radius; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.joystick = cale::Joystick::direction; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.frame_skip = 2; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.max_frames_per_episode = 99'999; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.max_frames_per_episode = 100'000; }), "atari100k");
    EXPECT_EQ(changed([](auto& env) { env.action_space = cale::ActionSet::minimal; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.motion.stick_speed = 0.2; }), "none");
    EXPECT_EQ(changed([](auto& env) { env.mode = 1; }), "none");
}

TEST(RandomPlay, TheFloorIsThatOfTheRunsActions) {
    auto config = cale::protocol_200m("hero");
    EXPECT_EQ(cale::random_floor(config), cale::joystick_random("hero", "200m").mean);
    config.threshold = 0.9;
    EXPECT_EQ(cale::random_floor(config), std::nullopt);
    config.action_space = cale::ActionSet::full;
    EXPECT_EQ(cale::random_floor(config), 1027.0);
    config.max_frames_per_episode = 400;
    EXPECT_EQ(cale::random_floor(config), std::nullopt);
    config.max_frames_per_episode = 108'000;
    config.motion.stick_speed = 0.2;
    EXPECT_EQ(cale::random_floor(config), std::nullopt);
    config.motion.stick_speed = std::nullopt;
    config.difficulty = 1;
    EXPECT_EQ(cale::random_floor(config), std::nullopt);
    config.difficulty = std::nullopt;
    EXPECT_EQ(cale::random_floor(config), 1027.0);
    config.game = "air_raid";
    EXPECT_EQ(cale::random_floor(config), std::nullopt);
}

TEST(RandomPlay, CartesianCoordinatesHaveAFloorOfTheirOwn) {
    auto config = cale::protocol_atari100k("up_n_down");
    config.joystick = cale::Joystick::cartesian;
    const auto& play = cale::joystick_random("up_n_down", "atari100k", cale::Joystick::cartesian);
    EXPECT_EQ(cale::random_floor(config), play.mean);
    EXPECT_NE(play.mean, cale::joystick_random("up_n_down", "atari100k").mean);
}

TEST(RandomPlay, FactoredPositionsHaveTheFloorOfTheEventsThatTheyReach) {
    auto config = cale::protocol_200m("hero");
    config.joystick = cale::Joystick::factored;
    EXPECT_EQ(cale::random_floor(config), 1027.0);
    config.threshold = 0.9;
    EXPECT_EQ(cale::random_floor(config), std::nullopt) << "its diagonals are nearer";
    config.threshold = 0.70710677;  // a diagonal's coordinates as float: not beyond it
    EXPECT_EQ(cale::random_floor(config), std::nullopt);
    config.threshold = 0.70710671;
    EXPECT_EQ(cale::random_floor(config), 1027.0);
    config.threshold = 0;
    EXPECT_EQ(cale::random_floor(config), std::nullopt) << "cos(pi / 2) is not 0";
    config.threshold = 0.5;
    config.event_map = cale::EventMap::ale_0_10;
    EXPECT_EQ(cale::random_floor(config), std::nullopt) << "diagonals are all that there is";
}

TEST(RandomPlay, UnknownGamesAndProtocolsAreNamed) {
    const auto refusal = [](const char* game, const char* protocol) {
        return message_of<std::invalid_argument>([&] { cale::joystick_random(game, protocol); });
    };
    EXPECT_THAT(refusal("pnog", "200m"), HasSubstr("no game 'pnog'"));
    EXPECT_THAT(refusal("pong", "100k"), HasSubstr("protocol '100k' with a joystick 'polar': the games are "
                                                   "the sixty, the protocols 200m and atari100k"));
}

TEST(EmulatorRandomPlay, ThePaddlesStrengthMattersInPongAndBreakoutAlone) {
    std::vector<std::uint8_t> observation(cale::kFrameSize);
    for (const auto* game : {"pong", "breakout", "video_pinball", "tennis", "kung_fu_master"}) {
        std::vector<std::vector<std::uint8_t>> ram;
        bool measured = false;
        for (const auto strength : {cale::PaddleStrength::one, cale::PaddleStrength::radius}) {
            auto config = cale::protocol_atari100k(game);
            config.paddle_strength = strength;
            measured = cale::joystick_random(config).has_value();
            cale::Env env(config, 1);
            env.reset(observation);
            for (int step = 0; step < 40; ++step)
                env.step({.radius = 0.6F, .theta = step % 9 < 3 ? 0.0F : 3.0F, .fire = 1}, observation);
            ram.emplace_back(env.ram().begin(), env.ram().end());
        }
        EXPECT_EQ(ram[0] == ram[1], measured) << game;
    }
}

}  // namespace
