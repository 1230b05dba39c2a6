// Whole runs of the Python CALE stack, replayed (tests/golden/README-environment.md).
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <stdexcept>

#include <gtest/gtest.h>

#include "cale/env.h"
#include "cale/games.h"
#include "cale/text.h"
#include "support/golden.h"

namespace {

using cale::ActionSet;

constexpr auto kCrcTable = [] {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
        table[byte] = byte;
        for (int bit = 0; bit < 8; ++bit) table[byte] = (table[byte] >> 1) ^ (table[byte] % 2 * 0xEDB88320u);
    }
    return table;
}();

class Crc32 {
  public:
    void add(std::span<const std::uint8_t> bytes) {
        for (const std::uint8_t byte : bytes) state_ = (state_ >> 8) ^ kCrcTable[(state_ ^ byte) & 0xFF];
    }
    std::int64_t value() const { return ~state_; }

  private:
    std::uint32_t state_ = ~0u;
};

std::int64_t crc_of(std::span<const std::uint8_t> bytes) {
    Crc32 crc;
    crc.add(bytes);
    return crc.value();
}

cale::ContinuousAction continuous_action(std::uint64_t seed, std::uint64_t t) {
    const double theta = -M_PI + 2 * M_PI * golden::uniform(seed, 3 * t + 1);
    return {static_cast<float>(golden::uniform(seed, 3 * t)), static_cast<float>(theta),
            static_cast<float>(golden::uniform(seed, 3 * t + 2))};
}

ActionSet action_space(const std::string& name) {
    static const std::map<std::string, ActionSet> kSpaces{
        {"continuous", ActionSet::continuous}, {"minimal", ActionSet::minimal}, {"full", ActionSet::full}};
    return kSpaces.at(name);
}

// Agent step `t` of the stream of `seed`.
cale::StepResult step(cale::Env& env, std::uint64_t seed, std::uint64_t t, std::span<std::uint8_t> frame) {
    if (env.actions().empty()) return env.step(continuous_action(seed, t), frame);
    const auto count = static_cast<double>(env.actions().size());
    return env.step(static_cast<std::int64_t>(golden::uniform(seed, t) * count), frame);
}

cale::EnvConfig config_of(const YAML::Node& run) {
    cale::EnvConfig config;
    config.game = run["game"].as<std::string>();
    config.action_space = action_space(run["actions"].as<std::string>());
    if (!run["tau"].IsNull()) config.threshold = run["tau"].as<double>();
    config.paddle_strength = cale::PaddleStrength::radius;
    config.sticky_probability = run["sticky"].as<double>();
    config.terminal_on_life_loss = run["life_loss"].as<bool>();
    config.max_frames_per_episode = 1'000'000'000;
    return config;
}

using Rows = std::vector<std::vector<std::int64_t>>;

void replay(const YAML::Node& run) {
    cale::Env env(config_of(run), run["ale_seed"].as<std::uint32_t>());
    EXPECT_EQ(env.screen_height(), run["screen"][0].as<int>());
    EXPECT_EQ(env.screen_width(), run["screen"][1].as<int>());
    EXPECT_EQ(env.actions().size(), run["n_actions"].as<std::size_t>());

    std::vector<std::uint8_t> frame(cale::kFrameSize);
    env.reset(frame);
    EXPECT_EQ(crc_of(frame), run["reset"]["crc"].as<std::int64_t>());
    EXPECT_EQ(env.lives(), run["reset"]["lives"].as<int>());

    const auto seed = run["action_seed"].as<std::uint64_t>();
    const auto steps = run["steps"].as<std::int64_t>();
    const bool reset_on_terminal = run["reset_on"].as<std::string>() == "terminal";
    const auto first_count = run["first"].size();
    Rows first;
    Rows ends;
    Rows blocks;
    std::int64_t total_reward = 0;
    std::int64_t terminals = 0;
    Crc32 block;
    for (std::int64_t t = 0; t < steps; ++t) {
        const auto result = step(env, seed, static_cast<std::uint64_t>(t), frame);
        const std::int64_t crc = crc_of(frame);
        const auto reward = static_cast<std::int64_t>(result.reward);
        if (first.size() < first_count) first.push_back({t, result.event, reward, crc});
        block.add(frame);
        total_reward += reward;

        EXPECT_FALSE(result.truncated);
        if (result.terminal) {
            ++terminals;
            std::int64_t reset_crc = -1;
            if (result.episode_over || reset_on_terminal) {
                env.reset(frame);
                reset_crc = crc_of(frame);
            }
            ends.push_back({t, result.episode_over, result.frames, reset_crc});
        }
        if ((t + 1) % 100 == 0) {
            blocks.push_back({t + 1, total_reward, terminals, env.lives(), std::exchange(block, {}).value()});
        }
    }
    EXPECT_EQ(first, run["first"].as<Rows>());
    EXPECT_EQ(ends, run["ends"].as<Rows>());
    EXPECT_EQ(blocks, run["blocks"].as<Rows>());
    EXPECT_EQ(crc_of(env.ram()), run["final"]["ram_crc"].as<std::int64_t>());
    EXPECT_EQ(env.frame_number(), run["final"]["frame"].as<std::int64_t>());
}

TEST(GoldenEnvironment, EveryRunOfTheReference) {
    for (const auto& file : golden::files_with({"cases"})) {
        const auto cases = golden::load(file)["cases"];
        ASSERT_GT(cases.size(), 0u) << file;
        for (const auto& run : cases) {
            SCOPED_TRACE(run["name"].as<std::string>());
            replay(run);
        }
    }
}

