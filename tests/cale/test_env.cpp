#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/games.h"
#include "message_of.h"
#include "reference_frames.h"
#include "support/golden.h"
#include "support/temporary_folder.h"

namespace {

using cale::ActionSet;
using cale::ContinuousAction;
using cale::Env;
using cale::EnvConfig;
using cale::StepResult;
using testing::AllOf;
using testing::HasSubstr;

using Bytes = std::vector<std::uint8_t>;

EnvConfig discrete(const char* game) {
    EnvConfig config;
    config.game = game;
    config.action_space = ActionSet::minimal;
    return config;
}

// An environment with the memory for its observation.
struct Played {
    explicit Played(const EnvConfig& config, std::uint32_t seed = 1) : env(config, seed) { env.reset(frame); }
    StepResult step(std::int64_t action) { return env.step(action, frame); }
    StepResult random_step(std::uint64_t t) {
        return step(static_cast<std::int64_t>(golden::bits(5, t) % env.actions().size()));
    }

    Bytes frame = Bytes(cale::kFrameSize);
    Env env;
};

TEST(EnvConfig, ProtocolsDifferInStickinessAndLifeLoss) {
    const auto long_run = cale::protocol_200m("qbert");
    EXPECT_EQ(long_run.game, "qbert");
    EXPECT_EQ(long_run.sticky_probability, 0.25);
    EXPECT_FALSE(long_run.terminal_on_life_loss);
    const auto short_run = cale::protocol_atari100k("hero");
    EXPECT_EQ(short_run.game, "hero");
    EXPECT_EQ(short_run.sticky_probability, 0);
    EXPECT_TRUE(short_run.terminal_on_life_loss);
    EXPECT_EQ(cale::names_of(ActionSet::full)[static_cast<std::size_t>(ActionSet::full)], "full");
    using cale::PaddleStrength;
    EXPECT_EQ(cale::names_of(PaddleStrength::radius)[static_cast<std::size_t>(PaddleStrength::radius)],
              "radius");
}

TEST(EmulatorEnv, NoOpsAtTheStartPressNothingWhateverTheEventMap) {
    for (std::uint32_t seed = 1; seed <= 3; ++seed) {
        EnvConfig config;
        config.game = "breakout";  // a game that shows at once what is pressed
        config.noop_max = 100;
        const Played symmetric(config, seed);
        config.event_map = cale::EventMap::ale_0_10;
        const Played other(config, seed);
        EXPECT_TRUE(std::ranges::equal(symmetric.env.ram(), other.env.ram())) << seed;
    }
}

TEST(EmulatorEnv, NoOpsAtTheStartAreStepsWithoutButtonOrDirection) {
    for (const auto& stick_speed : {std::optional<double>(), std::optional(2.0)}) {
        for (std::uint32_t seed = 1; seed <= 4; ++seed) {
            auto config = discrete("breakout");
            if (stick_speed) config.action_space = ActionSet::continuous;
            config.motion.stick_speed = stick_speed;
            config.sticky_probability = 0;
            config.noop_max = 5;
            const Played played(config, seed);
            cale::Emulator emulator(cale::find_game("breakout"), cale::find_rom("breakout", ""), 0, 1);
            emulator.reset();
            // FIRE would have launched the ball, LEFT moved the paddle.
            std::set<Bytes> idle;
            for (int frame = 0; frame <= 5 * 4; ++frame) {
                if (frame % 4 == 0) idle.emplace(emulator.ram().begin(), emulator.ram().end());
                emulator.act(cale::Event::noop, 1);
            }
            EXPECT_TRUE(idle.contains({played.env.ram().begin(), played.env.ram().end()})) << seed;
        }
    }
}

TEST(EmulatorEnv, NoDiscreteActionPressesNothingWhateverTheEventMap) {
    for (const auto action_space : {ActionSet::full, ActionSet::continuous}) {
        EnvConfig config;
        config.game = "ms_pacman";
        config.action_space = action_space;
        config.event_map = cale::EventMap::ale_0_10;
        Played played(config);
        const auto result = played.env.step([] { return std::optional<cale::FrameAction>(); }, played.frame);
        const auto event = action_space == ActionSet::full ? cale::Event::noop : cale::Event::down_left;
        EXPECT_EQ(static_cast<cale::Event>(result.event), event);
    }
}

TEST(EnvConfig, ImpossibleSettingsAreNamed) {
    const auto refusal = [](auto change) {
        EnvConfig config;
        change(config);
        return message_of<std::invalid_argument>([&] { Env(config, 1); });
    };
    EXPECT_THAT(refusal([](EnvConfig& c) { c.sticky_probability = 1.5; }),
                HasSubstr("sticky_probability must be 0 to 1, not '1.5'"));
    EXPECT_THAT(refusal([](EnvConfig& c) { c.frame_skip = 0; }), HasSubstr("frame_skip must be"));
    EXPECT_THAT(refusal([](EnvConfig& c) { c.frame_stack = 0; }), HasSubstr("frame_stack must be"));
    EXPECT_THAT(refusal([](EnvConfig& c) { c.threshold = std::numeric_limits<double>::quiet_NaN(); }),
                HasSubstr("threshold must be a number, not 'nan'"));
    EXPECT_THAT(refusal([](EnvConfig& c) { c.noop_max = -1; }), HasSubstr("noop_max must be"));
    EXPECT_THAT(refusal([](EnvConfig& c) { c.game = "pongo"; }), HasSubstr("did you mean pong?"));
}

TEST(EmulatorEnv, DoubleDunkNeedsActionsThatDoNotAlwaysStick) {
    auto config = discrete("double_dunk");
    config.sticky_probability = 1;
    EXPECT_THAT(message_of<std::invalid_argument>([&] { Env(config, 1); }),
                AllOf(HasSubstr("sticky_probability is 1"), HasSubstr("0.99 or less")));
    config.sticky_probability = 0.99;
    Played slowly(config);
    EXPECT_GT(slowly.env.frame_number(), 100);
}

TEST(EmulatorEnv, EverySeedDrawsTheSameWheneverItIsUsed) {
    // 2^32-1 as ALE's random_seed would be -1: the clock.
    Played last(discrete("pong"), 0xFFFFFFFFu), neighbour(discrete("pong"), 0xFFFFFFFEu);
    for (std::uint64_t t = 0; t < 100; ++t) {
        last.random_step(t);
        neighbour.random_step(t);
        ASSERT_TRUE(std::ranges::equal(last.env.ram(), neighbour.env.ram())) << "step " << t;
    }
}

TEST(EmulatorEnv, FramesAreTheReferencesOnEveryScreenHeight) {
    for (const char* game : {"pong", "carnival", "pooyan", "journey_escape", "air_raid", "enduro"}) {
        SCOPED_TRACE(game);
        Played played(discrete(game));
        // The same game, step by step, in front of the reference's preprocessing.
        const auto& entry = cale::find_game(game);
        cale::Emulator emulator(entry, cale::find_rom(game, ""), 0.25f, 1);
        emulator.reset();
        ReferenceFrames reference(emulator.screen_height(), emulator.gray_palette());
        reference.start(emulator.screen());
        ASSERT_EQ(played.frame, reference.observe());
        for (std::uint64_t t = 0; t < 150; ++t) {
            const auto result = played.random_step(t);
            float reward = 0;
            for (int frame = 0; frame < 4; ++frame) {
                reward += static_cast<float>(emulator.act(static_cast<cale::Event>(result.event), 1));
                if (frame == 2) reference.set_first(emulator.screen());
                if (frame == 3) reference.set_second(emulator.screen());
            }
            ASSERT_EQ(played.frame, reference.observe()) << "step " << t;
            ASSERT_EQ(result.reward, reward);
            ASSERT_FALSE(result.terminal);
        }
    }
}

TEST(EmulatorEnv, StepsShowTheirFrameOrTheBrighterOfTheirLastTwo) {
    for (const int frame_skip : {1, 2, 3, 5}) {
        auto config = discrete("pong");
        config.frame_skip = frame_skip;
        Played played(config);
        cale::Emulator emulator(cale::find_game("pong"), cale::find_rom("pong", ""), 0.25f, 1);
        emulator.reset();
        for (std::uint64_t t = 0; t < 200; ++t) {
            const auto result = played.random_step(t);
            EXPECT_EQ(result.frames, frame_skip);
            ReferenceFrames reference(emulator.screen_height(), emulator.gray_palette());
            for (int frame = 1; frame < frame_skip; ++frame) {
                emulator.act(static_cast<cale::Event>(result.event), 1);
                if (frame == frame_skip - 1) reference.set_first(emulator.screen());
            }
            emulator.act(static_cast<cale::Event>(result.event), 1);
            frame_skip == 1 ? reference.set_first(emulator.screen())
                            : reference.set_second(emulator.screen());
            ASSERT_EQ(played.frame, reference.observe()) << frame_skip << " frames, step " << t;
        }
    }
}

TEST(EmulatorEnv, BadActionsAreRefusedAndChangeNothing) {
    Bytes frame(cale::kFrameSize);
    Env continuous(EnvConfig{}, 1);
    continuous.reset(frame);
    EXPECT_TRUE(continuous.actions().empty());
    const float nan = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THAT(message_of<std::invalid_argument>([&] {
                    continuous.step(ContinuousAction{nan, 0, 0}, frame);
                }),
                HasSubstr("radius is nan"));
    EXPECT_THAT(message_of<std::invalid_argument>([&] {
                    continuous.step(ContinuousAction{1, 4, 0}, frame);
                }),
                HasSubstr("theta is 4"));
    EXPECT_THROW(continuous.step(0, frame), std::out_of_range);
    EXPECT_EQ(continuous.frame_number(), 0);

    Played played(discrete("pong"));
    EXPECT_EQ(played.env.actions().size(), 6u);
    EXPECT_THAT(message_of<std::out_of_range>([&] { played.step(6); }),
                HasSubstr("no action 6 among the 6 discrete actions"));
    EXPECT_THROW(played.step(-1), std::out_of_range);
    EXPECT_THROW(played.env.step(ContinuousAction{}, frame), std::invalid_argument);
    EXPECT_EQ(played.env.frame_number(), 0);

    Bytes small(3);
    EXPECT_THROW(continuous.step(ContinuousAction{}, small), std::invalid_argument);
    EXPECT_THROW(continuous.step([] { return std::optional<cale::FrameAction>(); }, small),
                 std::invalid_argument);
    EXPECT_EQ(continuous.frame_number(), 0);
    EXPECT_THROW(played.env.step(0, small), std::invalid_argument);
    EXPECT_EQ(played.env.frame_number(), 0);
    played.step(0);
    const auto now = played.env.frame_number();
    EXPECT_THROW(played.env.reset(small), std::invalid_argument);
    EXPECT_EQ(played.env.frame_number(), now);
}

TEST(EmulatorEnv, NothingHappensBeforeAReset) {
    Bytes frame(cale::kFrameSize);
    Env env(EnvConfig{}, 1);
    EXPECT_THAT(message_of<std::logic_error>([&] { env.step(ContinuousAction{}, frame); }),
                HasSubstr("reset()"));
}

TEST(EmulatorEnv, TruncationKeepsItsBootstrapUnlessToldOtherwise) {
    for (const bool is_terminal : {false, true}) {
        auto config = discrete("pong");
        config.max_frames_per_episode = 41;  // ten steps and one frame
        config.truncation_is_terminal = is_terminal;
        Played played(config);
        for (int episode = 0; episode < 2; ++episode) {
            for (int t = 0; t < 10; ++t) {
                const auto result = played.step(0);
                EXPECT_FALSE(result.terminal || result.truncated || result.episode_over);
                EXPECT_EQ(result.frames, 4);
            }
            const auto last = played.step(0);
            EXPECT_TRUE(last.truncated);
            EXPECT_TRUE(last.episode_over);
            EXPECT_EQ(last.terminal, is_terminal);
            EXPECT_EQ(last.frames, 1);
            EXPECT_THROW(played.step(0), std::logic_error);
            played.env.reset(played.frame);
        }
        EXPECT_EQ(played.env.frame_number(), 82);
    }
}

TEST(EmulatorEnv, TheEndOfAGameIsNoTruncation) {
    auto config = discrete("breakout");
    std::int64_t length = 0;
    {
        Played played(config);
        StepResult result;
        for (std::uint64_t t = 0; !result.episode_over; ++t) result = played.random_step(t);
        EXPECT_TRUE(result.terminal);
        EXPECT_FALSE(result.truncated);
        EXPECT_EQ(result.lives, 0);
        length = played.env.frame_number();
    }
    config.max_frames_per_episode = length;  // the cap falls on the very frame that ends the game
    Played played(config);
    StepResult result;
    for (std::uint64_t t = 0; !result.episode_over; ++t) result = played.random_step(t);
    EXPECT_EQ(played.env.frame_number(), length);
    EXPECT_TRUE(result.terminal);
    EXPECT_FALSE(result.truncated);
}

TEST(EmulatorEnv, ALostLifeEndsTheAgentsEpisodeWhereItCounts) {
    auto config = discrete("breakout");
    for (const bool counts : {true, false}) {
        config.terminal_on_life_loss = counts;
        Played played(config);
        int lives = played.env.lives();
        EXPECT_EQ(lives, 5);
        int terminals = 0;
        StepResult result;
        for (std::uint64_t t = 0; !result.episode_over; ++t) {
            result = played.random_step(t);
            const bool lost = result.lives < lives;
            lives = result.lives;
            EXPECT_EQ(result.terminal, result.episode_over || (lost && counts));
            terminals += result.terminal;
        }
        EXPECT_EQ(lives, 0);
        EXPECT_EQ(terminals, counts ? 5 : 1);
    }
}

TEST(EmulatorEnv, NoopStartsAreWholeStepsOfBothExtremes) {
    auto config = discrete("pong");
    config.noop_max = 3;
    Played played(config);
    Played same(config);
    Played other(config, 2);
    std::multiset<std::int64_t> starts;
    std::vector<std::int64_t> others;
    std::vector<std::int64_t> mine;
    for (int i = 0; i < 40; ++i) {
        const auto count_of = [](Played& p) {
            const auto before = p.env.frame_number();
            p.env.reset(p.frame);
            return p.env.frame_number() - before;
        };
        mine.push_back(count_of(played));
        EXPECT_EQ(count_of(same), mine.back());
        others.push_back(count_of(other));
        starts.insert(mine.back());
    }
    EXPECT_NE(mine, others);
    for (const int frames : {0, 4, 8, 12}) EXPECT_GT(starts.count(frames), 0u) << frames;
    EXPECT_EQ(starts.count(0) + starts.count(4) + starts.count(8) + starts.count(12), starts.size());
}

TEST(EmulatorEnv, NoopStartsOutliveShortEpisodes) {
    auto config = discrete("pong");
    config.noop_max = 10;
    config.max_frames_per_episode = 4;
    Played played(config);
    for (int i = 0; i < 10; ++i) {
        played.env.reset(played.frame);
        EXPECT_TRUE(played.step(0).truncated);
    }
}

TEST(EmulatorEnv, PaddleStrengthIsTheRadiusOnlyWhereChosen) {
    // A weak push to the left moves Breakout's paddle less far, if strength counts.
    EnvConfig config;
    config.game = "breakout";
    config.sticky_probability = 0;
    config.threshold = 0.1;
    const auto ram_after = [&config](float radius) {
        Played played(config);
        for (int t = 0; t < 5; ++t) played.env.step(ContinuousAction{radius, 0, 0}, played.frame);
        const auto ram = played.env.ram();
        return Bytes(ram.begin(), ram.end());
    };
    EXPECT_EQ(ram_after(0.3f), ram_after(1));
    config.paddle_strength = cale::PaddleStrength::radius;
    EXPECT_NE(ram_after(0.3f), ram_after(1));
}

TEST(EmulatorEnv, ModesAndDifficultiesChangeTheGame) {
    const cale::Emulator pong(cale::find_game("pong"), cale::find_rom("pong", ""), 0, 1);
    EXPECT_THAT(pong.modes(), testing::ElementsAre(0, 1));
    EXPECT_THAT(pong.difficulties(), testing::ElementsAre(0, 1, 2, 3));
    const auto ram_of = [](std::optional<std::int64_t> mode, std::optional<std::int64_t> difficulty) {
        auto config = discrete("breakout");
        config.sticky_probability = 0;
        config.mode = mode;
        config.difficulty = difficulty;
        Played played(config);
        for (std::uint64_t t = 0; t < 80; ++t) played.random_step(t);
        const auto ram = played.env.ram();
        return Bytes(ram.begin(), ram.end());
    };
    EXPECT_EQ(ram_of({}, {}), ram_of(0, 0));  // Breakout's defaults
    EXPECT_NE(ram_of({}, {}), ram_of(4, {}));
    EXPECT_NE(ram_of({}, {}), ram_of({}, 1));
}

TEST(EmulatorEnv, WithoutADifficultyAGameIsPlayed) {
    // Of Backgammon ALE plays difficulty 3 alone; at 0, where ALE begins, its board is set up.
    const auto ram_of = [](std::optional<std::int64_t> difficulty) {
        auto config = discrete("backgammon");
        config.sticky_probability = 0;
        config.difficulty = difficulty;
        Played played(config);
        for (std::uint64_t t = 0; t < 80; ++t) played.random_step(t);
        const auto ram = played.env.ram();
        return Bytes(ram.begin(), ram.end());
    };
    EXPECT_EQ(ram_of({}), ram_of(3));
}

TEST(EmulatorEnv, AVariantThatIsOverAsItBeginsIsRefused) {
    auto config = discrete("demon_attack");
    config.mode = 3;
    EXPECT_EQ(
        message_of<std::invalid_argument>([&] { Played{config}; }),
        "in ALE DemonAttack-mode3 is over as soon as it begins: choose another env.mode or env.difficulty "
        "(cale games demon_attack lists them)");
}

TEST(EmulatorEnv, VariantsAreNamedAndResumed) {
    auto config = discrete("breakout");
    EXPECT_FALSE(cale::is_variant(config));
    EXPECT_EQ(cale::variant_name(config), "Breakout");
    config.mode = 4;
    EXPECT_EQ(cale::variant_name(config), "Breakout-mode4");
    config.difficulty = 1;
    EXPECT_TRUE(cale::is_variant(config));
    EXPECT_EQ(cale::variant_name(config), "Breakout-mode4-difficulty1");
    Played played(config), other(config, 2);
    for (std::uint64_t t = 0; t < 30; ++t) played.random_step(t);
    other.env.resume(played.env.record());
    for (std::uint64_t t = 30; t < 80; ++t) {
        played.random_step(t);
        other.random_step(t);
        ASSERT_TRUE(std::ranges::equal(played.env.ram(), other.env.ram())) << t;
    }
    config.mode = 3;
    EXPECT_EQ(
        message_of<std::invalid_argument>([&] { Env(config, 1); }),
        "env.mode is 3, which Breakout does not have: it has 0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44");
    config.mode.reset();
    config.difficulty = 3;
    EXPECT_EQ(message_of<std::invalid_argument>([&] { Env(config, 1); }),
              "env.difficulty is 3, which Breakout does not have: it has 0, 1");
}

TEST(EmulatorEnv, ScreensComeInColour) {
    Played played(discrete("pong"));
    for (int t = 0; t < 20; ++t) played.step(0);
    Bytes pixels;
    played.env.screen_rgb(pixels);
    ASSERT_EQ(pixels.size(), std::size_t{210} * 160 * 3);
    const auto pixel = [&pixels](int row, int column) {
        const auto at = pixels.begin() + (row * 160 + column) * 3;
        return std::vector<int>(at, at + 3);
    };
    EXPECT_THAT(pixel(100, 80), testing::ElementsAre(144, 72, 17));   // Pong's brown
    EXPECT_THAT(pixel(28, 80), testing::ElementsAre(236, 236, 236));  // its upper wall
}

// The environment variables and folders that find_rom looks at, put back afterwards.
class EmulatorRoms : public testing::Test {
  protected:
    void SetUp() override {
        real_ = cale::find_rom("pong", "").parent_path();
        std::filesystem::create_directories(folder_ / "deps" / "roms");
        set("ALE_ROMS_DIR", "");
        set("CALE_DEPS_DIR", folder_ / "deps");
    }
    void TearDown() override {
        for (const auto& [name, value] : before_) {
            if (value) {
                setenv(name, value->c_str(), 1);
            } else {
                unsetenv(name);
            }
        }
    }
    void set(const char* name, const std::filesystem::path& value) {
        const char* old = std::getenv(name);
        before_.try_emplace(name, old == nullptr ? std::nullopt : std::optional<std::string>(old));
        setenv(name, value.c_str(), 1);
    }
    std::string refusal(const std::filesystem::path& rom_dir) {
        EnvConfig config;
        config.rom_dir = rom_dir;
        return message_of<std::runtime_error>([&] { Env(config, 1); });
    }

