#include "report/runs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>

#include "cale/action.h"
#include "report/groups.h"
#include "report/run_folders.h"

namespace cale {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Key;
using ::testing::Not;
using ::testing::Pair;
using ::testing::SizeIs;

class Runs : public ::testing::Test {
  protected:
    FoundRuns found(ScoreKind kind = ScoreKind::training) const { return find_runs({folders_.path()}, kind); }
    std::vector<std::string> labels(const std::vector<std::string>& keys = {}) const {
        std::vector<std::string> all;
        for (const auto& group : group_runs(found().runs, keys)) all.push_back(group.label);
        return all;
    }

    test::RunFolders folders_{"runs"};
};

TEST_F(Runs, AreFoundBelowAFolderAndByTheirOwn) {
    folders_.run("sweep/a", "sac", "Pong", 1, {-21, -20});
    folders_.run("sweep/deep/er/b", "sac", "Pong", 2, {-21});
    folders_.write("sweep/notes.txt", "no run");
    EXPECT_THAT(found().runs, SizeIs(2));
    EXPECT_THAT(found().left_out, IsEmpty());
    const auto& one =
        find_runs({folders_.path() / "sweep/a", folders_.path() / "sweep/a/."}, ScoreKind::training);
    ASSERT_THAT(one.runs, SizeIs(1)) << "named twice, counted once";
    EXPECT_EQ(one.runs[0].folder, folders_.path() / "sweep/a");
    EXPECT_THROW(find_runs({folders_.path() / "nothing"}, ScoreKind::training), std::runtime_error);
}

TEST_F(Runs, SayWhatTheyAre) {
    folders_.run("a", "sac", "MsPacman", 7, {100, 300},
                 "env: {game: ms_pacman, threshold: 0.5}\nagent: {encoder: phi_dqn}\n"
                 "train: {seed: 7, total_steps: 200}\nlog: {every: 10, tensorboard: true}\n");
    folders_.write("a/metadata.json", R"({"exp_name": "my_sac", "cale": "0.1.0", "ale": "0.12.1"})");
    const auto run = found().runs.at(0);
    EXPECT_EQ(run.agent, "my_sac") << "metadata.json wins";
    EXPECT_EQ(run.game->rom, "ms_pacman");
    EXPECT_EQ(run.seed, 7u);
    EXPECT_THAT(run.made_with, HasSubstr("ALE 0.12.1"));
    EXPECT_THAT(run.settings, AllOf(Contains(Pair("agent.encoder", "phi_dqn")),
                                    Contains(Pair("env.threshold", "0.5")), Not(Contains(Key("env.game"))),
                                    Not(Contains(Key("train.seed"))), Not(Contains(Key("log.every")))));
    EXPECT_THAT(run.steps, ElementsAre(100, 200));
    EXPECT_THAT(run.scores, ElementsAre(100, 300));
    EXPECT_EQ(run.games_in_score, 1);
    EXPECT_TRUE(run.finished);
}

TEST_F(Runs, ScoreIsTheMeanOverATenthOfTheRun) {
    std::vector<double> returns(150, 0.0);  // 100 steps each
    std::fill(returns.begin() + 130, returns.end(), 3.0);
    folders_.run("a", "sac", "Pong", 1, returns, "train: {total_steps: 20_000}\n");
    folders_.run("b", "sac", "Pong", 2, returns);  // a Monitor file, say, of whose plans nothing is known
    const auto both = found().runs;
    EXPECT_DOUBLE_EQ(both.at(0).score(), 3);
    EXPECT_DOUBLE_EQ(both.at(0).scores.at(139), 1.5) << "of 20 games";
    EXPECT_EQ(both.at(0).games_in_score, 20);
    EXPECT_EQ(both.at(1).games_in_score, 15);
}

TEST_F(Runs, AnIterationIsOfAQuarterOfAMillionStepsAtMost) {
    folders_.run("a", "sac", "Pong", 1, std::vector<double>(5'000, 1.0),
                 "train: {total_steps: 50_000_000}\n");
    EXPECT_EQ(found().runs.at(0).games_in_score, 2'500);
}

TEST_F(Runs, WhereNoGameEndedInTheIterationTheNewestCounts) {
    folders_.run("a", "sac", "Pong", 1, {-21, -19}, "train: {total_steps: 200}\n");
    const auto run = found().runs.at(0);
    EXPECT_THAT(run.scores, ElementsAre(-21, -19));
    EXPECT_EQ(run.games_in_score, 1);
}

TEST_F(Runs, EventsAreThoseOfTheTrainingWhoseScoreCounts) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    EXPECT_THAT(found().runs.at(0).event_shares, IsEmpty());
    folders_.write("a/joystick_events.csv", "event,count\nNOOP,1\nFIRE,3\n");
    folders_.write("a/eval/step_000010000_events.csv", "event,count\nUP,30\n");
    const auto run = found().runs.at(0);
    ASSERT_THAT(run.event_shares, SizeIs(kEventCount));
    EXPECT_DOUBLE_EQ(run.event_shares[static_cast<std::size_t>(Event::fire)], 0.75);
    EXPECT_DOUBLE_EQ(run.event_shares[static_cast<std::size_t>(Event::up)], 0);
}

TEST_F(Runs, ScoreOfAnEvaluationIsThatOfTheNewest) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    folders_.write("a/eval/step_000000900.csv", "episode,return,length,frames\n0,-10,1,4\n1,-20,1,4\n");
    folders_.write("a/eval/step_000010000.csv", "episode,return,length,frames\n0,5,1,4\n1,8,1,4\n");
    folders_.write("a/eval/step_000010000_events.csv", "event,count\nNOOP,30\nUPLEFTFIRE,10\n");
    folders_.write("a/eval/step_000010000_rewards.csv", "quantile,reward\n0,-1\n0.5,0\n1,1\n");
    const auto run = found(ScoreKind::evaluation).runs.at(0);
    EXPECT_THAT(run.steps, ElementsAre(900, 10000));
    EXPECT_THAT(run.scores, ElementsAre(-15, 6.5));
    ASSERT_THAT(run.event_shares, SizeIs(kEventCount));
    EXPECT_DOUBLE_EQ(run.event_shares[static_cast<std::size_t>(Event::noop)], 0.75);
    EXPECT_DOUBLE_EQ(run.event_shares[static_cast<std::size_t>(Event::up_left_fire)], 0.25);
    ASSERT_THAT(run.reward_quantiles, SizeIs(3));
    EXPECT_DOUBLE_EQ(run.reward_quantiles[2].reward, 1);
}

TEST_F(Runs, HalfALastLineIsPassedOver) {
    folders_.run("a", "sac", "Pong", 1, {-21, -19});
    std::ofstream(folders_.path() / "a/episodes.csv", std::ios::app) << "-3,10";
    EXPECT_THAT(found().runs.at(0).scores, ElementsAre(-21, -19));
}

TEST_F(Runs, WhatCannotBeUsedIsNamedAndLeftOut) {
    folders_.run("good", "sac", "Pong", 1, {-21});
    folders_.run("no_game_ended", "sac", "Pong", 2, {});
    folders_.run("no_such_game", "sac", "Pongg", 3, {1});
    folders_.run("torn", "sac", "Pong", 4, {1});
    folders_.write("torn/config.yaml", "env: {game: [pong\n");
    folders_.run("damaged", "sac", "Pong", 5, {1});
    folders_.write("damaged/metadata.json", "{\"seed\": ");
    folders_.run("binary", "sac", "Pong", 6, {1});
    folders_.write("binary/episodes.csv", std::string("\0\xff\n\1,2\n", 7));
    const auto all = found();
    EXPECT_THAT(all.runs, SizeIs(1));
    const auto left_out = [&](const char* folder, const char* why) {
        return Contains(
            AllOf(Field(&LeftOut::what, HasSubstr(folder)), Field(&LeftOut::why, HasSubstr(why))));
    };
    EXPECT_THAT(all.left_out, left_out("no_game_ended", "no game"));
    EXPECT_THAT(all.left_out, left_out("no_such_game", "'ALE/Pongg-v5'"));
    EXPECT_THAT(all.left_out, left_out("torn", "torn/config.yaml cannot be read"));
    EXPECT_THAT(all.left_out, left_out("damaged", "metadata.json is damaged"));
    EXPECT_THAT(all.left_out, left_out("binary", "episodes.csv"));
    EXPECT_THAT(found(ScoreKind::evaluation).left_out, left_out("good", "no evaluation"));
}

TEST_F(Runs, AreScoredByTheEvaluationsOfCaleEvaluateBeforeTheirOwn) {
    const std::string games = "episode,return,length,frames\n";
    for (const auto* run : {"a", "b"}) {
        folders_.run(run, "sac", "Pong", run[0] == 'a' ? 1 : 2, {-21});
        folders_.write(fmt::format("{}/eval/step_000000200.csv", run), games + "0,-21,7,28\n");
    }
    const auto all = found(ScoreKind::evaluation).runs;
    ASSERT_THAT(all, SizeIs(2));
    EXPECT_EQ(all[0].score(), -21);
    EXPECT_EQ(all[0].settings.at("evaluation"), "the run's own");

    const std::string few = "a/evaluations/fixed_episodes-1", many = "a/evaluations/fixed_episodes-0",
                      other = "a/evaluations/fixed_episodes-2";
    folders_.write(few + "/protocol.json", R"({"protocol": "fixed_episodes", "games": 1, "settings": {}})");
    folders_.write(few + "/step_000000100.csv", games + "0,-20,7,28\n");
    folders_.write(many + "/protocol.json", R"({"protocol": "fixed_episodes", "games": 2, "steps": null})");
    folders_.write(many + "/step_000000100.csv", games + "0,-19,7,28\n1,-17,7,28\n");
    folders_.write(many + "/step_000000100_events.csv", "event,count\nFIRE,3\n");
    folders_.write(other + "/protocol.json", R"({"games": 3, "settings": {"env.game": "breakout"}})");
    folders_.write(other + "/step_000000100.csv", games + "0,1,7,28\n1,1,7,28\n2,1,7,28\n");
    const auto chosen = found(ScoreKind::evaluation).runs;
    ASSERT_THAT(chosen, SizeIs(2));
    EXPECT_EQ(chosen[0].score(), -18);
    EXPECT_THAT(chosen[0].steps, ElementsAre(100));
    EXPECT_EQ(chosen[0].games_in_score, 2);
    EXPECT_EQ(chosen[0].settings.at("evaluation"), "protocol fixed_episodes, games 2");
    EXPECT_THAT(chosen[0].event_shares, Contains(1.0));
    EXPECT_THAT(group_runs(chosen, {}), SizeIs(2)) << "runs that were evaluated otherwise are another group";
    EXPECT_FALSE(found(ScoreKind::training).runs.at(0).settings.contains("evaluation"));
}

TEST_F(Runs, TheSameRunTwiceCountsOnce) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    folders_.run("b", "sac", "Pong", 1, {-21, -20});
    folders_.run("c", "sac", "Pong", 1, {-21}, "agent: {encoder: phi_dqn}\n");
    const auto all = found();
    ASSERT_THAT(all.runs, SizeIs(2));
    EXPECT_EQ(all.runs[0].folder, folders_.path() / "b") << "the longer one stays";
    EXPECT_THAT(all.left_out, IsEmpty());
    ASSERT_THAT(all.repeated, SizeIs(1));
    EXPECT_THAT(all.repeated[0].why, HasSubstr("same agent, settings, game and seed"));
}

