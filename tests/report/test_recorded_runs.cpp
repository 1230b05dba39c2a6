// Runs as a table: what a report records, and a comparison with it.
#include "report/recorded_runs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "report/tables.h"
#include "run_folders.h"

namespace cale {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const ComparisonConfig kQuick{.bootstrap = {.resamples = 100}};
const std::string kRules =
    "env: {action_space: continuous, sticky_probability: 0, terminal_on_life_loss: true}\n"
    "train: {total_steps: 1000}\n";

class Recorded : public testing::Test {
  protected:
    Recorded() : folders_("recorded") {
        std::vector<double> returns;
        for (int game = 0; game < 10; ++game) returns.push_back(game);
        folders_.run("runs/a", "sac", "Pong", 1, returns, kRules);
        folders_.run("runs/b", "sac", "Pong", 2, {4, 5, 6, 7, 8, 9, 9, 9, 9, 3}, kRules);
        folders_.run("runs/c", "der", "Pong", 1, {1, 1, 1, 1, 1, 1, 1, 1, 1, 1}, kRules);
    }
    FoundRuns found() const { return find_runs({folders_.path() / "runs"}, ScoreKind::training); }
    CsvTable table(ComparisonConfig config = kQuick) const {
        return read_whole_csv(
            folders_.write("run_curves.csv", recorded_runs_csv(compare(found(), {}, config))));
    }
    std::string error_of(const std::function<void()>& work) const {
        try {
            work();
        } catch (const std::exception& error) {
            return error.what();
        }
        return "no error";
    }

    test::RunFolders folders_;
};

TEST_F(Recorded, HasTheScoreAtEveryTenthOfARunAndItsRules) {
    const auto text = recorded_runs_csv(compare(found(), {}, kQuick));
    EXPECT_THAT(text, testing::StartsWith("group,run,agent,game,seed,step,score,total_steps,env.action_space,"
                                          "env.sticky_probability,env.terminal_on_life_loss\n"
                                          "der,1,der,Pong,1,100,1,1000,continuous,0,true\n"));
    // An iteration is a tenth of the run: each score is that of the game that ended in it.
    EXPECT_THAT(text, HasSubstr("\nsac,1,sac,Pong,1,300,2,1000,continuous,0,true\n"));
    EXPECT_THAT(text, HasSubstr("\nsac,2,sac,Pong,2,1000,3,1000,continuous,0,true\n"));
    EXPECT_EQ(std::ranges::count(text, '\n'), 31);
    auto config = kQuick;
    config.score = ScoreKind::evaluation;
    Comparison evaluations;
    evaluations.config = config;
    EXPECT_EQ(recorded_runs_csv(evaluations), "");
}

TEST_F(Recorded, ARunUnderWayIsRecordedAsFarAsItGot) {
    folders_.run("runs/d", "dqn", "Pong", 1, {1, 2, 3}, "train: {total_steps: 2000}\n");
    const auto text = recorded_runs_csv(compare(found(), {}, kQuick));
    EXPECT_THAT(text, HasSubstr("\ndqn,1,dqn,Pong,1,200,1.5,2000,"));
    EXPECT_THAT(text, HasSubstr("\ndqn,1,dqn,Pong,1,300,2.5,2000,"));
    EXPECT_THAT(text, testing::Not(HasSubstr("dqn,1,dqn,Pong,1,400")));
    FoundRuns again;
    again.runs = read_recorded_runs(read_whole_csv(folders_.write("unfinished.csv", text)), {"dqn"});
    const auto comparison = compare(std::move(again), {}, kQuick);
    EXPECT_TRUE(comparison.is_complete()) << "it is no run of the user's";
    EXPECT_THAT(comparison.notes.front().items.front(),
                HasSubstr("dqn, Pong, seed 1 is unfinished: 300 of 2000 agent steps"));
}

TEST_F(Recorded, RunsThatDifferInSettingsAloneAreTwo) {
    folders_.run("runs/e", "sac", "Pong", 1, {9, 9, 9, 9, 9, 9, 9, 9, 9, 9}, kRules + "agent: {gamma: 1}\n");
    auto config = kQuick;
    config.group_by = {"agent"};
    const auto there = compare(found(), {}, config);
    FoundRuns again;
    again.runs = read_recorded_runs(table(config), {"sac", "der"});
    EXPECT_EQ(compare(std::move(again), {}, kQuick).results[1].scores, there.results[1].scores);
}

TEST_F(Recorded, RulesThatForbidAComparisonAreKept) {
    folders_.run("runs/f", "sac", "Boxing", 1, {1}, "env: {action_space: continuous, difficulty: 1}\n");
    FoundRuns again;
    const auto recorded = table();
    again.runs = read_recorded_runs(recorded, recorded_groups(recorded));
    const auto comparison = compare(std::move(again), {}, kQuick);
    ASSERT_THAT(comparison.left_out_games, testing::SizeIs(testing::Ge(1U)));
    EXPECT_EQ(comparison.left_out_games.front().what, "Boxing");
    EXPECT_THAT(comparison.left_out_games.front().why, HasSubstr("env.difficulty is set"));
}

TEST_F(Recorded, ARunOfAFewStepsIsReadAgain) {
    folders_.run("few/a", "sac", "Pong", 1, {1}, "train: {total_steps: 3}\n");
    const auto text =
        recorded_runs_csv(compare(find_runs({folders_.path() / "few"}, ScoreKind::training), {}, kQuick));
    EXPECT_EQ(read_recorded_runs(read_whole_csv(folders_.write("few.csv", text)), {"sac"}).size(), 1U);
}

TEST_F(Recorded, ComparesAsTheRunsDid) {
    const auto recorded = table();
    EXPECT_THAT(recorded_groups(recorded), ElementsAre("der", "sac"));
    FoundRuns again;
    again.runs = read_recorded_runs(recorded, {"sac", "der"});
    const auto here = compare(std::move(again), {}, kQuick), there = compare(found(), {}, kQuick);
    ASSERT_THAT(labels_of(here), ElementsAre("der", "sac"));
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(here.results[i].scores, there.results[i].scores);
        EXPECT_EQ(here.results[i].aggregates[0].value, there.results[i].aggregates[0].value);
        EXPECT_EQ(here.results[i].aggregates[0].low, there.results[i].aggregates[0].low);
    }
    EXPECT_EQ(here.improvements[0].probability.value, there.improvements[0].probability.value);
    EXPECT_EQ(recorded_runs_csv(here), recorded_runs_csv(there)) << "it can be recorded again";
    EXPECT_EQ(here.random_floors.size(), 1U) << "its rules are known";
    EXPECT_EQ(setup_table(here).rows[1][2], "Atari 100k");
    EXPECT_TRUE(here.is_complete());
    const auto files = csv_files(here);
    const auto scores = std::ranges::find(files, "scores.csv", &TextFile::name);
    ASSERT_NE(scores, files.end());
    EXPECT_THAT(scores->text, HasSubstr("\nsac,sac,Pong,2,1000,,3,"))
        << "how many games that is of is not known";
}

