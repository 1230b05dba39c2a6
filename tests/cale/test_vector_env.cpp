#include <algorithm>
#include <filesystem>
#include <limits>
#include <numeric>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cale/games.h"
#include "cale/vector_env.h"
#include "message_of.h"
#include "support/golden.h"
#include "support/temporary_folder.h"

namespace {

using cale::ContinuousAction;
using cale::EnvConfig;
using cale::kFrameSize;
using cale::StepResult;
using cale::VectorEnv;
using testing::HasSubstr;

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint32_t kFirstSeed = 100;

EnvConfig config_of(std::int64_t num_envs, std::int64_t threads) {
    EnvConfig config;
    config.num_envs = num_envs;
    config.env_threads = threads;
    config.max_frames_per_episode = 50;  // episodes end, in the middle of a step
    config.noop_max = 4;                 // and not all at the same time
    return config;
}

ContinuousAction random_action(std::size_t env, std::uint64_t t) {
    const auto uniform = [&](std::uint64_t i) { return static_cast<float>(golden::uniform(env, 3 * t + i)); };
    return {uniform(0), 6 * uniform(1) - 3, uniform(2)};
}

// A vector environment with the memory that it writes to.
struct Crowd {
    explicit Crowd(const EnvConfig& config)
        : count(static_cast<std::size_t>(config.num_envs)),
          seeds(count),
          actions(count),
          frames(count * kFrameSize),
          final_frames(count * kFrameSize),
          results(count),
          envs(config, numbered(seeds)) {
        envs.reset(frames);
    }
    static std::vector<std::uint32_t>& numbered(std::vector<std::uint32_t>& seeds) {
        std::iota(seeds.begin(), seeds.end(), kFirstSeed);
        return seeds;
    }
    void step(std::uint64_t t) {
        for (std::size_t i = 0; i < count; ++i) actions[i] = random_action(i, t);
        step();
    }
    void step() { envs.step(actions, frames, final_frames, results); }
    std::span<std::uint8_t> frame(std::size_t i) {
        return std::span(frames).subspan(i * kFrameSize, kFrameSize);
    }
    std::span<std::uint8_t> final_frame(std::size_t i) {
        return std::span(final_frames).subspan(i * kFrameSize, kFrameSize);
    }

    std::size_t count;
    std::vector<std::uint32_t> seeds;
    std::vector<ContinuousAction> actions;
    Bytes frames;
    Bytes final_frames;
    std::vector<StepResult> results;
    VectorEnv envs;
};

// What one environment brings when it is stepped alone.
struct Solo {
    Solo(const EnvConfig& config, std::uint32_t seed, std::size_t index, std::uint64_t steps) {
        cale::Env env(config, seed);
        Bytes frame(kFrameSize);
        Bytes final_frame(kFrameSize);
        env.reset(frame);
        frames.push_back(frame);
        for (std::uint64_t t = 0; t < steps; ++t) {
            results.push_back(env.step(random_action(index, t), frame));
            if (results.back().episode_over) {
                final_frame = frame;
                env.reset(frame);
                ++episodes;
            }
            frames.push_back(frame);
            final_frames.push_back(final_frame);
        }
        frame_number = env.frame_number();
    }