    std::filesystem::path real_;
    const test::TemporaryFolder temporary_;
    const std::filesystem::path& folder_ = temporary_.path();

  private:
    std::map<const char*, std::optional<std::string>> before_;
};

TEST_F(EmulatorRoms, AreSearchedInOrder) {
    EXPECT_THAT(refusal("/nowhere"), AllOf(HasSubstr("pong.bin is not in /nowhere: "),
                                           HasSubstr("scripts/setup"), HasSubstr("ALE_ROMS_DIR")));
    EXPECT_THAT(refusal(""), HasSubstr("pong.bin is not in " + (folder_ / "deps/roms").string()));
    const auto install = [this](const std::filesystem::path& where) {
        std::filesystem::create_directories(where);
        std::filesystem::copy(real_ / "pong.bin", where);
        return where / "pong.bin";
    };
    const auto last = install(folder_ / "deps/roms");
    EXPECT_EQ(cale::find_rom("Pong", ""), last);
    const auto second = install(folder_ / "mine");
    set("ALE_ROMS_DIR", folder_ / "mine");
    EXPECT_EQ(cale::find_rom("Pong", ""), second);
    const auto first = install(folder_ / "given");
    EXPECT_EQ(cale::find_rom("Pong", folder_ / "given"), first);
    EXPECT_THAT(refusal(folder_ / "empty"), HasSubstr("pong.bin is not in"))
        << "a folder that is named is the one that is meant";
    set("CALE_DEPS_DIR", "");
    set("ALE_ROMS_DIR", "");
    set("XDG_CACHE_HOME", folder_ / "cache");
    EXPECT_EQ(cale::find_rom("Pong", ""), install(folder_ / "cache/cale/roms"));
    set("XDG_CACHE_HOME", "");
    set("HOME", folder_ / "home");
    EXPECT_EQ(cale::find_rom("Pong", ""), install(folder_ / "home/.cache/cale/roms"));
}

TEST_F(EmulatorRoms, ThatAreWrongAreNamed) {
    const auto file = folder_ / "pong.bin";
    std::filesystem::copy(real_ / "breakout.bin", file);
    EXPECT_THAT(refusal(folder_), AllOf(HasSubstr(file.string() + " is not the pong"),
                                        HasSubstr("the game breakout"), HasSubstr("scripts/setup")));
    std::filesystem::copy(real_ / "pong.bin", file, std::filesystem::copy_options::overwrite_existing);
    EXPECT_EQ(refusal(folder_), "");
    std::filesystem::resize_file(file, 1000);
    EXPECT_THAT(refusal(folder_), AllOf(HasSubstr(file.string()), HasSubstr("1000 bytes with MD5")));
    std::filesystem::resize_file(file, 0);
    EXPECT_THAT(refusal(folder_), AllOf(HasSubstr(file.string()), HasSubstr("is empty")));
}

// What a game looks like after some random steps.
Bytes ram_after_steps(std::string_view game) {
    Played played(discrete(std::string(game).c_str()), 3);
    for (std::uint64_t t = 0; t < 20; ++t) played.random_step(t);
    const auto ram = played.env.ram();
    return {ram.begin(), ram.end()};
}

TEST(EmulatorThreads, GamesLoadedAtTheSameTimeDoNotDisturbEachOther) {
    constexpr std::string_view kGames[] = {"pong", "robotank", "carnival"};
    std::array<std::vector<Bytes>, 4> found;
    {
        std::vector<std::jthread> threads;
        for (auto& rams : found) {
            threads.emplace_back([&rams, &kGames] {
                for (const auto game : kGames) rams.push_back(ram_after_steps(game));
            });
        }
    }
    for (std::size_t i = 0; i < std::size(kGames); ++i) {
        const Bytes alone = ram_after_steps(kGames[i]);
        for (const auto& rams : found) EXPECT_EQ(rams.at(i), alone) << kGames[i];
    }
}

}  // namespace