TEST_F(Recorded, StandsBesideRunsAndTakesNoGameFromThem) {
    const auto recorded = table();
    const test::RunFolders mine("recorded-mine");
    mine.run("x", "sac", "Pong", 1, {20}, kRules);
    const auto beside = [&](const std::vector<std::string>& groups) {
        auto runs = find_runs({mine.path()}, ScoreKind::training);
        std::ranges::move(read_recorded_runs(recorded, groups), std::back_inserter(runs.runs));
        auto config = kQuick;
        config.names = {{"sac", "mine"}};
        return compare(std::move(runs), {}, config);
    };
    const auto comparison = beside({"der"});
    EXPECT_THAT(labels_of(comparison), ElementsAre("mine", "der"));
    EXPECT_THAT(comparison.games, testing::SizeIs(1));
    EXPECT_THAT(comparison.missing_runs, IsEmpty()) << "their seeds are no one else's";
    mine.run("p", "sac", "Breakout", 1, {20}, kRules);
    EXPECT_THAT(beside({"der"}).left_out_games, IsEmpty());
    std::filesystem::remove_all(mine.path() / "p");

    mine.run("y", "sac", "Boxing", 1, {2}, kRules);
    const auto without = beside({"der"});
    EXPECT_THAT(labels_of(without), ElementsAre("mine"));
    EXPECT_THAT(without.games, testing::SizeIs(2));
    ASSERT_THAT(without.left_out_baselines, testing::SizeIs(1));
    EXPECT_EQ(without.left_out_baselines[0].why, "it has no run of Boxing");
}

TEST_F(Recorded, ALateFirstScoreLeavesTheOthersWhereTheyAre) {
    auto lines = recorded_runs_csv(compare(found(), {}, kQuick));
    const auto first = lines.find("sac,2,sac,Pong,2,100,");
    lines.erase(first, lines.find('\n', first) + 1 - first);
    FoundRuns again;
    again.runs = read_recorded_runs(read_whole_csv(folders_.write("late.csv", lines)), {"sac"});
    EXPECT_THAT(compare(std::move(again), {}, kQuick).results.at(0).curve_steps,
                ElementsAre(200, 300, 400, 500, 600, 700, 800, 900, 1000));
}

