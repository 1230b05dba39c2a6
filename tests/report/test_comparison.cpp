#include "report/comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>
#include <string>

#include "cale/random_play.h"
#include "report/csv.h"
#include "report/run_folders.h"
#include "report/tables.h"

namespace cale {
namespace {

using ::testing::Contains;
using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

/// The notes as a terminal shows them.
std::vector<std::string> lines_of(const std::vector<Note>& notes) {
    std::vector<std::string> lines;
    for (const auto& note : notes) {
        lines.push_back(note.text);
        lines.insert(lines.end(), note.items.begin(), note.items.end());
    }
    return lines;
}

const ComparisonConfig kQuick{.bootstrap = {.resamples = 500}};

class Comparing : public ::testing::Test {
  protected:
    Comparison compared(const std::vector<Baseline>& baselines = {}, ComparisonConfig config = kQuick) const {
        return compare(find_runs({folders_.path()}, config.score), baselines, config);
    }

    test::RunFolders folders_{"comparison"};
};

TEST_F(Comparing, OnlyGamesThatAllHavePlayedAndThatHaveAHumanScore) {
    for (const auto* agent : {"sac", "dqn"}) {
        folders_.run(fmt::format("{}_pong", agent), agent, "Pong", 1, {-20.7});
        folders_.run(fmt::format("{}_air_raid", agent), agent, "AirRaid", 1, {400});
    }
    folders_.run("sac_boxing", "sac", "Boxing", 1, {12.1});
    const auto comparison = compared();
    ASSERT_THAT(comparison.games, SizeIs(1));
    EXPECT_EQ(comparison.games[0]->name, "Pong");
    ASSERT_THAT(comparison.left_out_games, SizeIs(2));
    EXPECT_EQ(comparison.left_out_games[0].what, "AirRaid");
    EXPECT_THAT(comparison.left_out_games[0].why, HasSubstr("no human score"));
    EXPECT_EQ(comparison.left_out_games[1].what, "Boxing");
    EXPECT_EQ(comparison.left_out_games[1].why, "no run of dqn");
    EXPECT_THAT(labels_of(comparison), ElementsAre("dqn", "sac"));
    EXPECT_THAT(comparison.results[1].games, SizeIs(3)) << "tables and curves show them all";
    for (const auto* agent : {"der", "ppo", "sacd"})
        folders_.run(fmt::format("{}_pong", agent), agent, "Pong", 1, {-20.7});
    EXPECT_EQ(compared().left_out_games[1].why, "no run of der; dqn; ppo and 1 other group");
    EXPECT_NEAR(comparison.results[1].aggregates[0].value, 0, 1e-12);
}

TEST_F(Comparing, WithoutACommonGameThereAreStillTables) {
    folders_.run("a", "sac", "Pong", 1, {-21});
    folders_.run("b", "dqn", "Boxing", 1, {1});
    const auto comparison = compared({{"nobody", {{"Pong", 3}}}});
    EXPECT_THAT(comparison.games, IsEmpty());
    EXPECT_THAT(comparison.improvements, IsEmpty());
    EXPECT_THAT(lines_of(comparison.notes), Contains(HasSubstr("no game")));
    EXPECT_THAT(game_table(comparison).rows, SizeIs(2));
}

TEST_F(Comparing, CurvesHoldWhereAllRunsHaveAScore) {
    folders_.run("a", "sac", "Pong", 1, {-20, -18, -16, -14});  // games end at 100, 200, 300, 400
    folders_.run("b", "sac", "Pong", 2, {-10, -10});
    const auto comparison = compared();
    const auto& game = comparison.results.at(0).games.at(0);
    ASSERT_FALSE(game.curve.steps.empty());
    EXPECT_DOUBLE_EQ(game.curve.steps.front(), 100);
    EXPECT_DOUBLE_EQ(game.curve.steps.back(), 200);
    EXPECT_DOUBLE_EQ(game.curve.values.front().value, -15);
    EXPECT_DOUBLE_EQ(game.curve.values.back().value, -14);
    EXPECT_DOUBLE_EQ(game.mean.value, -12) << "the longer run counts to its end";
    EXPECT_DOUBLE_EQ(game.curve.values.back().low, -18);
    EXPECT_DOUBLE_EQ(game.curve.values.back().high, -10);
    const auto& group = comparison.results[0];
    EXPECT_THAT(group.curve_steps, SizeIs(game.curve.steps.size()));
    // Pong's random play has -20.7, people 14.6.
    EXPECT_NEAR(group.curve.front().front().value, (-15 + 20.7) / 35.3, 1e-9);
    EXPECT_NEAR(group.curve.back().front().value, (-14 + 20.7) / 35.3, 1e-9);
}

TEST_F(Comparing, EventsAndRewardsAreTheMeansOfTheRunsThatHaveThem) {
    const std::string header = "episode,return,length,frames\n";
    const auto run = [&](const std::string& name, std::uint64_t seed) {
        folders_.run(name, "sac", "Pong", seed, {-20});
        folders_.write(name + "/eval/step_000000100.csv", header + "0,-20,4,16\n");
        return name + "/eval/step_000000100_";
    };
    folders_.write(run("a", 1) + "events.csv", "event,count\nFIRE,3\nUP,1\n");
    folders_.write(run("b", 2) + "events.csv", "event,count\nFIRE,1\nUP,3\n");
    folders_.write("a/eval/step_000000100_rewards.csv", "quantile,reward\n0,0\n1,7\n");
    folders_.write("b/eval/step_000000100_rewards.csv", "quantile,reward\n0,2\n1,9\n");
    run("c", 3);
    auto config = kQuick;
    config.score = ScoreKind::evaluation;
    const auto comparison = compared({}, config);
    const auto& shares = comparison.results.at(0).games.at(0).event_shares;
    ASSERT_THAT(shares, Not(IsEmpty()));
    EXPECT_DOUBLE_EQ(shares.at(static_cast<std::size_t>(Event::fire)), 0.5);
    EXPECT_DOUBLE_EQ(shares.at(static_cast<std::size_t>(Event::up)), 0.5);
    const auto& rewards = comparison.results.at(0).games.at(0).reward_quantiles;
    ASSERT_EQ(rewards.size(), 2U);
    EXPECT_EQ(rewards[0].reward, 1);
    EXPECT_EQ(rewards[1].reward, 8);
}

TEST_F(Comparing, SaysWhatAReaderMustKnow) {
    folders_.run("a1", "sac", "Pong", 1, {-20});
    folders_.run("b1", "dqn", "Pong", 1, {-20});
    folders_.run("b2", "dqn", "Pong", 2, {-20}, "train: {total_steps: 9000}\n");
    ComparisonConfig config = kQuick;
    config.group_by = {"agent"};
    const auto comparison = compared({}, config);
    EXPECT_FALSE(comparison.results[1].has_interval());
    EXPECT_THAT(lines_of(comparison.notes),
                Contains("Scores of runs that are the mean of fewer than 5 games: dqn; sac."));
    EXPECT_THAT(lines_of(comparison.notes), Contains(HasSubstr("no interval: sac.")));
    EXPECT_THAT(lines_of(comparison.notes), Contains(HasSubstr("dqn (2)")));
    EXPECT_THAT(lines_of(comparison.notes), Contains(HasSubstr("b2 is unfinished")));
    EXPECT_THAT(lines_of(comparison.notes), Not(Contains(HasSubstr("b1"))));
    EXPECT_FALSE(comparison.is_complete());
}

TEST_F(Comparing, SaysWhatTheSettingsOfRunsMakeOfTheirScores) {
    folders_.run("a", "sac", "Pong", 1, {-20}, "train: {total_steps: 100}\nagent: {min_replay: 1_00}\n");
    folders_.run("b", "dqn", "Pong", 1, {-20, -20},
                 "train: {total_steps: 200}\nagent: {min_replay: 100}\nenv: {action_space: minimal, "
                 "max_frames_per_episode: 4000}\n");
    ComparisonConfig config = kQuick;
    config.group_by = {"agent"};
    const auto lines = lines_of(compared({}, config).notes);
    EXPECT_THAT(lines,
                Contains("Groups have runs of different lengths, in agent steps: 100 (sac), 200 (dqn)."));
    EXPECT_THAT(lines, Contains(testing::MatchesRegex("Games are cut off earlier .*: dqn\\.")));
    EXPECT_THAT(lines, Contains(testing::MatchesRegex("Runs end before the first update .*: sac\\.")));
}

TEST_F(Comparing, SaysHowRunsOfAGroupWereEvaluated) {
    const std::string game = "episode,return,length,frames\n0,7,1,4\n";
    folders_.run("a", "sac", "Pong", 1, {-20});
    folders_.run("b", "sac", "Pong", 2, {-20});
    folders_.write("a/eval/step_000000100.csv", game);
    for (const auto* way : {"greedy", "sampled"}) {
        folders_.write(fmt::format("b/evaluations/{}/protocol.json", way),
                       R"({"games": 1, "choice": "any"})");
        folders_.write(fmt::format("b/evaluations/{}/step_000000100.csv", way), game);
    }
    ComparisonConfig config = kQuick;
    config.group_by = {"agent"};
    config.score = ScoreKind::evaluation;
    const auto lines = lines_of(compared({}, config).notes);
    EXPECT_THAT(lines,
                Contains(testing::MatchesRegex("Groups .* were evaluated in different ways .*: sac\\.")));
    EXPECT_THAT(lines, Contains(HasSubstr("greedy counts, not sampled (1 run)")));
    config.score = ScoreKind::training;
    EXPECT_THAT(lines_of(compared({}, config).notes), Not(Contains(HasSubstr("evaluated"))));
}

TEST_F(Comparing, RunsOfDifferentLengthsInAGroupAreNamed) {
    folders_.run("a", "sac", "Pong", 1, {-20}, "train: {total_steps: 100}\n");
    folders_.run("b", "sac", "Pong", 2, {-20, -19}, "train: {total_steps: 200}\n");
    ComparisonConfig config = kQuick;
    config.group_by = {"agent"};
    EXPECT_THAT(lines_of(compared({}, config).notes),
                Contains("Groups have runs of different lengths, in agent steps: 100 / 200 (sac)."));
}

TEST_F(Comparing, TheBestMeanIsBoldUnlessAllShareIt) {
    for (const auto* game : {"Pong", "Boxing"}) {
        folders_.run(fmt::format("a_{}", game), "sac", game, 1, {1});
        folders_.run(fmt::format("b_{}", game), "dqn", game, 1, {game == std::string("Pong") ? 1.0 : 0.5});
    }
    const auto table = game_table(compared());
    const auto bold = [&](std::size_t row) { return std::ranges::count(table.best.at(row), true); };
    EXPECT_THAT(table.rows.at(0).front(), "Boxing");
    EXPECT_EQ(bold(0), 1);
    EXPECT_TRUE(table.best[0].back()) << "sac";
    EXPECT_EQ(bold(1), 0);
}

TEST_F(Comparing, BaselinesHaveOneColumnEach) {
    const auto csv = folders_.write("table.csv", "game,mine,mine\nPong,1,2\n");
    EXPECT_THAT([&] { read_baselines(read_csv_by_hand(csv), {"mine"}); },
                testing::ThrowsMessage<std::runtime_error>(
                    HasSubstr("table.csv: two columns are called 'mine'; rename one")));
}

TEST_F(Comparing, BaselinesNeedAllTheGames) {
    folders_.run("a", "sac", "Pong", 1, {-20});
    folders_.run("b", "sac", "Boxing", 1, {1});
    const auto csv = folders_.write("table.csv",
                                    "game,cale60,whole,half\nPong,1,14.6,3\nms_pacman,1,5,\n"
                                    "Boxing,1,12.1,\n\nDefender,0,9,9");  // as a person may leave it
    const auto comparison = compared(read_baselines(read_csv_by_hand(csv), {"whole", "half"}));
    ASSERT_THAT(comparison.baselines, SizeIs(1));
    EXPECT_EQ(comparison.baselines[0].baseline.name, "whole");
    for (const auto metric : {Metric::iqm, Metric::median, Metric::mean})
        EXPECT_NEAR(comparison.baselines[0].aggregates[static_cast<std::size_t>(metric)].value, 1, 1e-12);
    ASSERT_THAT(comparison.left_out_baselines, SizeIs(1));
    EXPECT_THAT(comparison.left_out_baselines[0].why, HasSubstr("no score for Boxing"));
    const auto twice = folders_.write("twice.csv", "game,mine\nPong,3\nBoxing,1\nPong,21\n");
    try {
        read_baselines(read_csv_by_hand(twice), {"mine"});
        FAIL();
    } catch (const std::runtime_error& error) {
        EXPECT_EQ(error.what(),
                  twice.string() + ": line 4 has Pong again: a table of scores has a game once");
    }
    const auto by_hand = folders_.write("by_hand.csv", "game, mine\nPong, 3\nSurround, 4\n");
    EXPECT_EQ(read_baselines(read_csv_by_hand(by_hand), {"mine"}).at(0).scores.at("Pong"), 3);
    for (const auto& [row, sentence] : {std::pair{"Pnog,3", ": line 2: there is no game 'Pnog'"},
                                        {"Pong,1e308", "line 2 has a score of 1e+308"}}) {
        const auto bad = folders_.write("bad.csv", fmt::format("game,mine\n{}\n", row));
        try {
            read_baselines(read_csv_by_hand(bad), {"mine"});
            FAIL();
        } catch (const std::runtime_error& error) {
            EXPECT_THAT(error.what(), HasSubstr(sentence));
        }
    }
    try {
        read_baselines(read_csv_by_hand(csv), {"cale60"});
        FAIL();
    } catch (const std::invalid_argument& error) {
        EXPECT_EQ(error.what(),
                  "--baselines cale60: " + csv.string() + " has no such column; the nearest are half, whole");
    }
}

TEST_F(Comparing, ComparesEveryPairOnce) {
    for (const auto* agent : {"a", "b", "c"})
        for (const int seed : {1, 2})
            folders_.run(fmt::format("{}{}", agent, seed), agent, "Pong", static_cast<std::uint64_t>(seed),
                         {agent[0] == 'b' ? 20.0 + seed : -20.0});
    const auto comparison = compared();
    ASSERT_THAT(comparison.improvements, SizeIs(3));
    EXPECT_DOUBLE_EQ(comparison.improvements[0].probability.value, 0) << "a over b";
    EXPECT_DOUBLE_EQ(comparison.improvements[1].probability.value, 0.5) << "a over c";
    EXPECT_DOUBLE_EQ(comparison.improvements[2].probability.value, 1) << "b over c";
    EXPECT_DOUBLE_EQ(comparison.thresholds.front(), 0);
    EXPECT_DOUBLE_EQ(comparison.thresholds.back(), 1.5);
    EXPECT_DOUBLE_EQ(comparison.thresholds.at(29), 0.29) << "a hundred of a human score";
}

TEST_F(Comparing, TablesHoldEveryNumber) {
    folders_.run("a", "sac", "Pong", 1, {-20.7}, "agent: {encoder: phi_sac, gamma: 1}\n");
    folders_.run("b", "sac", "Pong", 2, {14.6}, "agent: {encoder: phi_sac, gamma: 1}\n");
    folders_.run("c", "sac", "Pong", 1, {14.6}, "agent: {encoder: phi_dqn, gamma: 2}\n");
    ComparisonConfig config = kQuick;
    config.group_by = {"encoder", "gamma"};  // labels with a comma
    const auto comparison = compared({}, config);
    for (const auto& [name, text] : csv_files(comparison)) folders_.write("csv/" + name, text);
    const auto scores = folders_.path() / "csv/scores.csv";
    std::ifstream file(scores);
    std::string line;
    std::getline(file, line);
    EXPECT_EQ(line, "group,agent,game,seed,step,games_in_score,score,human_normalized,folder");
    std::getline(file, line);
    EXPECT_EQ(line, fmt::format("\"phi_dqn, gamma=2\",sac,Pong,1,100,1,14.6,1,{}",
                                (folders_.path() / "c").string()));
    EXPECT_TRUE(std::filesystem::exists(folders_.path() / "csv/aggregates.csv"));
    EXPECT_TRUE(std::filesystem::exists(folders_.path() / "csv/probability_of_improvement.csv"));
    EXPECT_FALSE(std::filesystem::exists(folders_.path() / "csv/events.csv")) << "there are none";
    const auto text = to_text(aggregate_table(comparison));
    EXPECT_THAT(text, HasSubstr("phi_dqn, gamma=2  1.000"));
    EXPECT_THAT(text, HasSubstr("0.500 [0.000, 1.000]"));
}

TEST_F(Comparing, SaysWhatIsMissingBeforeAnyFigure) {
    folders_.run("a1", "sac", "Pong", 1, {-20});
    folders_.run("a2", "sac", "Pong", 2, {-20});
    folders_.run("a3", "sac", "Boxing", 1, {2});
    folders_.run("b1", "dqn", "Pong", 1, {-20});
    folders_.run("b2", "dqn", "Pong", 2, {1e308});
    const auto comparison = compared();
    EXPECT_FALSE(comparison.is_complete());
    const auto lines = lines_of(comparison.notes);
    EXPECT_THAT(lines, Contains("4 runs are missing:"));
    for (const auto* missing : {"sac on Boxing, seed 2", "dqn on Boxing, seed 1", "dqn on Pong, seed 2"})
        EXPECT_THAT(lines, Contains(missing));
    EXPECT_THAT(lines, Contains("1 run is left out, as what is in the folder cannot be used:"));
    EXPECT_THAT(lines, Contains(HasSubstr("b2/episodes.csv is damaged: line 3")));
    EXPECT_THAT(lines, Contains("Games that are not in the aggregates:"));
    EXPECT_THAT(lines, Contains("Boxing: no run of dqn"));
    EXPECT_THAT(comparison.results, SizeIs(2)) << "the rest is compared";
}

TEST_F(Comparing, MissingRunsAreNamedByTheGroupsOfTheReport) {
    for (const auto* rate : {"1", "2"})
        for (const std::uint64_t seed : {1, 2})
            folders_.run(fmt::format("{}_{}", rate, seed), "sac", "Pong", seed, {-20},
                         fmt::format("agent: {{rate: {}}}\n", rate));
    std::filesystem::remove_all(folders_.path() / "2_2");
    ComparisonConfig config = kQuick;
    config.names = {{"rate=2", "fast"}};
    EXPECT_THAT(compared({}, config).missing_runs, ElementsAre("fast on Pong, seed 2"));
    config = kQuick;
    config.group_by = {"agent"};
    EXPECT_THAT(compared({}, config).missing_runs, IsEmpty()) << "one group has been trained with every seed";
}

TEST_F(Comparing, RunsOfAGameAndASeedThatAGroupPoolsAreNamed) {
    for (const auto* rate : {"1", "2"})
        folders_.run(rate, "sac", "Pong", 1, {-20}, fmt::format("agent: {{rate: {}, tau: 1}}\n", rate));
    folders_.run("other", "sac", "Pong", 2, {-20}, "agent: {rate: 1, tau: 2}\n");
    ComparisonConfig config = kQuick;
    config.group_by = {"agent"};
    EXPECT_THAT(
        lines_of(compared({}, config).notes),
        Contains("Groups hold runs of the same game and seed that differ in settings, and count them as "
                 "if they were of several seeds: sac (agent.rate)."));
    EXPECT_THAT(lines_of(compared().notes), Not(Contains(HasSubstr("of the same game and seed"))));
}

TEST_F(Comparing, CellsOfTablesAreOneLineAndNoMarkUp) {
    const Table table{.header = {"a|b"}, .rows = {{"one\ntwo ~~x~~"}}};
    EXPECT_THAT(to_markdown(table), HasSubstr("| one\\\\x0atwo \\~\\~x\\~\\~ |"));
    EXPECT_THAT(to_latex(table), HasSubstr("a$|$b"));
}

TEST_F(Comparing, AWholeGridIsComplete) {
    for (const auto* agent : {"sac", "dqn"})
        for (const std::uint64_t seed : {1, 2})
            folders_.run(fmt::format("{}{}", agent, seed), agent, "Pong", seed, {-20});
    EXPECT_TRUE(compared().is_complete());
    folders_.run("again", "sac", "Pong", 1, {-20});
    EXPECT_TRUE(compared().is_complete()) << "a run that is there twice is not missing";
    folders_.run("sac1", "sac", "Pong", 1, {-20}, "train: {total_steps: 9000}\n");
    EXPECT_FALSE(compared().is_complete());
}

TEST_F(Comparing, SaysWhichSettingsRunsOfAnotherVersionLack) {
    folders_.run("a1", "sac", "Pong", 1, {-20}, "agent: {encoder: phi_sac}\n");
    folders_.run("a2", "sac", "Pong", 2, {-20}, "agent: {encoder: phi_sac, padding: same}\n");
    folders_.run("b1", "dqn", "Pong", 1, {-20}, "agent: {encoder: phi_sac}\n");
    EXPECT_THAT(labels_of(compared()), ElementsAre("dqn", "sac, no padding", "sac, same"));
    EXPECT_THAT(lines_of(compared().notes), Contains("sac: agent.padding"));
    ComparisonConfig config = kQuick;
    config.group_by = {"agent"};
    EXPECT_THAT(lines_of(compared({}, config).notes), Not(Contains("sac: agent.padding")));
}

TEST_F(Comparing, AllOfATieAreBold) {
    for (const std::uint64_t seed : {1, 2, 3}) {
        folders_.run(fmt::format("a{}", seed), "a", "Pong", seed, {0.1 * static_cast<double>(seed)});
        folders_.run(fmt::format("b{}", seed), "b", "Pong", seed, {0.1 * static_cast<double>(4 - seed)});
        folders_.run(fmt::format("c{}", seed), "c", "Pong", seed, {-1});
    }
    const auto table = game_table(compared());
    EXPECT_THAT(table.header, ElementsAre("game", "random (published)", "human", "a", "b", "c"));
    EXPECT_THAT(table.best.at(0), ElementsAre(false, false, false, true, true, false));
}

TEST_F(Comparing, JoystickRunsComeWithTheFloorOfTheJoystick) {
    const std::string rules =
        "env: {{action_space: {}, sticky_probability: {}, terminal_on_life_loss: {}}}\n";
    folders_.run("a", "sac", "KungFuMaster", 1, {500},
                 fmt::format(fmt::runtime(rules), "continuous", 0.25, false));
    folders_.run("b", "der", "KungFuMaster", 1, {700}, fmt::format(fmt::runtime(rules), "minimal", 0, true));
    const auto comparison = compared();
    ASSERT_THAT(comparison.random_floors, SizeIs(2));
    EXPECT_EQ(comparison.random_floors[0].name, kPublishedRandom);
    EXPECT_EQ(comparison.random_floors[0].scores.at("KungFuMaster"), 258.5);
    EXPECT_EQ(comparison.random_floors[1].name, "random joystick (200m)");
    EXPECT_EQ(comparison.random_floors[1].scores.at("KungFuMaster"),
              joystick_random("KungFuMaster", "200m").mean);
    EXPECT_THAT(game_table(comparison).header,
                ElementsAre("game", "random (published)", "random joystick (200m)", "human", "der", "sac"));
    EXPECT_NEAR(comparison.results[1].scores.at(0).at(0), (500 - 258.5) / (22736.3 - 258.5), 1e-9)
        << "normalised with the published score all the same";
    const auto setup = setup_table(comparison);
    EXPECT_THAT(setup.rows.at(0),
                ElementsAre("der", "der", "Atari 100k", "discrete, minimal", "unknown", "1", "1", "1"));
    EXPECT_THAT(setup.rows.at(1), ElementsAre("sac", "sac", "200M frames", "joystick, threshold 0.5",
                                              "unknown", "1", "1", "1"));
}

TEST_F(Comparing, FactoredJoysticksHaveTheFloorOfTheEvents) {
    folders_.run("a", "der", "KungFuMaster", 1, {500},
                 "env: {action_space: continuous, joystick: factored, sticky_probability: 0}\n");
    const auto comparison = compared();
    ASSERT_THAT(comparison.random_floors, SizeIs(1));
    EXPECT_EQ(comparison.random_floors[0].name, kPublishedRandom);
}

TEST(Tables, AreLatexToo) {
    const Table table{
        .header = {"group", "a_b"}, .rows = {{"50 %", "-0.5 [-0.6, 1]"}}, .best = {{false, true}}};
    EXPECT_EQ(to_latex(table),
              "% \\usepackage{booktabs}\n\\begin{tabular}{lr}\n\\toprule\ngroup & a\\_b \\\\\n\\midrule\n"
              "50 \\% & \\textbf{$-$0.5 [$-$0.6, 1]} \\\\\n\\bottomrule\n\\end{tabular}\n");
}

TEST(Tables, ANameInBracketsIsNoOptionOfLatex) {
    const Table table{.header = {"group"}, .rows = {{"[1] SAC"}}};
    EXPECT_THAT(to_latex(table), testing::HasSubstr("\n{[}1] SAC \\\\\n"));
}

TEST(Tables, AreMarkdownToo) {
    const Table table{
        .header = {"group", "a_b"}, .rows = {{"x | y", "-0.5 [-0.6, 1]"}}, .best = {{false, true}}};
    EXPECT_EQ(to_markdown(table), "| group | a\\_b |\n|---|---:|\n| x \\| y | **-0.5 [-0.6, 1]** |\n");
}

TEST(Csv, AFolderIsNoTable) {
    EXPECT_THAT([] { read_whole_csv("/tmp"); },
                testing::ThrowsMessage<std::runtime_error>("cannot read '/tmp': Is a directory"));
}

TEST(Csv, QuotesWhatNeedsIt) {
    EXPECT_EQ(csv_line({"", "a", "b,c", "d\"e"}), ",a,\"b,c\",\"d\"\"e\"\n");
}

TEST(RequireRuns, NamesWhyEachOfAFewRunsCannotBeUsed) {
    FoundRuns found;
    for (const auto* run : {"a", "b", "c", "d", "e"})
        found.left_out.push_back({run, std::string("of ") + run});
    try {
        require_runs(found);
        FAIL();
    } catch (const std::runtime_error& error) {
        EXPECT_STREQ(error.what(), "none of the 5 runs can be used; a: of a; b: of b; c: of c; 2 more");
    }
}

TEST_F(Comparing, OfNothingIsRefused) {
    EXPECT_THROW(compared(), std::exception);
}

TEST_F(Comparing, SaysWhichGroupsHaveUnequalNumbersOfRuns) {
    folders_.run("a1", "sac", "Pong", 1, {-20});
    folders_.run("a2", "sac", "Boxing", 1, {1});
    EXPECT_THAT(lines_of(compared().notes), Not(Contains(HasSubstr("unequal"))));
    folders_.run("a3", "sac", "Pong", 2, {-20});
    EXPECT_THAT(lines_of(compared().notes),
                Contains(testing::EndsWith("games with more count more: sac (1 to 2).")));
}

}  // namespace
}  // namespace cale