TEST_F(Runs, AreUnfinishedWhileTheirStepsAreNotTaken) {
    folders_.run("a", "sac", "Pong", 1, {-21, -21}, "train: {total_steps: 1000}\nlog: {every: 100}\n");
    EXPECT_FALSE(found().runs.at(0).finished);
    folders_.write("a/progress.csv", "global_step,frame\n500,2000\n950,3800\n");
    EXPECT_TRUE(found().runs.at(0).finished) << "its last game may end long before";
}

TEST_F(Runs, AreGroupedByWhatDiffers) {
    for (const auto* encoder : {"phi_sac", "phi_dqn"}) {
        for (const int seed : {1, 2}) {
            const auto settings = fmt::format(
                "agent: {{encoder: {}, gamma: {}}}\nenv: {{sticky_probability: 0}}\n"
                "train: {{seed: {}}}\n",
                encoder, encoder[4] == 's' ? 0.9 : 0.99, seed);
            folders_.run(fmt::format("{}{}", encoder, seed), "sac", "Pong", static_cast<std::uint64_t>(seed),
                         {-21}, settings);
        }
    }
    EXPECT_THAT(labels(), ElementsAre("phi_dqn", "phi_sac")) << "gamma tells no other groups apart";
    folders_.run("dqn", "dqn", "Pong", 1, {-21}, "agent: {gamma: 0.99}\n");
    EXPECT_THAT(labels(), ElementsAre("dqn", "sac, phi_dqn", "sac, phi_sac"));
    EXPECT_THAT(labels({"agent"}), ElementsAre("dqn", "sac"));
    EXPECT_THAT(labels({"gamma"}), ElementsAre("gamma=0.9", "gamma=0.99"));
    EXPECT_THAT(labels({"agent", "agent.encoder"}),
                ElementsAre("dqn, no encoder", "sac, phi_dqn", "sac, phi_sac"));
    const auto rows = differing_settings(group_runs(found().runs, {"agent"}));
    ASSERT_THAT(rows, SizeIs(1)) << "those that all groups have";
    EXPECT_EQ(rows[0].key, "agent.gamma");
    EXPECT_THAT(rows[0].values, ElementsAre("0.99", "0.9 / 0.99"));
    try {
        labels({"colour"});
        FAIL();
    } catch (const std::invalid_argument& error) {
        EXPECT_THAT(error.what(), HasSubstr("agent.encoder, agent.gamma"));
    }
    for (const std::string key : {"env.game", "game", "train.seed", "seed"}) {
        try {
            labels({key});
            FAIL();
        } catch (const std::invalid_argument& error) {
            EXPECT_THAT(error.what(), HasSubstr("--group-by " + key + ": game and seed are what the runs"));
        }
    }
}

TEST_F(Runs, GroupsWithLongNamesAreNumbered) {
    for (int i = 0; i < 16; ++i) {
        folders_.run(
            fmt::format("{}", i), "sac", "Pong", 1, {1},
            fmt::format("agent: {{a: {}, b: {}, c: {}, d: {}}}\n", i & 1, i >> 1 & 1, i >> 2 & 1, i >> 3));
    }
    EXPECT_THAT(labels(), SizeIs(16));
    EXPECT_THAT(labels(), Contains("sac 16"));
}

}  // namespace
}  // namespace cale