// A row of environment_all_games.csv: how the game is played, and the CRCs of what is then seen.
using Case = std::map<std::string, std::string>;

const std::string kAllGames = "environment_all_games.csv";

std::map<std::string, std::vector<Case>> cases_by_game() {
    std::ifstream file(golden::path_of(kAllGames));
    std::string line;
    std::getline(file, line);
    const auto names = cale::split(line, ',');
    std::map<std::string, std::vector<Case>> result;
    while (std::getline(file, line)) {
        const auto values = cale::split(line, ',');
        if (values.size() != names.size()) throw std::runtime_error(kAllGames + ": a bad line: " + line);
        Case row;
        for (std::size_t i = 0; i < names.size(); ++i) row[names[i]] = values[i];
        result[row.at("game")].push_back(row);
    }
    return result;
}

cale::EnvConfig config_of(const Case& run) {
    cale::EnvConfig config;
    config.game = run.at("game");
    config.action_space = action_space(run.at("actions"));
    config.threshold = std::stod(run.at("threshold"));
    config.event_map =
        run.at("event_map") == "ale_0_10" ? cale::EventMap::ale_0_10 : cale::EventMap::symmetric;
    config.paddle_strength = cale::PaddleStrength::radius;
    config.sticky_probability = std::stod(run.at("sticky"));
    config.terminal_on_life_loss = run.at("life_loss") == "1";
    config.frame_skip = std::stoll(run.at("frame_skip"));
    const auto limit = std::stoll(run.at("max_frames"));
    config.max_frames_per_episode = limit > 0 ? limit : 1'000'000'000;
    config.truncation_is_terminal = true;  // as Dopamine has it
    return config;
}

// The running CRCs of the observations, of the RAM, and of what else a step or a reset returns.
struct Trace {
    Crc32 frames, ram, results;

    void add(const cale::Env& env, std::span<const std::uint8_t> frame,
             std::initializer_list<std::int64_t> numbers) {
        frames.add(frame);
        ram.add(env.ram());
        for (const std::int64_t number : numbers) {
            std::array<std::uint8_t, 4> bytes;  // little-endian
            for (std::size_t i = 0; i < 4; ++i) bytes[i] = static_cast<std::uint8_t>(number >> (8 * i));
            results.add(bytes);
        }
    }
};

std::vector<Trace> play(const Case& run, std::size_t blocks) {
    cale::Env env(config_of(run), static_cast<std::uint32_t>(std::stoul(run.at("ale_seed"))));
    const auto seed = std::stoull(run.at("action_seed"));
    const auto steps = std::stoull(run.at("steps"));
    const auto resets = cale::split(run.at("resets"), ' ');
    std::vector<std::uint8_t> frame(cale::kFrameSize);
    Trace trace;
    const auto reset = [&] {
        env.reset(frame);
        trace.add(env, frame, {env.lives(), env.frame_number()});
    };
    std::vector<Trace> result;
    reset();
    for (std::uint64_t t = 0; t < steps; ++t) {
        if (std::ranges::find(resets, std::to_string(t)) != resets.end()) reset();
        const auto seen = step(env, seed, t, frame);
        trace.add(env, frame,
                  {seen.event, static_cast<std::int64_t>(seen.reward), seen.terminal, seen.episode_over,
                   seen.frames, env.lives(), env.frame_number()});
        if (seen.episode_over || (seen.terminal && run.at("reset_on") == "terminal")) reset();
        if ((t + 1) % (steps / blocks) == 0) result.push_back(trace);
    }
    return result;
}

std::vector<std::string> rom_names() {
    std::vector<std::string> names;
    for (const auto& game : cale::games()) names.emplace_back(game.rom);
    return names;
}

class GoldenGames : public testing::TestWithParam<std::string> {};

TEST_P(GoldenGames, AreTheReferences) {
    static const auto all = cases_by_game();
    const std::string& game = GetParam();
    ASSERT_TRUE(all.contains(game)) << kAllGames << " has no case of " << game;
    for (const Case& run : all.at(game)) {
        std::ostringstream name;
        for (const auto& [key, value] : run) {
            if (key != "frames" && key != "ram" && key != "results") name << key << '=' << value << ' ';
        }
        SCOPED_TRACE(name.str());
        const auto blocks = cale::split(run.at("frames"), ' ').size();
        const auto block_steps = std::stoull(run.at("steps")) / blocks;
        const auto traces = play(run, blocks);
        ASSERT_EQ(traces.size(), blocks);
        const auto compare = [&](const char* column, Crc32 Trace::*crc) {
            const auto expected = cale::split(run.at(column), ' ');
            for (std::size_t i = 0; i < blocks; ++i) {
                if ((traces[i].*crc).value() == std::stoll(expected.at(i), nullptr, 16)) continue;
                ADD_FAILURE() << game << ": " << column << " differ from the reference, first in steps "
                              << i * block_steps << " to " << (i + 1) * block_steps - 1;
                return;
            }
        };
        compare("frames", &Trace::frames);
        compare("ram", &Trace::ram);
        compare("results", &Trace::results);
    }
}

INSTANTIATE_TEST_SUITE_P(All, GoldenGames, testing::ValuesIn(rom_names()),
                         [](const auto& game) { return game.param; });

}  // namespace
