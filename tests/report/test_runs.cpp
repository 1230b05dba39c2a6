#include "report/runs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <numeric>
#include <stdexcept>

#include <fmt/ranges.h>

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

TEST_F(Runs, TakeTheSeedOfTheSettingsWhereNothingElseNamesIt) {
    for (const std::string seed : {"1", "2"}) {
        folders_.write(seed + "/episodes.csv", "#{\"env_id\":\"ALE/Pong-v5\"}\nr,l,t\n-21,100,1\n");
        folders_.write(seed + "/config.yaml", "train: {seed: " + seed + "}\n");
    }
    const auto all = found();
    EXPECT_THAT(all.repeated, IsEmpty());
    ASSERT_THAT(all.runs, SizeIs(2));
    EXPECT_EQ(all.runs[0].seed, 1u);
    EXPECT_EQ(all.runs[1].seed, 2u);
}

TEST_F(Runs, ScoreIsTheMeanOverATenthOfTheRun) {
    std::vector<double> returns(150, 0.0);  // 100 steps each
    std::fill(returns.begin() + 130, returns.end(), 3.0);
    folders_.run("a", "sac", "Pong", 1, returns, "train: {total_steps: 20_000}\n");
    folders_.run("b", "sac", "Pong", 2, returns);  // a Monitor file, say, of whose plans nothing is known
    const auto both = found().runs;
    EXPECT_DOUBLE_EQ(both.at(0).score(), 3);
    EXPECT_EQ(score_at(both.at(0), 14'000), 1.5) << "of 20 games";
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

TEST_F(Runs, TheNewestIterationEndsWithTheRunAndNotWithAGame) {
    folders_.run("a", "sac", "Pong", 1, {-21, -19, -17}, "train: {total_steps: 1000}\n");  // 100 steps each
    folders_.write("a/progress.csv", "global_step,frame\n350,1400\n");
    const auto run = found().runs.at(0);
    EXPECT_THAT(run.steps, ElementsAre(100, 200, 300, 350));
    EXPECT_THAT(run.scores, ElementsAre(-21, -19, -17, -17));
    EXPECT_EQ(run.games_in_score, 1);
}

TEST_F(Runs, ARunNeedsNoRowOfItsProgress) {
    folders_.run("a", "sac", "Pong", 1, {-21}, "train: {total_steps: 1000}\n");
    folders_.write("a/progress.csv", "");
    EXPECT_THAT(found().runs.at(0).scores, ElementsAre(-21));
}

TEST_F(Runs, ARunThatStoppedEarlyIsNotFinishedHoweverSeldomItLogs) {
    const auto is_finished = [&] { return found().runs.at(0).finished; };
    folders_.run("a", "sac", "Pong", 1, {-21, -19}, "train: {total_steps: 1000}\nlog: {every: 1000}\n");
    EXPECT_TRUE(is_finished()) << "nothing but its log could tell";
    folders_.write("a/metadata.json", R"({"finished": false})");
    EXPECT_FALSE(is_finished());
    folders_.write("a/metadata.json", R"({"finished": true})");
    EXPECT_TRUE(is_finished());
}

TEST_F(Runs, SettingsThatLeadBackToThemselvesLeaveOutTheirRunAlone) {
    folders_.run("a", "sac", "Pong", 1, {-21}, "loop: &x\n  again: *x\n");
    folders_.run("b", "sac", "Pong", 2, {-21});
    const auto all = found();
    EXPECT_THAT(all.runs, SizeIs(1));
    ASSERT_THAT(all.left_out, SizeIs(1));
    EXPECT_THAT(all.left_out[0].why, HasSubstr("nested too deeply"));
}

TEST_F(Runs, SettingsThatStandForMoreThanMemoryHoldsLeaveOutTheirRunAlone) {
    std::string bomb = "a0: &a0 {x: 1}\n";
    for (int i = 1; i < 16; ++i) {
        std::string items;
        for (int k = 0; k < 10; ++k) items += fmt::format("k{}: *a{}, ", k, i - 1);
        bomb += fmt::format("a{}: &a{} {{{}}}\n", i, i, items);
    }
    folders_.run("a", "sac", "Pong", 1, {-21}, bomb);
    folders_.run("b", "sac", "Pong", 2, {-21});
    const auto all = found();
    EXPECT_THAT(all.runs, SizeIs(1));
    ASSERT_THAT(all.left_out, SizeIs(1));
    EXPECT_THAT(all.left_out[0].why, HasSubstr("more than 10000 settings"));
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

TEST_F(Runs, ZonesAreThoseOfTheRowsThatHaveThem) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    const std::string header =
        "global_step,zones/centre,zones/right,zones/up_right,zones/up,zones/up_left,zones/left,"
        "zones/down_left,zones/down,zones/down_right\n";
    folders_.write("a/progress.csv", header + "50,,,,,,,,,\n100,0.5,0,0,0,0,0.25,0,0,0.25\n");
    const auto zones = found().runs.at(0).zones;
    ASSERT_THAT(zones, SizeIs(1));  // the first rows of a run resumed from an older checkpoint have none
    EXPECT_EQ(zones[0].step, 100);
    EXPECT_THAT(zones[0].shares, ElementsAre(0.5, 0, 0, 0, 0, 0.25, 0, 0, 0.25));
    folders_.write("a/progress.csv", "global_step,frame\n100,400\n");
    EXPECT_THAT(found().runs.at(0).zones, IsEmpty());
}

TEST_F(Runs, DamageBesideTheScoresIsADoubt) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    const auto doubt = [&](const std::string& file, const std::string& text) {
        const auto path = folders_.write("a/" + file, text);
        const auto all = found();
        std::filesystem::remove(path);
        EXPECT_THAT(all.left_out, IsEmpty());
        return all.runs.at(0).doubts.at(0);
    };
    EXPECT_THAT(doubt("progress.csv", "global_st"), HasSubstr("its rows of progress are left out: "));
    EXPECT_THAT(doubt("progress.csv", "global_step,frame\n100\n"),
                HasSubstr("progress.csv is damaged: line 2"));
    EXPECT_THAT(doubt("joystick_events.csv", "event,count\nNOOP,1\nFI"),
                HasSubstr("its joystick events are"));
    EXPECT_THAT(doubt("progress.csv",
                      "global_step,zones/centre,zones/right,zones/up_right,zones/up,zones/up_left,"
                      "zones/left,zones/down_left,zones/down,zones/down_right\n"
                      "100,1,,0,0,0,0,0,0,0\n"),
                HasSubstr("its zones are left out: "));
}

TEST_F(Runs, ASeedIsAWholeNumber) {
    for (const auto* seed : {"\"12\"", "-1", "1.7"}) {
        folders_.run("a", "sac", "Pong", 1, {-21});
        folders_.write("a/metadata.json", fmt::format("{{\"seed\": {}}}", seed));
        EXPECT_THAT(found().left_out.at(0).why,
                    HasSubstr(fmt::format("its seed is {}, no whole number", seed)));
    }
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

TEST_F(Runs, AnEvaluationOfAnotherPolicyIsDoubtful) {
    folders_.run("a", "sac", "Pong", 1, {-21, -20}, "train: {total_steps: 200}\n");
    folders_.write(
        "a/checkpoints/step_000000200/manifest.json",
        R"({"format_version": 5, "files": {"policy.safetensors": {"bytes": 1, "crc32c": "5ef2a0c1"}}})");
    folders_.write("a/evaluations/x/protocol.json", R"({"name": "x"})");
    folders_.write("a/evaluations/x/step_000000200.csv", "episode,return,length,frames\n0,5,1,4\n");
    for (const auto& [policy, doubts] : {std::pair("5ef2a0c1", 0U), {"5ef2a0c2", 1U}}) {
        folders_.write("a/evaluations/x/step_000000200.json",
                       fmt::format(R"({{"policy_crc32c": "{}"}})", policy));
        EXPECT_THAT(found(ScoreKind::evaluation).runs.at(0).doubts, SizeIs(doubts)) << policy;
    }
    EXPECT_THAT(found(ScoreKind::evaluation).runs.at(0).doubts.at(0),
                HasSubstr("is of another policy than "));
}

TEST_F(Runs, AnEvaluationOfAnEarlierStepIsNotThatOfTheEnd) {
    const std::string header = "episode,return,length,frames\n";
    folders_.run("a", "sac", "Pong", 1, {-21, -20}, "train: {total_steps: 200}\n");
    folders_.write("a/eval/step_000000100.csv", header + "0,-10,1,4\n");
    EXPECT_TRUE(found().runs.at(0).finished);
    EXPECT_FALSE(found(ScoreKind::evaluation).runs.at(0).finished);
    EXPECT_EQ(found(ScoreKind::evaluation).runs.at(0).reached, 100);
    folders_.write("a/eval/step_000000200.csv", header + "0,5,1,4\n");
    EXPECT_TRUE(found(ScoreKind::evaluation).runs.at(0).finished);
    folders_.write("a/evaluations/x/protocol.json", R"({"name": "x"})");
    folders_.write("a/evaluations/x/step_000000100.csv", header + "0,7,1,4\n");
    EXPECT_FALSE(found(ScoreKind::evaluation).runs.at(0).finished) << "cale evaluate's counts";
    folders_.write("a/evaluations/x/step_000000200.csv", header + "0,7,1,4\n");
    EXPECT_TRUE(found(ScoreKind::evaluation).runs.at(0).finished);
}

TEST_F(Runs, DamageInAnEvaluationLeavesTheTrainingsScore) {
    folders_.run("a", "sac", "Pong", 1, {-21, -19});
    folders_.write("a/eval/step_000000200.csv", "episode,return,length,frames\n0,5,1,4\n");
    folders_.write("a/eval/step_000000200_rewards.csv", "");
    const auto run = found().runs.at(0);
    EXPECT_THAT(run.scores, ElementsAre(-21, -19));
    EXPECT_THAT(run.doubts, ElementsAre(HasSubstr("its rewards are left out")));
}

TEST_F(Runs, AreNoOtherConfigurationForTheNoOpsOfTheirEvaluation) {
    folders_.run("a", "sac", "Pong", 1, {-21}, "eval: {noop_max: 0}\n");
    folders_.run("b", "sac", "Pong", 2, {-21}, "eval: {noop_max: 29}\n");
    EXPECT_THAT(labels(), ElementsAre("sac"));
}

TEST_F(Runs, HalfALastLineIsPassedOver) {
    folders_.run("a", "sac", "Pong", 1, {-21, -19});
    std::ofstream(folders_.path() / "a/episodes.csv", std::ios::app) << "-3,10";
    EXPECT_THAT(found().runs.at(0).scores, ElementsAre(-21, -19));
}

TEST_F(Runs, ACutTableIsNotBelieved) {
    const std::vector<double> returns(20, -21);
    const std::string settings =
        "train: {total_steps: 2000}\nenv:\n  max_frames_per_episode: 1200\n  frame_skip: 4\n";
    const auto table = folders_.run("whole", "sac", "Pong", 1, returns, settings) / "episodes.csv";
    const auto whole = std::filesystem::file_size(table);
    folders_.write("whole/progress.csv", "global_step,frame\n2000,8000\n");

    folders_.run("killed", "sac", "Pong", 2, std::vector<double>(9, -21), settings);
    std::ofstream(folders_.path() / "killed/episodes.csv", std::ios::app) << "-21,10";
    folders_.write("killed/progress.csv", "global_step,frame\n1000,4000\n");

    std::filesystem::resize_file(
        folders_.run("finished", "sac", "Pong", 3, returns, settings) / "episodes.csv", whole - 3);
    folders_.write("finished/progress.csv", "global_step,frame\n2000,8000\n");

    folders_.run("too_long", "sac", "Pong", 4, std::vector<double>(10, -21), settings);
    folders_.write("too_long/checkpoints/step_000002000/state.json", "{}");

    folders_.run("shorter", "sac", "Pong", 5, std::vector<double>(19, -21), settings);
    folders_.write("shorter/checkpoints/step_000001000/state.json", R"({"episodes_offset": 300})");
    folders_.write("shorter/checkpoints/step_000002000/state.json",
                   fmt::format("{{\"episodes_offset\": {}}}", whole));

    folders_.run("lives", "sac", "Pong", 11, std::vector<double>(15, -21),
                 settings + "  terminal_on_life_loss: true\n");
    folders_.write("lives/checkpoints/step_000002000/state.json", "{}");

    folders_.run("early", "sac", "Pong", 6, std::vector<double>(17, -21), settings);
    folders_.write("early/progress.csv", "global_step,frame\n2000,8000\n");

    const auto slow = folders_.run("slow", "sac", "Pong", 9, std::vector<double>(17, -21), settings);
    folders_.write(
        "slow/checkpoints/step_000002000/state.json",
        fmt::format("{{\"episodes_offset\": {}}}", std::filesystem::file_size(slow / "episodes.csv")));

    folders_.run("short", "sac", "Pong", 7, std::vector<double>(15, -21), settings);
    folders_.write("short/metadata.json", R"({"finished": true, "seed": 7})");

    const auto first = folders_.run("first", "sac", "Pong", 10, {-21}, settings) / "episodes.csv";
    std::filesystem::resize_file(first, std::filesystem::file_size(first) - 3);

    folders_.run("shuffled", "sac", "Pong", 8, {-21, -20}, settings);
    folders_.write("shuffled/episodes.csv", "#{\"env_id\":\"ALE/Pong-v5\"}\nr,global_step\n1,200\n1,100\n");

    const auto all = found();
    std::map<std::string, std::string> said;  // by folder
    for (const auto& [folder, why] : all.left_out) said[std::filesystem::path(folder).filename()] = why;
    for (const auto& run : all.runs)
        said[run.folder.filename()] = fmt::format("doubts: {}", fmt::join(run.doubts, " "));
    EXPECT_EQ(said["whole"], "doubts: ");
    EXPECT_THAT(said["killed"],
                AllOf(HasSubstr("doubts: "), HasSubstr("killed/episodes.csv ends in the middle of line")));
    EXPECT_THAT(said["finished"],
                HasSubstr("finished/episodes.csv is cut: it ends in the middle of line 22, but "
                          "the run took 2000 agent steps (progress.csv)"));
    EXPECT_THAT(
        said["too_long"],
        HasSubstr("is cut: its last game ended at agent step 1000, no game takes more than 300, and the "
                  "run took 2000 agent steps (checkpoints/step_000002000)"));
    EXPECT_THAT(said["lives"], HasSubstr("doubts: ")) << "steps that lose a life are short";
    EXPECT_THAT(said["shorter"],
                AllOf(HasSubstr("episodes.csv is cut: it has"), HasSubstr("step_000002000")));
    EXPECT_THAT(said["early"],
                AllOf(HasSubstr("doubts: "),
                      HasSubstr("early/episodes.csv: its last game ended at "
                                "agent step 1700, but the run took 2000 agent steps (progress.csv)")));
    EXPECT_EQ(said["slow"], "doubts: ") << "its checkpoint says that nothing is missing";
    EXPECT_THAT(said["short"],
                HasSubstr("no game takes more than 300, and the run took 2000 agent steps (metadata.json)"));
    EXPECT_THAT(said["first"], HasSubstr("first/episodes.csv is cut: it has no whole row"));
    EXPECT_THAT(said["shuffled"],
                HasSubstr("shuffled/episodes.csv is damaged: its agent steps do not ascend"));
    EXPECT_THAT(all.runs, SizeIs(5));
}

TEST_F(Runs, AScoreThatNoGameCountsToIsNamedAndLeavesOutItsRunAlone) {
    folders_.run("good", "sac", "Pong", 1, {-21});
    folders_.run("huge", "sac", "Pong", 2, {-21, 1e308});
    folders_.write("good/eval/step_000000100.csv", "episode,return\n0,-20\n1,-19\n");
    folders_.write("huge/eval/step_000000100.csv", "episode,return\n0,1e308\n1,1e308\n");
    for (const auto kind : {ScoreKind::training, ScoreKind::evaluation}) {
        const auto all = found(kind);
        EXPECT_THAT(all.runs, SizeIs(1));
        ASSERT_THAT(all.left_out, SizeIs(1));
        EXPECT_THAT(all.left_out[0].why,
                    HasSubstr("huge/episodes.csv is damaged: line 4 has a score of 1e+308"));
    }
    folders_.run("huge", "sac", "Pong", 2, {-21, -20});
    EXPECT_THAT(found(ScoreKind::evaluation).left_out.at(0).why,
                HasSubstr("huge/eval/step_000000100.csv is damaged: line 2 has a score of 1e+308"));
}

TEST_F(Runs, SymbolicLinksAreFollowedAndEachRunCountsOnce) {
    namespace fs = std::filesystem;
    folders_.run("elsewhere/a", "sac", "Pong", 1, {-21});
    folders_.run("elsewhere/b", "sac", "Pong", 2, {-21});
    fs::create_directories(folders_.path() / "sweep/deep");
    fs::create_directory_symlink(folders_.path() / "elsewhere/a", folders_.path() / "sweep/a");
    fs::create_directory_symlink("../../elsewhere", folders_.path() / "sweep/deep/all");
    fs::create_directory_symlink("..", folders_.path() / "sweep/deep/circle");
    fs::create_directory_symlink("nowhere", folders_.path() / "sweep/lost");
    const auto all = find_runs({folders_.path() / "sweep"}, ScoreKind::training);
    ASSERT_THAT(all.runs, SizeIs(2));
    EXPECT_EQ(all.runs[0].folder, folders_.path() / "sweep/a");
    EXPECT_EQ(all.runs[1].folder, folders_.path() / "sweep/deep/all/b");
    EXPECT_THAT(all.repeated, IsEmpty());
    ASSERT_THAT(all.left_out, SizeIs(1));
    EXPECT_EQ(all.left_out[0].what, (folders_.path() / "sweep/lost").string());
}

TEST_F(Runs, AreNamedAsTheirFoldersWereGiven) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    folders_.run("b", "sac", "Pong", 2, {});
    const auto relative = std::filesystem::relative(folders_.path());
    const auto all = find_runs({relative / "."}, ScoreKind::training);
    EXPECT_EQ(all.runs.at(0).folder, relative / "a");
    EXPECT_EQ(all.left_out.at(0).what, (relative / "b").string());
}

TEST_F(Runs, ThatASweepListsAndThatAreNotThereAreMissing) {
    folders_.run("sweep/Pong__1", "sac", "Pong", 1, {-21});
    folders_.run("sweep/Boxing__2", "sac", "Boxing", 2, {1});
    folders_.write("sweep/Pong__3/output.log", "no ROM");
    folders_.write("sweep/sweep_runs.txt", "Pong__1\nBoxing__2\nPong__3\nBoxing__3\n");
    const auto all = found();
    EXPECT_THAT(all.missing, ElementsAre((folders_.path() / "sweep/Pong__3").string(),
                                         (folders_.path() / "sweep/Boxing__3").string()));
    EXPECT_THAT(missing_runs(all.runs), IsEmpty())
        << "the list says which runs there are to be, not the grid";
}

TEST_F(Runs, OfAGridThatAreNotThereAreMissing) {
    for (const auto* agent : {"sac", "dqn"})
        for (const auto* game : {"Pong", "Boxing"})
            for (const std::uint64_t seed : {1, 2})
                folders_.run(fmt::format("{}_{}_{}", agent, game, seed), agent, game, seed, {1});
    EXPECT_THAT(missing_runs(found().runs), IsEmpty());
    std::filesystem::remove_all(folders_.path() / "sac_Pong_2");
    std::filesystem::remove_all(folders_.path() / "dqn_Boxing_1");
    EXPECT_THAT(missing_runs(found().runs), ElementsAre("dqn on Boxing, seed 1", "sac on Pong, seed 2"));
}

TEST_F(Runs, KnowTheRulesThatTheyWerePlayedBy) {
    folders_.run(
        "a", "sac", "Pong", 1, {-21},
        "env: {game: ignored, action_space: minimal, sticky_probability: 0, terminal_on_life_loss: true}\n");
    folders_.run("b", "sac", "Pong", 2, {-21});
    folders_.run("c", "sac", "Pong", 3, {-21}, "env: {action_space: keyboard}\n");
    const auto all = found();
    ASSERT_TRUE(all.runs.at(0).env);
    EXPECT_EQ(all.runs[0].env->game, "Pong");
    EXPECT_EQ(all.runs[0].env->action_space, ActionSet::minimal);
    EXPECT_EQ(all.runs[0].env->sticky_probability, 0);
    EXPECT_TRUE(all.runs[0].env->terminal_on_life_loss);
    EXPECT_FALSE(all.runs[1].env);
    EXPECT_FALSE(all.runs[2].env);
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
    folders_.run("emptied", "sac", "Pong", 7, {1});
    folders_.write("emptied/config.yaml", "");
    folders_.write("emptied/checkpoints/step_000000100/config.yaml", "agent: {encoder: phi_sac}\n");
    const auto all = found();
    EXPECT_THAT(all.runs, SizeIs(1));
    const auto left_out = [&](const char* folder, const char* why) {
        return Contains(
            AllOf(Field(&LeftOut::what, HasSubstr(folder)), Field(&LeftOut::why, HasSubstr(why))));
    };
    EXPECT_THAT(all.left_out, left_out("no_game_ended", "no game"));
    EXPECT_THAT(all.left_out, left_out("no_such_game", "'ALE/Pongg-v5'"));
    EXPECT_THAT(all.left_out, left_out("torn", "torn/config.yaml cannot be read: line 2, column 1: "));
    EXPECT_THAT(all.left_out, left_out("damaged", "metadata.json is damaged"));
    EXPECT_THAT(all.left_out, left_out("binary", "episodes.csv"));
    EXPECT_THAT(all.left_out, left_out("emptied", "emptied/config.yaml is missing or empty; copy "));
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
    const std::string steps = "a/evaluations/fixed_steps-0";
    folders_.write(steps + "/protocol.json", R"({"protocol": "fixed_steps", "games": null, "steps": 21})");
    folders_.write(steps + "/step_000000100.csv", games + "0,1,7,28\n1,1,7,28\n2,1,7,28\n");
    const auto chosen = found(ScoreKind::evaluation).runs;
    ASSERT_THAT(chosen, SizeIs(2));
    EXPECT_EQ(chosen[0].score(), -18) << "of games as many as were asked for count, not as were played";
    EXPECT_THAT(chosen[0].steps, ElementsAre(100));
    EXPECT_EQ(chosen[0].games_in_score, 2);
    EXPECT_EQ(chosen[0].chosen_evaluation, "fixed_episodes-0 counts, not fixed_episodes-1, fixed_steps-0");
    EXPECT_EQ(chosen[1].chosen_evaluation, "") << "it has one";
    EXPECT_EQ(chosen[0].settings.at("evaluation"), "protocol fixed_episodes, games 2");
    EXPECT_THAT(chosen[0].event_shares, Contains(1.0));
    EXPECT_THAT(group_runs(chosen, {}), SizeIs(2)) << "runs that were evaluated otherwise are another group";
    EXPECT_FALSE(found(ScoreKind::training).runs.at(0).settings.contains("evaluation"));

    // A later checkpoint counts before one of more games.
    folders_.write("a/evaluations/aa/protocol.json", R"({"protocol": "fixed_episodes", "games": 1})");
    folders_.write("a/evaluations/aa/step_000000200.csv", games + "0,-11,7,28\n");
    EXPECT_EQ(found(ScoreKind::evaluation).runs.at(0).score(), -11);
    EXPECT_EQ(found(ScoreKind::evaluation).runs.at(0).chosen_evaluation, "");
}

TEST_F(Runs, AnEvaluationIsBesideTheRulesThatItWasPlayedBy) {
    folders_.run("a", "sac", "Pong", 1, {-21}, "env: {action_space: minimal, mode: 0}\n");
    folders_.write("a/evaluations/x/protocol.json", R"({"games": 1, "settings": {"env.mode": "1"}})");
    folders_.write("a/evaluations/x/step_000000100.csv", "episode,return,length,frames\n0,7,1,4\n");
    EXPECT_EQ(found().runs.at(0).env->mode, 0);
    EXPECT_EQ(found(ScoreKind::evaluation).runs.at(0).env->mode, 1);
    EXPECT_EQ(found(ScoreKind::evaluation).runs.at(0).settings.at("env.mode"), "0") << "of the training";
}

TEST_F(Runs, AnEvaluationThatNamesTheRunsOwnGameCounts) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    for (const auto* game : {"pong", "ALE/Pong-v5"}) {
        folders_.write("a/evaluations/x/protocol.json",
                       fmt::format(R"({{"games": 1, "settings": {{"env.game": "{}"}}}})", game));
        folders_.write("a/evaluations/x/step_000000100.csv", "episode,return,length,frames\n0,7,1,4\n");
        const auto run = found(ScoreKind::evaluation).runs.at(0);
        EXPECT_EQ(run.score(), 7) << game;
        EXPECT_EQ(run.settings.at("evaluation"), "games 1");
    }
    folders_.write("a/evaluations/x/protocol.json", R"({"games": 1, "settings": {"env.game": "breakout"}})");
    EXPECT_THAT(found(ScoreKind::evaluation).left_out.at(0).why, HasSubstr("only on another one"));
}

TEST_F(Runs, AnEvaluationWithFewerGamesThanWerePlayedIsCut) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    folders_.write("a/evaluations/x/protocol.json", R"({"games": 2})");
    folders_.write("a/evaluations/x/step_000000100.json", R"({"games": 2})");
    folders_.write("a/evaluations/x/step_000000100.csv", "episode,return,length,frames\n0,7,1,4\n");
    EXPECT_THAT(found(ScoreKind::evaluation).left_out.at(0).why,
                HasSubstr("step_000000100.csv is cut: it has 1 games, and 2 were played"));
    folders_.write("a/evaluations/x/step_000000100.csv", "episode,return,length,frames\n0,7,1,4\n1,9,1,4\n");
    EXPECT_EQ(found(ScoreKind::evaluation).runs.at(0).score(), 8);
}