    std::vector<StepResult> results;
    std::vector<Bytes> frames;  // the first one is that of reset()
    std::vector<Bytes> final_frames;
    int episodes = 0;
    std::int64_t frame_number = 0;
};

TEST(EmulatorVectorEnv, IsItsEnvironmentsOneByOneOnAnyNumberOfThreads) {
    constexpr std::size_t kEnvs = 5;
    constexpr std::uint64_t kSteps = 30;
    std::vector<Solo> solos;
    for (std::uint32_t i = 0; i < kEnvs; ++i) {
        solos.emplace_back(config_of(1, 1), kFirstSeed + i, i, kSteps);
        EXPECT_GE(solos.back().episodes, 2);
    }
    for (const int threads : {1, 2, 4, 0}) {
        SCOPED_TRACE(threads);
        Crowd crowd(config_of(kEnvs, threads));
        EXPECT_EQ(crowd.envs.size(), 5);
        for (std::size_t i = 0; i < kEnvs; ++i)
            EXPECT_TRUE(std::ranges::equal(crowd.frame(i), solos[i].frames[0]));
        for (std::uint64_t t = 0; t < kSteps; ++t) {
            crowd.step(t);
            for (std::size_t i = 0; i < kEnvs; ++i) {
                SCOPED_TRACE("environment " + std::to_string(i) + ", step " + std::to_string(t));
                const auto& result = crowd.results[i];
                const auto& expected = solos[i].results[t];
                EXPECT_EQ(result.reward, expected.reward);
                EXPECT_EQ(result.terminal, expected.terminal);
                EXPECT_EQ(result.truncated, expected.truncated);
                EXPECT_EQ(result.episode_over, expected.episode_over);
                EXPECT_EQ(result.event, expected.event);
                EXPECT_EQ(result.lives, expected.lives);
                EXPECT_EQ(result.frames, expected.frames);
                EXPECT_TRUE(std::ranges::equal(crowd.frame(i), solos[i].frames[t + 1]));
                EXPECT_TRUE(std::ranges::equal(crowd.final_frame(i), solos[i].final_frames[t]));
            }
        }
        for (std::size_t i = 0; i < kEnvs; ++i) {
            EXPECT_EQ(crowd.envs.env(static_cast<std::int64_t>(i)).frame_number(), solos[i].frame_number);
        }
    }
}

TEST(EmulatorVectorEnv, StepsItsEnvironmentsByThemselvesToo) {
    constexpr std::size_t kEnvs = 3;
    constexpr std::uint64_t kSteps = 20;
    std::vector<Solo> solos;
    for (std::uint32_t i = 0; i < kEnvs; ++i) solos.emplace_back(config_of(1, 1), kFirstSeed + i, i, kSteps);
    Crowd crowd(config_of(kEnvs, 2));
    std::vector<float> coordinates(3 * kEnvs);
    const auto play = [&](std::uint64_t first_step) {
        for (std::uint64_t t = first_step; t < kSteps; ++t) {
            for (std::size_t i = 0; i < kEnvs; ++i) {
                const auto action = random_action(i, t);
                std::ranges::copy(std::vector{action.radius, action.theta, action.fire}, &coordinates[3 * i]);
            }
            const cale::Actions actions = std::span<const float>(coordinates);
            crowd.envs.check(actions);
            crowd.envs.for_each([&](std::int64_t index) {
                const auto i = static_cast<std::size_t>(index);
                crowd.results[i] = crowd.envs.step(index, actions, crowd.frame(i));
                if (crowd.results[i].episode_over) crowd.envs.reset(index, crowd.frame(i));
            });
            for (std::size_t i = 0; i < kEnvs; ++i) {
                SCOPED_TRACE("environment " + std::to_string(i) + ", step " + std::to_string(t));
                EXPECT_EQ(crowd.results[i].reward, solos[i].results[t].reward);
                EXPECT_EQ(crowd.results[i].episode_over, solos[i].results[t].episode_over);
                EXPECT_TRUE(std::ranges::equal(crowd.frame(i), solos[i].frames[t + 1]));
            }
        }
    };
    play(0);
    // Made anew, they repeat it; recorded and resumed one by one, they continue.
    crowd.envs.for_each([&](std::int64_t index) {
        const auto i = static_cast<std::size_t>(index);
        crowd.envs.renew(index, crowd.seeds[i]);
        crowd.envs.reset(index, crowd.frame(i));
        EXPECT_TRUE(std::ranges::equal(crowd.frame(i), solos[i].frames[0]));
    });
    play(0);
    for (std::int64_t i = 0; i < crowd.envs.size(); ++i) {
        const auto record = crowd.envs.record(i);
        const auto frame_number = crowd.envs.env(i).frame_number();
        crowd.envs.renew(i, 1);
        crowd.envs.resume(i, record);
        EXPECT_EQ(crowd.envs.env(i).frame_number(), frame_number);
        EXPECT_EQ(crowd.envs.record(i), record);
    }
}

TEST(EmulatorVectorEnv, AnEnvironmentThatCannotBeMadeAnewStaysAsItIs) {
    const test::TemporaryFolder roms;
    const auto rom = roms.path() / "pong.bin";
    std::filesystem::copy(cale::find_rom("pong", ""), rom);
    auto config = config_of(1, 1);
    config.game = "pong";
    config.rom_dir = roms.path().string();
    Crowd crowd(config);
    crowd.step(0);
    const auto before = crowd.envs.record(0);
    std::filesystem::remove(rom);
    EXPECT_THROW(crowd.envs.renew(0, 1), std::runtime_error);
    EXPECT_EQ(crowd.envs.record(0), before);
    crowd.step(1);
}

TEST(EmulatorVectorEnv, ChecksActions) {
    const auto refusal = [](const VectorEnv& envs, const cale::Actions& actions) {
        return message_of<std::invalid_argument>([&] { envs.check(actions); });
    };
    const Crowd crowd(config_of(2, 1));
    const std::vector<float> coordinates(5);
    const std::vector<std::int64_t> numbers(2);
    EXPECT_EQ(refusal(crowd.envs, std::span(coordinates)), "coordinates of actions: 5 given, 6 needed");
    EXPECT_THAT(refusal(crowd.envs, std::span(numbers)),
                HasSubstr("are coordinates of the joystick, not numbers"));
}

TEST(EmulatorVectorEnv, ABadActionReachesTheCallerWhenAllAreDone) {
    for (const int threads : {1, 2, 4}) {
        SCOPED_TRACE(threads);
        auto config = config_of(4, threads);
        config.noop_max = 0;
        Crowd crowd(config);
        crowd.step(0);
        crowd.actions[1].radius = std::numeric_limits<float>::quiet_NaN();
        crowd.actions[3].fire = 7;
        // The first environment's complaint is the one that arrives.
        EXPECT_THAT(message_of<std::invalid_argument>([&] { crowd.step(); }), HasSubstr("radius is nan"));
        const auto frames_of = [&crowd](int i) { return crowd.envs.env(i).frame_number(); };
        EXPECT_EQ(frames_of(0), 8);
        EXPECT_EQ(frames_of(1), 4);
        EXPECT_EQ(frames_of(2), 8);
        EXPECT_EQ(frames_of(3), 4);
        crowd.step(1);  // and life goes on
        EXPECT_EQ(frames_of(1), 8);
    }
}

TEST(EmulatorVectorEnv, WhatCannotBeMadeIsReported) {
    for (const int threads : {1, 2}) {
        auto config = config_of(3, threads);
        config.game = "ping";
        EXPECT_THAT(message_of<std::invalid_argument>([&] { Crowd crowd(config); }),
                    HasSubstr("no game 'ping'"));
    }
    const std::vector<std::uint32_t> seeds{1, 2};
    EXPECT_THAT(message_of<std::invalid_argument>([&] { VectorEnv(config_of(3, 1), seeds); }),
                HasSubstr("seeds of environments: 2 given, 3 needed"));
    EXPECT_THROW(VectorEnv(config_of(0, 1), {}), std::invalid_argument);
}

TEST(EmulatorVectorEnv, MemoryOfTheWrongSizeIsRefused) {
    Crowd crowd(config_of(2, 1));
    Bytes short_frames(2 * kFrameSize - 1);
    EXPECT_THROW(crowd.envs.reset(short_frames), std::invalid_argument);
    EXPECT_THROW(crowd.envs.step(crowd.actions, short_frames, crowd.final_frames, crowd.results),
                 std::invalid_argument);
    EXPECT_THROW(crowd.envs.step(crowd.actions, crowd.frames, short_frames, crowd.results),
                 std::invalid_argument);
    EXPECT_THROW(
        crowd.envs.step(std::span(crowd.actions).first(1), crowd.frames, crowd.final_frames, crowd.results),
        std::invalid_argument);
    EXPECT_THROW(
        crowd.envs.step(crowd.actions, crowd.frames, crowd.final_frames, std::span(crowd.results).first(1)),
        std::invalid_argument);
}

TEST(EmulatorVectorEnv, TakesIndicesOfDiscreteActions) {
    auto config = config_of(2, 2);
    config.action_space = cale::ActionSet::minimal;
    Crowd crowd(config);
    EXPECT_EQ(crowd.envs.actions().size(), 6u);
    const std::vector<std::int64_t> actions{1, 2};
    crowd.envs.step(actions, crowd.frames, crowd.final_frames, crowd.results);
    EXPECT_EQ(static_cast<cale::Event>(crowd.results[0].event), crowd.envs.actions()[1]);
    EXPECT_EQ(static_cast<cale::Event>(crowd.results[1].event), crowd.envs.actions()[2]);
    const std::vector<std::int64_t> wrong{1, 6};
    EXPECT_THROW(crowd.envs.step(wrong, crowd.frames, crowd.final_frames, crowd.results), std::out_of_range);
}

TEST(EmulatorVectorEnv, ComesAndGoesWithoutHanging) {
    for (int i = 0; i < 5; ++i) {
        const std::vector<std::uint32_t> seeds{1, 2, 3};
        VectorEnv unused(config_of(3, 3), seeds);
    }
    Crowd crowd(config_of(2, 2));
    VectorEnv moved = std::move(crowd.envs);
    moved.step(crowd.actions, crowd.frames, crowd.final_frames, crowd.results);
    crowd.envs = std::move(moved);
    crowd.step(0);
}

}  // namespace

