// Runs in the sweep's folder that are not the sweep's.
#include "sweep/config_mismatch.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>

#include "support/temporary_folder.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class Refusal : public testing::Test {
  protected:
    Refusal() {
        planned_.base = std::make_shared<SettingTexts>(SettingTexts{{"agent.loss", "huber"},
                                                                    {"agent.rate", "0.0001"},
                                                                    {"agent.new", "3"},
                                                                    {"eval.episodes", "10"},
                                                                    {"log.every", "1000"},
                                                                    {"train.total_steps", "100"}});
        planned_.end.total_steps = 100;
        planned_.end.evaluates = false;
    }
    void trained(const std::string& config, const std::string& step = "000000100") {
        folder_.write("run/config.yaml", config);
        folder_.write("run/episodes.csv", "");
        fs::create_directories(folder_ / ("run/checkpoints/step_" + step));
    }
    std::string reason() { return config_mismatch(planned_, folder_ / "run"); }
    void plan(const std::string& key, const std::string& value) {
        planned_.run.settings.push_back({key, value});
    }

    test::TemporaryFolder folder_;
    PlannedRun planned_;
};

TEST_F(Refusal, NamesEverySettingThatDiffersAndTheWayOut) {
    trained("agent: {loss: huber, rate: 0.0001}\ntrain: {total_steps: 100}\n");
    EXPECT_EQ(reason(), "");
    EXPECT_EQ(status_of(planned_, folder_ / "run").state, RunPhase::finished);
    plan("agent.loss", "mse");
    plan("agent.rate", "2e-4");
    EXPECT_EQ(
        reason(),
        "trained with other settings: agent.loss was huber and is now mse, agent.rate was 0.0001 and is "
        "now 2e-4; give the sweep another --dir, or take the change back");
    EXPECT_EQ(status_of(planned_, folder_ / "run").state, RunPhase::refused);
    EXPECT_EQ(status_of(planned_, folder_ / "run").message, reason());
}

TEST_F(Refusal, NamesAFileThatCannotBeRead) {
    fs::create_directories(folder_ / "run/episodes.csv");  // no file, so that reading it fails
    EXPECT_THAT(reason(), HasSubstr("its folder cannot be read: "));
}

TEST_F(Refusal, NamesAFileThatIsCutOrMissing) {
    const std::string config = "agent: {loss: huber, rate: 0.0001}\n";
    trained(config);
    folder_.write("run/checkpoints/step_000000100/config.yaml", config);
    EXPECT_EQ(reason(), "");
    const auto had = [&](int bytes) {
        folder_.write("run/checkpoints/step_000000100/state.json",
                      fmt::format("{{\"episodes_offset\": {}}}", bytes));
        return reason();
    };
    EXPECT_THAT(had(1), HasSubstr("its episodes.csv is shorter than at its newest checkpoint"));
    EXPECT_EQ(had(0), "");
    fs::remove(folder_ / "run/episodes.csv");
    EXPECT_EQ(reason(), "its episodes.csv is missing; put it back, or remove the run's folder");
    trained("");
    plan("agent.loss", "mse");
    EXPECT_THAT(reason(),
                HasSubstr("run/config.yaml lacks agent.loss and 1 other: it was cut or edited since; copy "))
        << "without it nothing would differ";
}

TEST_F(Refusal, IsAboutValuesThatChangeResults) {
    trained("agent: {loss: huber, rate: 1e-4, gone: 7}\neval: {episodes: 100}\nlog: {every: 1_000}\n");
    EXPECT_EQ(reason(), "") << "a setting that only one of them has is none that changed";
    plan("eval.noop_max", "30");
    plan("log.every", "5");
    plan("agent.rate", "1E-4");
    EXPECT_EQ(reason(), "");
}

TEST_F(Refusal, ARunMayBecomeLongerAndShorterUnlessItHasGoneFurther) {
    trained("train: {total_steps: 100}\n", "000000060");
    plan("train.total_steps", "1e3");
    EXPECT_EQ(reason(), "");
    planned_.run.settings.back().value = "80";
    EXPECT_EQ(reason(), "");
    planned_.run.settings.back().value = "50";
    EXPECT_THAT(reason(), HasSubstr("train.total_steps was 100 and is now 50"));
}

TEST_F(Refusal, ARunWhoseScheduleLastsForAllOfItKeepsItsLength) {
    trained("train: {total_steps: 100}\n", "000000060");
    folder_.write("run/metadata.json", R"({"schedule_over_run": "agent.anneal_learning_rate"})");
    EXPECT_EQ(reason(), "");
    plan("train.total_steps", "1e3");
    EXPECT_EQ(
        reason(),
        "trained with other settings: train.total_steps was 100 and is now 1e3, which changes the "
        "schedule of agent.anneal_learning_rate; give the sweep another --dir, or take the change back");
    planned_.run.settings.back().value = "80";
    EXPECT_THAT(reason(), HasSubstr("train.total_steps was 100 and is now 80"));
    for (const auto* other : {R"({"schedule_over_run": ""})", R"({"seed": 1})", "{", "[]"}) {
        folder_.write("run/metadata.json", other);
        EXPECT_EQ(reason(), "") << other;
    }
}

TEST_F(Refusal, NothingCountsWithoutACheckpoint) {
    folder_.write("run/config.yaml", "agent: {loss: mse}\n");
    folder_.write("run/metadata.json", "{}\n");
    EXPECT_EQ(reason(), "") << "it starts anew";
    EXPECT_EQ(config_mismatch(planned_, folder_ / "none"), "");
}

TEST_F(Refusal, ResultsWhoseCheckpointsAreGoneAreNotStartedOver) {
    folder_.write("run/config.yaml", "agent: {loss: huber}\n");
    folder_.write("run/metadata.json", "{}\n");
    folder_.write("run/episodes.csv", "#{}\nr,l,t\n");
    EXPECT_EQ(reason(), "") << "no game has ended";
    folder_.write("run/episodes.csv", "#{}\nr,l,t\n1,2,3\n");
    EXPECT_THAT(reason(), HasSubstr("it holds results and no checkpoint to resume from"));
    EXPECT_EQ(status_of(planned_, folder_ / "run").state, RunPhase::refused);
}

TEST_F(Refusal, WhatAUserPutIntoARunsFolderIsNotDeleted) {
    for (const auto* begun : {"run/config.yaml", "run/metadata.json", "run/output.log", "run/.lock",
                              "run/events.out.tfevents.1.vm.2", "run/config.yaml.tmp-1-0",
                              "run/checkpoints/step_000000100.partial/manifest.json"})
        folder_.write(begun, "");
    EXPECT_EQ(reason(), "");
    for (const auto* own : {"notes.txt", ".gitignore", "thesis.tmp-draft", "checkpoints/my_best"}) {
        folder_.write(std::string("run/") + own, "");
        EXPECT_THAT(reason(), HasSubstr(std::string("its folder has no checkpoint and holds '") + own + "'"));
        fs::remove(folder_ / "run" / own);
    }
    fs::remove(folder_ / "run/metadata.json");
    EXPECT_THAT(reason(), HasSubstr("holds 'config.yaml'"));
}

TEST_F(Refusal, ARunWithoutSettingsIsNotTakenForAnything) {
    fs::create_directories(folder_ / "run/checkpoints/step_000000100");
    EXPECT_THAT(reason(),
                HasSubstr("run/config.yaml': No such file or directory); put that back, or remove"));
    folder_.write("run/config.yaml", "agent: {loss: [");
    EXPECT_THAT(reason(), HasSubstr("its files do not say what it was trained with"));
}

}  // namespace
}  // namespace cale