TEST_F(Runs, ThatWereChangedOnTheWayAreOfNoOtherGroup) {
    const std::string settings = "agent: {learning_rate: 1e-3}\n";
    for (const auto* name : {"a", "b"}) folders_.run(name, "sac", "Pong", 1, {-21}, settings);
    ASSERT_THAT(labels(), ElementsAre("sac"));
    folders_.write("a/metadata.json",
                   R"({"env_id": "ALE/Pong-v5", "exp_name": "sac", "seed": 1, "accepted_changes":
        ["2026-11-22T10:00:00Z: agent.learning_rate is 1e-3, and was 6.25e-5"]})");
    const auto runs = found().runs;
    EXPECT_THAT(group_runs(runs, {}), SizeIs(2));
    EXPECT_EQ(runs.at(0).settings.at("accepted_changes"), "agent.learning_rate is 1e-3, and was 6.25e-5");
    EXPECT_THAT(runs.at(0).doubts, ElementsAre(HasSubstr("it was resumed with other settings")));
    EXPECT_THAT(runs.at(1).doubts, IsEmpty());
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
    EXPECT_EQ(labels({"agent", "encoder", "agent.encoder"}), labels({"agent", "agent.encoder"}));
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

TEST_F(Runs, GroupsAreInTheOrderOfTheirNumbers) {
    for (const auto* rate : {"10", "3", "1e-4", "0.5", "2e-3"})
        folders_.run(rate, "sac", "Pong", 1, {1}, fmt::format("agent: {{rate: {}}}\n", rate));
    EXPECT_THAT(labels(), ElementsAre("rate=1e-4", "rate=2e-3", "rate=0.5", "rate=3", "rate=10"));
}