TEST_F(Recorded, ARunThatIsThereTwiceCountsOnce) {
    auto lines = recorded_runs_csv(compare(found(), {}, kQuick));
    const auto at = lines.find("sac,2,");
    auto copy = lines.substr(at);
    for (auto next = copy.find("sac,2,"); next != copy.npos; next = copy.find("sac,2,"))
        copy.replace(next, 6, "sac,9,");
    FoundRuns again;
    again.runs = read_recorded_runs(read_whole_csv(folders_.write("joined.csv", lines + copy)), {"sac"});
    ASSERT_THAT(again.runs, testing::SizeIs(3));
    const auto comparison = compare(std::move(again), {}, kQuick);
    EXPECT_EQ(comparison.results[0].most_runs, 2U);
    ASSERT_THAT(comparison.repeated_runs, testing::SizeIs(1));
    EXPECT_EQ(comparison.repeated_runs[0].what, "sac, Pong, seed 2");
}

TEST_F(Recorded, GroupsCanBeGivenNames) {
    auto config = kQuick;
    config.names = {{"sac", "Soft, Actor \"Critic\""}};
    const auto recorded = table(config);
    EXPECT_THAT(recorded_groups(recorded), ElementsAre("Soft, Actor \"Critic\"", "der"));
    EXPECT_EQ(read_recorded_runs(recorded, {"Soft, Actor \"Critic\""}).size(), 2U);
    config.names = {{"sac", "#1"}};
    EXPECT_THAT(recorded_groups(table(config)), ElementsAre("#1", "der"));
    config.names = {{"ppo", "PPO"}};
    EXPECT_THAT(error_of([&] { compare(found(), {}, config); }),
                HasSubstr("--name ppo=PPO: no group is called ppo; there are der; sac"));
    config.names = {{"sac", "der"}};
    EXPECT_THAT(error_of([&] { compare(found(), {}, config); }),
                HasSubstr("two groups are called der: give one of them another name by --name 'der=NAME'"));
    config.names = {{"sac", "one"}, {"der", "one"}};
    EXPECT_THAT(error_of([&] { compare(found(), {}, config); }),
                HasSubstr("two groups are called one: give one of them another name by --name 'sac=NAME'"));
    // A recorded group of the same name.
    auto both = found();
    std::ranges::move(read_recorded_runs(table(), {"der"}), std::back_inserter(both.runs));
    config.names = {{"der", "mine"}};
    EXPECT_THAT(labels_of(compare(std::move(both), {}, config)), ElementsAre("mine", "sac", "der"));
}

TEST_F(Recorded, BaselinesCanBeGivenNamesThatNoGroupHas) {
    const auto baselines_of = [&](const std::string& baseline, const std::string& label) {
        auto config = kQuick;
        config.names = {{label, "mine"}};
        const auto comparison = compare(found(), {{baseline, {}}}, config);
        EXPECT_THAT(comparison.left_out_baselines, testing::SizeIs(1)) << "it has no scores";
        return labels_of(comparison).front() + ", " + comparison.left_out_baselines.front().what;
    };
    EXPECT_EQ(baselines_of("published", "published"), "der, mine");
    EXPECT_EQ(baselines_of("der", "der"), "mine, der") << "the group is meant";
    const auto refused = HasSubstr("are called der: give the group another name by --name 'der=NAME'");
    EXPECT_THAT(error_of([&] { compare(found(), {{"der", {}}}, kQuick); }), refused);
    auto config = kQuick;
    config.names = {{"published", "der"}};
    EXPECT_THAT(error_of([&] { compare(found(), {{"published", {}}}, config); }), refused);
}

TEST_F(Recorded, SaysWhatIsWrongWithATable) {
    const auto read = [&](const std::string& text) {
        const auto csv = folders_.write("bad.csv", text);
        return error_of([&] { read_recorded_runs(read_csv_by_hand(csv), {"a"}); });
    };
    const std::string header = "group,run,agent,game,seed,step,score,total_steps\n";
    EXPECT_THAT(read("game,random\n"),
                HasSubstr("has no column 'group', so it is no table of recorded runs"));
    EXPECT_THAT(read(header + "a,1,sac,Pong,x,1,2,9\n"), HasSubstr("bad.csv:2: the seed 'x' is no number"));
    EXPECT_THAT(read(header + "a,1,sac,Pong,1,20,2,90\na,1,sac,Pong,1,10,2,90\n"),
                HasSubstr("bad.csv:3: the steps of a run"));
    EXPECT_THAT(read(header + "a,1,sac,Pnog,1,20,2,90\n"), HasSubstr("bad.csv:2: there is no game 'Pnog'"));
    EXPECT_THAT(read(header + "a,1,sac,Pong,1,20,2,9"), HasSubstr("in the middle of line 2"));
    EXPECT_THAT(read(header + "a,1,sac,Pong,1,20,2,90\n\n# note"), HasSubstr("in the middle of line 4"));
    EXPECT_THAT(read(header + "a,1,sac,Pong,1,20"), HasSubstr("line 2 is 'a,1,sac,Pong,1,20'"));
}

}  // namespace
}  // namespace cale
