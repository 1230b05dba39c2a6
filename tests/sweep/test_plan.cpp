// What is asked of the training programs before anything is started.
#include "sweep/plan.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "fake_program.h"
#include "settings/config.h"
#include "settings/shell_text.h"
#include "support/working_folder.h"
#include "sweep/shell.h"

namespace cale {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class SweepPlan : public testing::Test {
  protected:
    std::vector<PlannedRun> plan_of(const std::string& grid, const std::string& agent = "fake",
                                    const std::vector<std::string>& overrides = {}) {
        const auto file = fake_.write(
            "mine.yaml", "agent: " + agent + "\nset: {env.rom_dir: " + (fake_.path() / "roms").string() +
                             "}\ngrid: {train.seed: 1, env.game: pong" + grid + "}\n");
        return plan(read_sweep(file, overrides), fake_.path());
    }
    std::string mistake(const std::string& grid, const std::string& agent = "fake") {
        return test::error_of<ConfigError>([&] { plan_of(grid, agent); });
    }
    test::FakeProgram fake_;
};

TEST_F(SweepPlan, TheProgramResolvesEveryRun) {
    const auto runs = plan_of(", train.total_steps: [100, 2000000]");
    ASSERT_EQ(runs.size(), 2u);
    EXPECT_EQ(runs[0].program, fake_.path() / "train_fake");
    EXPECT_EQ(runs[0].end.total_steps, 100);
    EXPECT_EQ(runs[1].end.total_steps, 2'000'000);
    EXPECT_FALSE(runs[0].end.evaluates);
    EXPECT_LT(runs[0].memory, 2e9) << "a short run never fills its replay";
    EXPECT_GT(runs[1].memory, 7e9) << "a million frames";
    EXPECT_LT(plan_of(", train.total_steps: 2000000", "fake", {"env.obs=ram"})[0].memory, 2e9)
        << "a million times 128 bytes";
    EXPECT_EQ(largest_memory(runs), runs[1].memory);
}

std::string text_of(const PlannedRun& run, const std::string& key) {
    const auto* text = planned_value(run, key);
    return text != nullptr ? *text : "no such setting";
}

TEST_F(SweepPlan, KnowsEverySettingOfARunWhateverTheOthersHave) {
    const auto file =
        fake_.write("mine.yaml", "set: {env.rom_dir: " + (fake_.path() / "roms").string() +
                                     "}\ngrid: {train.seed: 1, env.game: pong}\n"
                                     "variants:\n"
                                     "  - {agent: fake, agent.loss: [mse, huber], log.every: 5}\n"
                                     "  - {agent: fake, train.total_steps: 2e6}\n");
    const auto runs = plan(read_sweep(file), fake_.path());
    ASSERT_EQ(runs.size(), 3u);
    EXPECT_EQ(text_of(runs[0], "agent.loss"), "mse");
    EXPECT_EQ(text_of(runs[1], "agent.loss"), "huber");
    EXPECT_EQ(text_of(runs[1], "log.every"), "5");
    EXPECT_EQ(runs[1].end.total_steps, 100);
    EXPECT_EQ(text_of(runs[2], "agent.loss"), "huber") << "as the program has it";
    EXPECT_EQ(text_of(runs[2], "log.every"), "10");
    EXPECT_EQ(runs[2].end.total_steps, 2'000'000);
    EXPECT_EQ(text_of(runs[2], "agent.lost"), "no such setting");
}

TEST_F(SweepPlan, WhatTheProgramRefusesIsSaidBeforeAnythingStarts) {
    EXPECT_THAT(mistake(", agent.typo: 3"),
                HasSubstr("mine.yaml:3:39: train_fake: unknown key 'agent.typo'"));
    EXPECT_THAT(mistake(", agent.typo: 3"), testing::Not(HasSubstr("--set")));
    EXPECT_THAT(mistake(", agent.size: [1, huge]"),
                HasSubstr("mine.yaml:3:39: train_fake: agent.size must be a number, not 'huge'"));
    EXPECT_EQ(test::error_of<ConfigError>([&] { plan_of(", agent.size: 1", "fake", {"agent.size=huge"}); }),
              "mine: train_fake: --set agent.size=huge: agent.size must be a number, not 'huge'")
        << "the file has no part in it";
    EXPECT_EQ(test::error_of<ConfigError>([&] { plan_of("", "fake", {"agent.typo=3"}); }),
              "mine: train_fake: --set agent.typo=3: unknown key 'agent.typo'");
    EXPECT_THAT(mistake("", "fkae"), HasSubstr("agent 'fkae': there is no program train_fkae in"));
    EXPECT_THAT(mistake("", "fkae"), HasSubstr("did you mean 'fake'?"));
    EXPECT_THAT(mistake(", env.rom_dir: /nowhere"), HasSubstr("env.game: "));
    EXPECT_THAT(mistake(", env.rom_dir: /nowhere"), HasSubstr("/nowhere"));
}

TEST_F(SweepPlan, SettingsThatDoNotFitTogetherAreSaidBeforeAnythingStarts) {
    EXPECT_EQ(mistake(", agent.size: [1, 9], agent.loss: [huber, mse]"),
              "mine: Pong__fake__size=9__loss=mse__1: train_fake: agent.size is 9, which is not for "
              "agent.loss = mse");
    EXPECT_EQ(mistake(", agent.size: 9, agent.loss: [huber, mse]"),
              "mine: Pong__fake__size=9__loss=mse__1: train_fake: agent.size is 9, which is not for "
              "agent.loss = mse");
    const auto roms = (fake_.path() / "roms").string();
    const auto file = fake_.write("apart.yaml", "agent: fake\nset: {env.rom_dir: " + roms +
                                                    "}\ngrid: {train.seed: 1..2, env.game: pong}\n"
                                                    "variants: [{agent.size: 9}, {agent.loss: mse}]\n");
    EXPECT_EQ(plan(read_sweep(file), fake_.path()).size(), 4u) << "no run has both";
}

TEST_F(SweepPlan, AnEmptyPartOfThePathIsTheWorkingFolder) {
    plan_of("");
    const std::string before = std::getenv("PATH");
    const test::WorkingFolder here(fake_.path());
    for (const auto& path : {":" + before, before + ":", before + "::/bin"}) {
        ::setenv("PATH", path.c_str(), 1);
        EXPECT_EQ(plan(read_sweep("mine.yaml"), "/nowhere")[0].program, fake_.path() / "train_fake") << path;
    }
    ::setenv("PATH", before.c_str(), 1);
}

TEST_F(SweepPlan, ARunsOwnGameHasToFitItsSettings) {
    const auto roms = (fake_.path() / "roms").string();
    std::filesystem::copy_file(roms + "/pong.bin", roms + "/ms_pacman.bin");
    const auto file = fake_.write("games.yaml", "agent: fake\nset: {env.rom_dir: " + roms +
                                                    ", env.action_space: continuous, env.paddle: absolute}\n"
                                                    "grid: {train.seed: 1, env.game: [pong, ms_pacman]}\n");
    const auto sentence = test::error_of<ConfigError>([&] { plan(read_sweep(file), fake_.path()); });
    EXPECT_THAT(sentence, HasSubstr("games: MsPacman__fake__1: "));
    EXPECT_THAT(sentence, HasSubstr("paddle"));
    const std::vector<std::string> pong_alone = {"env.game=pong"};
    EXPECT_EQ(plan(read_sweep(file, pong_alone), fake_.path()).size(), 1u);
}

TEST_F(SweepPlan, AsksAboutAsManyRunsAsThereAre) {
    std::string rates;
    for (int i = 0; i < 120; ++i) rates += fmt::format("{}{}e-4", i > 0 ? ", " : "", i + 1);
    const auto runs = plan_of(", agent.rate: [" + rates + "], agent.loss: [huber, mse]");
    ASSERT_EQ(runs.size(), 240u);
    EXPECT_EQ(text_of(runs[239], "agent.rate"), "120e-4");
    EXPECT_EQ(text_of(runs[239], "agent.mode"), "fast");
}

TEST_F(SweepPlan, AsksAboutSettingsThatAreLongerThanOneCommand) {
    const std::string loss(4'000, 'x');  // 50 of them are more than a shell takes
    std::string rates;
    for (int i = 0; i < 50; ++i) rates += fmt::format("{}{}e-4", i > 0 ? ", " : "", i + 1);
    const auto file =
        fake_.write("mine.yaml", fmt::format("agent: fake\nset: {{env.rom_dir: {}, agent.loss: {}}}\n"
                                             "grid: {{train.seed: 1, env.game: pong, agent.rate: [{}]}}\n",
                                             (fake_.path() / "roms").string(), loss, rates));
    const auto runs = plan(read_sweep(file), fake_.path());
    ASSERT_EQ(runs.size(), 50u);
    EXPECT_EQ(text_of(runs[49], "agent.rate"), "50e-4");
    EXPECT_EQ(text_of(runs[49], "agent.loss"), loss);
}

TEST_F(SweepPlan, AsksAboutAsManySeedsAsThereAre) {
    EXPECT_EQ(plan_of("", "fake", {"train.seed=1..9000"}).size(), 9000u);
}

TEST_F(SweepPlan, ARunIsACommand) {
    auto runs = fake_.runs({"fast"});
    runs[0].run.config = "/configs/a b.yaml";
    const RunPlace place{.folder = "/runs/x", .threads = 2, .device = "cuda:1"};
    EXPECT_EQ(shell_text(command_of(runs[0], place, /*resume=*/true)),
              runs[0].program.string() +
                  " --config '/configs/a b.yaml' agent.mode=fast --run-dir /runs/x --threads 2 --device "
                  "cuda:1 --no-progress --resume");
    EXPECT_THAT(command_of(runs[0], place, /*resume=*/false), testing::Not(testing::Contains("--resume")));
}

TEST(Shell, ReadsTheSameArguments) {
    const std::vector<std::string> odd = {"a b", "it's", "", "$HOME", "*", "x=1"};
    EXPECT_EQ(answer_of("printf '[%s]' " + shell_text(odd)).text, "[a b][it's][][$HOME][*][x=1]");
}

}  // namespace
}  // namespace cale