TEST_F(Runs, ASettingThatAnotherMakesNeedlessNamesNoGroup) {
    for (int i = 0; i < 4; ++i)
        folders_.run(fmt::format("{}", i), "sac", "Pong", 1, {-21},
                     fmt::format("agent: {{alpha: {}, beta: {}, zeta: {}}}\n", i > 0, i > 1, i));
    EXPECT_THAT(labels(), ElementsAre("zeta=0", "zeta=1", "zeta=2", "zeta=3"));
}

TEST_F(Runs, ShareTheSettingsInWhichNoGroupDiffers) {
    folders_.run("a", "sac", "Pong", 1, {1}, "agent: {gamma: 0.99, tau: 0.005}\n");
    folders_.run("b", "dqn", "Pong", 1, {1}, "agent: {gamma: 0.99}\n");
    const auto groups = group_runs(found().runs);
    const auto shared = shared_settings(groups);
    ASSERT_THAT(shared, SizeIs(1));
    EXPECT_EQ(shared[0].key, "agent.gamma");
    EXPECT_THAT(differing_settings(groups), IsEmpty());
    const auto all = all_settings(groups);
    ASSERT_THAT(all, SizeIs(2));
    EXPECT_THAT(all[1].values, ElementsAre("", "0.005"));
}

}  // namespace
}  // namespace cale