namespace {

// The rewards do not depend on what is observed; the bytes are those of the console.
TEST(VectorEnvEmulator, ObservesTheMemory) {
    auto config = config_of(2, 1);
    const std::vector<std::uint32_t> seeds{1, 2};
    VectorEnv pixels(config, seeds);
    config.obs = cale::Obs::ram;
    VectorEnv ram(config, seeds);
    EXPECT_EQ(ram.observation_space(), (cale::ObservationSpace{.stack = 4, .shape = {128}}));
    EXPECT_EQ(ram.action_space(), cale::joystick_space(cale::Joystick::polar));
    Bytes frames(2 * kFrameSize), final_frames(frames.size()), bytes(2 * 128), final_bytes(bytes.size());
    std::vector<StepResult> with_pixels(2), with_ram(2);
    pixels.reset(frames);
    ram.reset(bytes);
    int ended = 0;
    for (std::uint64_t t = 0; t < 60; ++t) {
        std::vector<ContinuousAction> actions{random_action(0, t), random_action(1, t)};
        pixels.step(actions, frames, final_frames, with_pixels);
        ram.step(actions, bytes, final_bytes, with_ram);
        for (std::size_t i = 0; i < 2; ++i) {
            EXPECT_EQ(with_ram[i].reward, with_pixels[i].reward);
            EXPECT_EQ(with_ram[i].episode_over, with_pixels[i].episode_over);
            ended += with_ram[i].episode_over;
            EXPECT_TRUE(std::ranges::equal(std::span(bytes).subspan(i * 128, 128),
                                           pixels.env(static_cast<std::int64_t>(i)).ram()));
        }
    }
    EXPECT_GT(ended, 0);
    Bytes too_large(2 * kFrameSize);
    EXPECT_THROW(ram.reset(too_large), std::invalid_argument);
}

// Every parametrisation, over several environments, against the joystick that its actions stand for.
TEST(VectorEnvEmulator, StepsByTheCoordinatesOfItsJoystick) {
    const std::vector<std::uint32_t> seeds{1, 2, 3};
    const auto uniform = [](std::uint64_t t, std::uint64_t i, float low, float high) {
        return low + (high - low) * static_cast<float>(golden::uniform(t, i));
    };
    for (const auto joystick : {cale::Joystick::polar, cale::Joystick::cartesian, cale::Joystick::direction,
                                cale::Joystick::factored}) {
        auto config = config_of(3, 2);
        VectorEnv expected(config, seeds);
        config.joystick = joystick;
        VectorEnv envs(config, seeds);
        EXPECT_EQ(envs.action_space(), cale::joystick_space(joystick));
        const auto coordinates = cale::stick_coordinates(joystick);
        Bytes frames(3 * kFrameSize), same(frames.size()), final_frames(frames.size());
        std::vector<StepResult> results(3), same_results(3);
        envs.reset(frames);
        expected.reset(same);
        for (std::uint64_t t = 0; t < 20; ++t) {
            std::vector<float> actions;
            std::vector<std::int64_t> numbers;
            std::vector<ContinuousAction> sticks;
            for (std::uint64_t env = 0; env < 3; ++env) {
                for (std::size_t axis = 0; axis < coordinates.size(); ++axis)
                    actions.push_back(
                        uniform(t, 4 * env + axis, coordinates[axis].low, coordinates[axis].high));
                numbers.push_back(static_cast<std::int64_t>((5 * t + 7 * env) % 18));
                sticks.push_back(coordinates.empty()
                                     ? cale::factored_stick(numbers.back())
                                     : cale::stick(joystick, std::span(actions).last(coordinates.size())));
            }
            const std::span<const float> vectors(actions);
            const std::span<const std::int64_t> choices(numbers);
            const auto taken = coordinates.empty() ? cale::Actions(choices) : cale::Actions(vectors);
            const auto refused = coordinates.empty() ? cale::Actions(vectors) : cale::Actions(choices);
            EXPECT_THROW(envs.step(refused, frames, final_frames, results), std::invalid_argument);
            envs.step(taken, frames, final_frames, results);
            expected.step(sticks, same, final_frames, same_results);
            EXPECT_EQ(frames, same);
            for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(results[i].event, same_results[i].event);
        }
    }
}

TEST(EmulatorVectorEnv, GamesWithAStickThatMovesAreResumed) {
    auto config = config_of(2, 1);
    config.action_space = cale::ActionSet::continuous;
    config.motion = {.stick_speed = 0.2, .stick_damping = 0.5, .action_latency = {0, 6}};
    const std::array<std::uint32_t, 2> seeds{1, 2}, others{3, 4};
    cale::VectorEnv envs(config, seeds), resumed(config, others);
    const auto size = static_cast<std::size_t>(envs.observation_space().frame_size()) * 2;
    std::vector<std::uint8_t> frames(size), same(size), final_frames(size);
    std::vector<cale::StepResult> results(2);
    const auto uniform = [](std::uint64_t t, std::uint64_t i, float low, float high) {
        return low + (high - low) * static_cast<float>(golden::uniform(t, i));
    };
    const auto step = [&](cale::VectorEnv& world, std::uint64_t t, std::vector<std::uint8_t>& seen) {
        std::vector<ContinuousAction> sticks;
        for (std::uint64_t env = 0; env < 2; ++env)
            sticks.push_back({uniform(t, env, 0, 1), uniform(t, 2 + env, -3, 3), uniform(t, 4 + env, 0, 1)});
        world.step(std::span<const ContinuousAction>(sticks), seen, final_frames, results);
    };
    envs.reset(frames);
    for (std::uint64_t t = 0; t < 30; ++t) step(envs, t, frames);
    const auto records = envs.record();
    EXPECT_TRUE(records[0].contains("commands"));
    resumed.resume(records);
    for (std::uint64_t t = 30; t < 90; ++t) {
        step(envs, t, frames);
        step(resumed, t, same);
        ASSERT_EQ(frames, same) << t;
    }
    auto damaged = records;
    damaged[1].erase("commands");
    EXPECT_THAT(message_of<std::runtime_error>([&] { resumed.resume(damaged); }),
                HasSubstr("a recorded game lacks its 'commands'"));
}

TEST(EmulatorVectorEnv, PlaysSeveralGamesInTurn) {
    auto config = config_of(4, 2);
    config.game = "breakout,ALE/UpNDown-v5";
    Crowd crowd(config);
    for (std::size_t i = 0; i < 4; ++i) {
        SCOPED_TRACE(i);
        auto own = config;
        own.game = i % 2 == 0 ? "breakout" : "up_n_down";
        cale::Env alone(own, kFirstSeed + static_cast<std::uint32_t>(i));
        Bytes frame(kFrameSize);
        alone.reset(frame);
        EXPECT_TRUE(std::ranges::equal(crowd.frame(i), frame));
    }
    crowd.step(0);
    VectorEnv others(config, crowd.seeds);
    others.resume(crowd.envs.record());
    EXPECT_EQ(others.env(3).frame_number(), crowd.envs.env(3).frame_number());
}

EnvConfig playing(const char* games, std::int64_t num_envs = 1,
                  cale::ActionSet space = cale::ActionSet::continuous) {
    EnvConfig config;
    config.game = games;
    config.num_envs = num_envs;
    config.action_space = space;
    return config;
}

TEST(EnvSettings, SeveralGamesNeedOneActionSpaceAndAsManyEnvironmentsEach) {
    const auto refusal = [](const char* games, std::int64_t num_envs, auto space) {
        return message_of<std::invalid_argument>(
            [&] { cale::action_space(playing(games, num_envs, space)); });
    };
    using cale::ActionSet;
    EXPECT_EQ(cale::box_size(cale::action_space(playing("pong,hero", 2))), 3);
    EXPECT_THAT(refusal("pong,hero", 3, ActionSet::continuous),
                HasSubstr("env.num_envs must be a multiple of the 2 games that the environments play in "
                          "turn, and it is 3; for a run of each game there is `cale sweep`"));
    EXPECT_THAT(
        refusal("pong,hero", 2, ActionSet::minimal),
        HasSubstr("the minimal sets of actions of several games differ; set env.action_space to full"));
    for (const auto* games : {"pong,skiing", "skiing,pong"})
        EXPECT_THAT(refusal(games, 2, ActionSet::full),
                    HasSubstr("Skiing has no button and so fewer actions than the other games"));
    EXPECT_EQ(cale::box_size(cale::action_space(playing("pong,skiing", 2))), 3);
    EXPECT_THAT(refusal("pong,Pong", 2, ActionSet::full), HasSubstr("pong is named twice among 'pong,Pong'"));
    EXPECT_THAT(refusal("pong,", 2, ActionSet::full), HasSubstr("there is no game ''"));
    EXPECT_THAT(message_of<std::invalid_argument>([] { cale::Env(playing("pong,hero"), 1); }),
                HasSubstr("names several games, where one is played: name one of them"));
    EXPECT_EQ(cale::variant_name(playing("pong,hero")), "Pong+Hero");
    EXPECT_EQ(cale::variant_name(playing("pong,hero,krull,boxing")), "4games");
}

TEST(EnvSettings, AJoystickNeedsTheContinuousActions) {
    auto config = config_of(1, 1);
    config.action_space = cale::ActionSet::minimal;
    config.joystick = cale::Joystick::factored;
    const auto refusal = message_of<std::invalid_argument>([&] { cale::action_space(config); });
    EXPECT_THAT(refusal,
                HasSubstr("env.joystick=factored needs env.action_space=continuous, and that is minimal"));
    EXPECT_THROW(cale::Env(config, 1), std::invalid_argument);
}

TEST(VectorEnvMemory, GrowsByTheScreensThatAreSeenLate) {
    auto config = config_of(1, 1);
    const auto growth = [&config] {
        config.motion.observation_latency = {};
        const auto at_once = VectorEnv::memory_per_env(config);
        config.motion.observation_latency = {0, 10};
        return VectorEnv::memory_per_env(config) - at_once;
    };
    EXPECT_GE(growth(), 10 * 210 * 160);
    config.obs = cale::Obs::ram;
    EXPECT_EQ(growth(), 10 * 128);
}

}  // namespace
