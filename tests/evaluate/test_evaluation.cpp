#include "evaluate/evaluation.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/sac.h"
#include "agents/sacd.h"
#include "cale/random_play.h"
#include "evaluate/evaluation_progress.h"
#include "evaluate/evaluation_report.h"
#include "evaluate/policy_evaluation.h"
#include "storage/files.h"
#include "support/temporary_folder.h"
#include "support/working_folder.h"
#include "terminal/console.h"
#include "train/export.h"
#include "train/program.h"

namespace cale {
namespace {

using test::TemporaryFolder;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

/// Chooses by what it sees alone: a number between 0 and 1 for each row.
torch::Tensor numbers_of(const torch::Tensor& observations) {
    const auto sums = observations.to(torch::kFloat64).flatten(1).cumsum(1).sum(1);
    return (sums * 0.618034e-3).remainder(1.0);
}

Decide by_sight() {
    return [](const torch::Tensor& observations, std::span<const std::int64_t>) {
        const auto u = numbers_of(observations);
        const auto theta = 6.28 * (u * 17).remainder(1.0) - 3.14;
        return Chosen{.actions = torch::stack({torch::ones_like(u), theta, u}, 1).to(torch::kFloat32)};
    };
}

EvaluationPlan short_games() {
    EvaluationPlan plan{.env = protocol_200m("breakout"), .games = 4, .epsilon = 0.2};
    plan.env.max_frames_per_episode = 200;
    plan.env.noop_max = 10;
    return plan;
}

std::vector<std::vector<double>> rows(const Evaluation& evaluation) {
    std::vector<std::vector<double>> result;
    for (const auto& game : evaluation.games) {
        std::vector<double> row{game.episode_return, static_cast<double>(game.length),
                                static_cast<double>(game.frames)};
        row.insert(row.end(), game.events.begin(), game.events.end());
        for (const auto& [reward, count] : game.rewards)
            row.insert(row.end(), {reward, static_cast<double>(count)});
        result.push_back(row);
    }
    return result;
}

TEST(EvaluationEmulator, AGameDoesNotDependOnThoseBesideIt) {
    auto plan = short_games();
    const auto one_by_one = rows(evaluate(by_sight(), plan));
    ASSERT_EQ(one_by_one.size(), 4u);
    EXPECT_GT(std::set(one_by_one.begin(), one_by_one.end()).size(), 2u);  // the games are different ones
    for (const std::int64_t parallel : {3, 16}) {
        plan.parallel = parallel;
        EXPECT_EQ(rows(evaluate(by_sight(), plan)), one_by_one) << parallel;
    }
    plan.games = 2;  // nor on how many follow
    EXPECT_THAT(rows(evaluate(by_sight(), plan)), ElementsAre(one_by_one[0], one_by_one[1]));
    plan.seed = 2;
    EXPECT_NE(rows(evaluate(by_sight(), plan))[0], one_by_one[0]);
}

TEST(EvaluationEmulator, ItsMeanAndItsDeviationAreThoseOfItsGames) {
    auto plan = short_games();
    plan.games = 6;
    plan.env.max_frames_per_episode = 2000;
    const auto result = evaluate(by_sight(), plan);
    double sum = 0, squares = 0;
    for (const auto& game : result.games) {
        sum += game.episode_return;
        squares += game.episode_return * game.episode_return;
    }
    ASSERT_GT(sum, 0);
    EXPECT_DOUBLE_EQ(result.mean_return, sum / 6);
    EXPECT_NEAR(result.standard_deviation, std::sqrt(squares / 6 - sum * sum / 36), 1e-9);
    EXPECT_GT(result.standard_deviation, 0);
}

TEST(Evaluation, ThePlansOfBothProtocols) {
    auto env = protocol_200m("breakout");
    env.noop_max = 7;
    const auto episodes = fixed_episodes(env);
    EXPECT_EQ(episodes.games, 100);
    EXPECT_EQ(episodes.epsilon, 0.001);
    EXPECT_EQ(episodes.env.noop_max, 29);
    EXPECT_EQ(episodes.steps, EvaluationPlan{}.steps);
    const auto steps = fixed_steps(env);
    EXPECT_EQ(steps.steps, 125'000);
    EXPECT_EQ(steps.epsilon, 0.001);
    EXPECT_EQ(steps.env.noop_max, 7);
    EXPECT_EQ(steps.games, kNoLimit);
}

TEST(EvaluationEmulator, AsksForGamesUnderWayAlone) {
    auto plan = short_games();
    plan.parallel = 3;
    std::vector<std::size_t> asked;
    const auto decide = by_sight();
    evaluate(
        [&](const torch::Tensor& observations, std::span<const std::int64_t> games) {
            EXPECT_EQ(observations.sizes()[0], std::ssize(games));
            EXPECT_EQ(std::set(games.begin(), games.end()).size(), games.size());
            asked.push_back(games.size());
            return decide(observations, games);
        },
        plan);
    EXPECT_EQ(asked.front(), 3u);
    EXPECT_LT(asked.back(), 3u);  // one game is left for the last round
}

TEST(EvaluationEmulator, FixedStepsEndsWithTheGameThatReachesThem) {
    auto plan = short_games();
    plan.env.noop_max = 0;  // a game is cut off after some 50 agent steps
    plan.games = kNoLimit;
    plan.steps = 120;
    const auto alone = evaluate(by_sight(), plan);
    std::int64_t before = 0;
    for (std::size_t i = 0; i + 1 < alone.games.size(); ++i) before += alone.games[i].length;
    EXPECT_LT(before, 120);
    EXPECT_GE(before + alone.games.back().length, 120);
    plan.parallel = 8;
    const auto together = evaluate(by_sight(), plan);
    EXPECT_EQ(rows(together), rows(alone));
    EXPECT_EQ(together.events, alone.events);
}

TEST(EvaluationEmulator, FixedStepsPlaysNoGameToItsEndThatDoesNotCount) {
    auto plan = short_games();
    plan.env.noop_max = 0;
    plan.games = kNoLimit;
    plan.steps = 60;
    plan.parallel = 8;
    std::vector<std::int64_t> ended;
    plan.ended = [&](std::int64_t number, const EvaluatedGame&) { ended.push_back(number); };
    EXPECT_EQ(evaluate(by_sight(), plan).games.size(), 2u);
    EXPECT_THAT(ended, testing::UnorderedElementsAre(0, 1));
}

TEST(EvaluationEmulator, GamesThatAreKnownAreNotPlayedAgain) {
    for (const bool by_steps : {false, true}) {
        auto plan = short_games();
        plan.games = by_steps ? kNoLimit : 5;
        if (by_steps) plan.steps = 160;
        std::map<std::int64_t, EvaluatedGame> all;
        plan.ended = [&](std::int64_t number, const EvaluatedGame& game) { all[number] = game; };
        const auto whole = rows(evaluate(by_sight(), plan));
        ASSERT_GE(all.size(), 3u);
        plan.parallel = 2;
        std::set<std::int64_t> played;
        std::int64_t steps = 0, steps_of_games = 0;
        plan.ended = [&](std::int64_t number, const EvaluatedGame& game) {
            played.insert(number);
            steps_of_games += game.length;
        };
        plan.stepped = [&](std::int64_t count) { steps += count; };
        // A killed evaluation: 1 and 2 had ended, 0 had not.
        plan.known = {{1, all[1]}, {2, all[2]}};
        EXPECT_EQ(rows(evaluate(by_sight(), plan)), whole) << by_steps;
        EXPECT_FALSE(played.contains(1) || played.contains(2));
        EXPECT_TRUE(played.contains(0));
        EXPECT_EQ(steps, steps_of_games);
        plan.known = all;
        played.clear();
        EXPECT_EQ(rows(evaluate(by_sight(), plan)), whole);
        EXPECT_TRUE(played.empty());
    }
}

TEST(EvaluationEmulator, WritesALinePerGameWhereThereIsNoTerminal) {
    auto plan = short_games();
    plan.parallel = 2;
    plan.known[2] = {.episode_return = 6, .length = 50};
    std::vector<std::int64_t> ended;
    plan.ended = [&](std::int64_t number, const EvaluatedGame&) { ended.push_back(number); };
    std::FILE* const file = std::tmpfile();
    Console console(file);
    EvaluationProgress progress(console, plan, "run 1/2");
    const auto evaluation = evaluate(by_sight(), plan);
    EXPECT_EQ(ended.size(), 3u) << "the callback that the plan had is called too";
    std::rewind(file);
    std::string text;
    for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) text.push_back(static_cast<char>(c));
    std::fclose(file);
    EXPECT_EQ(std::ranges::count(text, '\n'), 3) << "those that were played";
    EXPECT_THAT(text, StartsWith("run 1/2  2/4 games  return "));
    EXPECT_THAT(text, HasSubstr("\nrun 1/2  4/4 games  return "));
    EXPECT_THAT(text, HasSubstr(fmt::format("  mean return {:.1f}", evaluation.mean_return)));
}

TEST(EvaluationEmulator, EpsilonIsThePartOfRandomActions) {
    auto plan = short_games();
    plan.games = 2;
    plan.env.max_frames_per_episode = 1000;
    const auto always_left = [](const torch::Tensor& observations, std::span<const std::int64_t>) {
        return Chosen{.actions = torch::tensor({1.0F, 3.14F, 0.0F}).repeat({observations.size(0), 1})};
    };
    const auto left = static_cast<std::size_t>(Event::left);
    plan.epsilon = 0;
    const auto never = evaluate(always_left, plan);
    EXPECT_EQ(never.events[left], std::accumulate(never.events.begin(), never.events.end(), std::int64_t{0}));
    plan.epsilon = 0.5;
    const auto half = evaluate(always_left, plan);
    const auto steps = std::accumulate(half.events.begin(), half.events.end(), std::int64_t{0});
    // A random action is LEFT too now and then.
    EXPECT_NEAR(static_cast<double>(half.events[left]) / static_cast<double>(steps), 0.5 + 0.5 * 0.07, 0.08);
    plan.env.action_space = ActionSet::minimal;
    const auto always_last = [](const torch::Tensor& observations, std::span<const std::int64_t>) {
        return Chosen{.actions = torch::full({observations.size(0)}, 3, torch::kInt64)};
    };
    plan.epsilon = 1;
    const auto random = evaluate(always_last, plan);
    for (const Event event : {Event::noop, Event::fire, Event::right, Event::left})
        EXPECT_GT(random.events[static_cast<std::size_t>(event)], steps / 8) << event_name(event);
}

TEST(EvaluationEmulator, ALostLifeClearsTheStackAndDoesNotEndTheGame) {
    for (const bool life_loss : {true, false}) {
        EvaluationPlan plan{.env = protocol_atari100k("breakout"), .games = 1};
        plan.env.terminal_on_life_loss = life_loss;
        int blank = 0;
        const auto fire = [&](const torch::Tensor& observations, std::span<const std::int64_t>) {
            if (observations.slice(1, 0, 3).sum().item<std::int64_t>() == 0) ++blank;
            return Chosen{.actions = torch::tensor({{0.0F, 0.0F, 1.0F}})};
        };
        evaluate(fire, plan);
        EXPECT_EQ(blank, life_loss ? 5 : 1);  // the game has five lives
    }
}

TEST(Evaluation, ALostLifeDoesToAPolicysInputsWhatItDidInTraining) {
    for (const bool trained : {true, false}) {
        PolicyInfo policy;
        policy.life_loss_ends_episode = trained;
        EnvConfig env;
        env.terminal_on_life_loss = trained;
        EXPECT_EQ(keep_life_loss(policy, env), "");
        EXPECT_EQ(env.terminal_on_life_loss, trained);
        env.terminal_on_life_loss = !trained;
        EXPECT_EQ(keep_life_loss(policy, env),
                  trained ? "env.terminal_on_life_loss=false is not applied: as in this policy's training "
                            "(true), a lost life clears its frame stack; no game ends with a life"
                          : "env.terminal_on_life_loss=true is not applied: as in this policy's training "
                            "(false), a lost life does not clear its frame stack; no game ends with a life");
        EXPECT_EQ(env.terminal_on_life_loss, trained);
    }
}

TEST(EvaluationEmulator, FilmsTheGameThatIsAskedFor) {
    const TemporaryFolder folder;
    auto plan = short_games();
    plan.games = 2;
    plan.parallel = 2;
    plan.video = folder.path() / "game.mp4";
    plan.filmed_game = 1;
    const auto decide = [](const torch::Tensor& observations, std::span<const std::int64_t> games) {
        auto chosen = by_sight()(observations, games);
        chosen.values = torch::ones({observations.size(0)});
        return chosen;
    };
    evaluate(decide, plan);
    EXPECT_GT(std::filesystem::file_size(plan.video), 1000u);
    const auto whole = std::filesystem::file_size(plan.video);
    plan.film_minutes = 0.005;
    evaluate(decide, plan);
    EXPECT_LT(std::filesystem::file_size(plan.video), whole / 2);
    const auto film_of = [&](std::int64_t number) {
        plan.filmed_game = number;
        evaluate(decide, plan);
        return read_file(plan.video);
    };
    EXPECT_TRUE(film_of(1) == film_of(1));
    EXPECT_FALSE(film_of(1) == film_of(0));
}

TEST(EvaluationEmulator, StopsWithTheGamesBeforeTheFirstThatHasNotEnded) {
    const TemporaryFolder folder;
    auto plan = short_games();
    plan.games = 4;
    plan.parallel = 1;
    const auto whole = evaluate(by_sight(), plan);
    EXPECT_FALSE(whole.interrupted);
    plan.video = folder.path() / "game.mp4";
    plan.filmed_game = 2;
    const auto steps_of_two = whole.games[0].length + whole.games[1].length;
    std::int64_t steps = 0;
    plan.stop = [&] { return steps++ == steps_of_two + 3; };
    const auto some = evaluate(by_sight(), plan);
    EXPECT_TRUE(some.interrupted);
    ASSERT_EQ(some.games.size(), 2u);
    EXPECT_EQ(some.mean_return, (whole.games[0].episode_return + whole.games[1].episode_return) / 2);
    EXPECT_GT(std::filesystem::file_size(plan.video), 1000u) << "the film ends where the game was stopped";

    plan.parallel = 4;
    plan.stop = [] { return true; };
    EXPECT_TRUE(evaluate(by_sight(), plan).games.empty());
}

TEST(EvaluationEmulator, RefusesActionsOfAnotherKind) {
    const auto plan = short_games();
    const auto discrete = [](const torch::Tensor& observations, std::span<const std::int64_t>) {
        return Chosen{.actions = torch::zeros({observations.size(0)}, torch::kInt64)};
    };
    EXPECT_THAT([&] { evaluate(discrete, plan); },
                testing::ThrowsMessage<std::invalid_argument>(HasSubstr("continuous actions were expected")));
    const auto one_value = [](const torch::Tensor& observations, std::span<const std::int64_t>) {
        return Chosen{.actions = torch::full({observations.size(0), 3}, 0.5), .values = torch::zeros({7})};
    };
    EXPECT_THAT([&] { evaluate(one_value, plan); },
                testing::ThrowsMessage<std::invalid_argument>(HasSubstr("values were expected, but got: 7")));
}

/// Five games with known results.
Evaluation known() {
    Evaluation evaluation;
    for (const double value : {10.0, 2.0, 4.0, 100.0, 4.0})
        evaluation.games.push_back({.episode_return = value, .length = 7, .frames = 28});
    evaluation.mean_return = 24;
    evaluation.standard_deviation = 38.1;
    evaluation.events[static_cast<std::size_t>(Event::fire)] = 35;
    evaluation.rewards = {{-1.0F, 1}, {0.0F, 30}, {5.0F, 4}};
    return evaluation;
}

TEST(Evaluation, SummarisesReturns) {
    const auto summary = summarise(known(), "breakout");
    EXPECT_EQ(summary.mean, 24);
    EXPECT_EQ(summary.median, 4);
    EXPECT_EQ(summary.interquartile_mean, 6);  // of 4, 4 and 10
    EXPECT_EQ(summary.minimum, 2);
    EXPECT_EQ(summary.maximum, 100);
    EXPECT_NEAR(summary.human_normalised.value(), (24 - 1.7) / (30.5 - 1.7), 1e-12);
    EXPECT_FALSE(summarise(known(), "air_raid").human_normalised.has_value());
    auto even = known();
    even.games.pop_back();
    EXPECT_EQ(summarise(even, "pong").median, 7);
    EXPECT_THROW(summarise({}, "pong"), std::invalid_argument);
}

TEST(Evaluation, QuantilesOfRewardsCountAgentSteps) {
    const auto rewards = known().rewards;  // 35 steps
    EXPECT_EQ(reward_quantile(rewards, 0), -1);
    EXPECT_EQ(reward_quantile(rewards, 1.0 / 35), -1);
    EXPECT_EQ(reward_quantile(rewards, 0.03), 0);
    EXPECT_EQ(reward_quantile(rewards, 31.0 / 35), 0);
    EXPECT_EQ(reward_quantile(rewards, 0.89), 5);
    EXPECT_EQ(reward_quantile(rewards, 1), 5);
    EXPECT_EQ(reward_quantile({{-1.0f, 7}, {0.0f, 93}}, 0.07), -1);
    EXPECT_THROW(reward_quantile({}, 0.5), std::invalid_argument);
}

TEST(Evaluation, WritesThreeTables) {
    const TemporaryFolder folder;
    write_evaluation(folder.path() / "eval" / "step_1.csv", known());
    EXPECT_THAT(folder.read("eval/step_1.csv"),
                StartsWith("episode,return,length,frames\n0,10,7,28\n1,2,7,28\n"));
    const auto events = folder.read("eval/step_1_events.csv");
    EXPECT_THAT(events, StartsWith("event,count\nNOOP,0\nFIRE,35\nUP,0\n"));
    EXPECT_EQ(std::count(events.begin(), events.end(), '\n'), 19);
    const auto rewards = folder.read("eval/step_1_rewards.csv");
    EXPECT_THAT(rewards, StartsWith("quantile,reward\n0,-1\n0.01,-1\n0.02,-1\n0.03,0\n"));
    EXPECT_THAT(rewards, HasSubstr("\n0.89,5\n"));
    EXPECT_EQ(std::count(rewards.begin(), rewards.end(), '\n'), 102);
}

TEST(Evaluation, ATableBesideTheProgramNeedsNoFolder) {
    const TemporaryFolder folder;
    const test::WorkingFolder here(folder.path());
    write_evaluation("step_1.csv", known());
    EXPECT_THAT(folder.read("step_1.csv"), StartsWith("episode,return,length,frames\n0,10,7,28\n"));
}

/// A run of a few steps with its real network, and its policy.
template <class Config>
Policy trained(const std::string& agent, std::unique_ptr<Agent> (*make)(const Config&, const AgentSpec&),
               const std::filesystem::path& run, std::vector<std::string> settings = {}) {
    std::vector<std::string> words = {"train_" + agent,
                                      "--run-dir",
                                      run.string(),
                                      "--threads",
                                      "1",
                                      "--no-progress",
                                      "env.game=breakout",
                                      "train.total_steps=4",
                                      "eval.episodes=0",
                                      "log.tensorboard=false"};
    words.insert(words.end(), settings.begin(), settings.end());
    std::vector<const char*> argv;
    for (const auto& word : words) argv.push_back(word.c_str());
    testing::internal::CaptureStderr();
    const int code = run_program(agent, "Trains.", make, static_cast<int>(argv.size()), argv.data());
    const auto said = testing::internal::GetCapturedStderr();
    EXPECT_EQ(code, 0) << said;
    return policy_of(run);
}

TEST(PolicyEvaluationEmulator, ARowIsChosenWithoutTheRowsBesideIt) {
    const TemporaryFolder folder;
    for (const std::string encoder : {"phi_sac", "phi_dqn", "impala"}) {
        const auto policy = trained("sac", make_sac, folder.path() / encoder,
                                    {"agent.encoder=" + encoder, "agent.replay_capacity=1000"});
        torch::manual_seed(1);
        const auto observations = torch::randint(0, 256, {11, 4, 84, 84}, torch::kUInt8);
        std::vector<std::int64_t> games(11);
        std::iota(games.begin(), games.end(), std::int64_t{0});
        const auto together = decide_by(policy, false, 1)(observations, games).actions;
        ASSERT_EQ(together.sizes(), (std::vector<std::int64_t>{11, 3}));
        for (const std::int64_t row : {0, 6, 7, 8, 10}) {
            const auto alone =
                decide_by(policy, false, 1)(observations.narrow(0, row, 1), {&games[0], 1}).actions;
            EXPECT_TRUE(torch::equal(alone[0], together[row])) << encoder << " row " << row;
        }
    }
}

TEST(PolicyEvaluationEmulator, TellsTheValuesOfAnAgentThatLearnsThem) {
    const TemporaryFolder folder;
    const auto observations = torch::randint(0, 256, {3, 4, 84, 84}, torch::kUInt8);
    const std::vector<std::int64_t> games = {0, 1, 2};
    const auto dqn = trained("dqn", make_dqn, folder.path() / "dqn", {"agent.replay_capacity=1000"});
    const auto chosen = decide_by(dqn, false, 1)(observations, games);
    EXPECT_TRUE(torch::equal(chosen.actions, dqn.act(observations)));
    EXPECT_TRUE(torch::allclose(chosen.values, std::get<0>(dqn.output(observations).max(1)), 1e-4, 1e-5));
    const auto ppo = trained("ppo", make_ppo, folder.path() / "ppo", {"env.action_space=minimal"});
    EXPECT_FALSE(decide_by(ppo, false, 1)(observations, games).values.defined());
}

TEST(PolicyEvaluationEmulator, EveryAgentLearnsFromTheMemoryAndIsEvaluatedOnIt) {
    const TemporaryFolder folder;
    const std::vector<std::string> replay{"env.obs=ram",          "agent.encoder=mlp",
                                          "agent.min_replay=100", "agent.replay_capacity=1000",
                                          "agent.batch_size=8",   "train.total_steps=120"};
    const std::vector<std::string> rollout{"env.obs=ram", "agent.encoder=mlp", "agent.rollout_steps=8",
                                           "agent.minibatch_size=4", "train.total_steps=24"};
    for (const auto& policy : {trained("sac", make_sac, folder.path() / "sac", replay),
                               trained("sacd", make_sacd, folder.path() / "sacd", replay),
                               trained("dqn", make_dqn, folder.path() / "dqn", replay),
                               trained("der", make_der, folder.path() / "der", replay),
                               trained("ppo", make_ppo, folder.path() / "ppo", rollout)}) {
        EXPECT_EQ(policy.info().encoder, "mlp");
        EvaluationPlan plan{.env = env_config_of(policy.info()), .games = 1};
        plan.env.max_frames_per_episode = 80;
        EXPECT_EQ(rows(evaluate(decide_by(policy, false, 1), plan)).size(), 1u) << policy.info().agent;
    }
}

TEST(PolicyEvaluationEmulator, SamplesAGameTheSameWayWhateverIsBesideIt) {
    const TemporaryFolder folder;
    const auto policy = trained("ppo", make_ppo, folder.path() / "run");
    auto plan = short_games();
    plan.games = 3;
    plan.env.max_frames_per_episode = 80;
    const auto alone = rows(evaluate(decide_by(policy, true, 1), plan));
    plan.parallel = 3;
    EXPECT_EQ(rows(evaluate(decide_by(policy, true, 1), plan)), alone);
    EXPECT_NE(rows(evaluate(decide_by(policy, true, 2), plan)), alone);
}

/// The joystick at random has 24; policies/README.md has the mean of 100 games, the least of which is 6,400.
TEST(PolicyEvaluationEmulator, APolicyOfThisRepositoryPlaysKungFuMaster) {
    const auto policy = policy_of(CALE_SOURCE_DIR "/policies/kung_fu_master_rainbow.safetensors");
    const EvaluationPlan plan{.env = env_config_of(policy.info()), .games = 1};
    EXPECT_GE(evaluate(decide_by(policy, true, 1), plan).games.at(0).episode_return, 6000);
}

TEST(PolicyEvaluationEmulator, ReportsWhatWasPlayed) {
    const TemporaryFolder folder;
    const auto policy = trained("ppo", make_ppo, folder.path() / "run", {"env.action_space=minimal"});
    auto plan = short_games();
    plan.env = env_config_of(policy.info());
    plan.env.max_frames_per_episode = 80;
    EXPECT_EQ(plan.env.action_space, ActionSet::minimal);
    plan.games = 2;
    const auto evaluation = evaluate(decide_by(policy, false, 1), plan);
    const EvaluationReport report{.source = "run",
                                  .protocol = "fixed_episodes",
                                  .sampled = false,
                                  .policy = policy.info(),
                                  .plan = plan,
                                  .evaluation = evaluation};
    write_evaluation_report(folder.path() / "out", report);
    for (const auto* name : {"evaluation.csv", "evaluation_events.csv", "evaluation_rewards.csv"})
        EXPECT_TRUE(std::filesystem::exists(folder.path() / "out" / name)) << name;
    EXPECT_THAT(folder.read("out/evaluation.json"), HasSubstr("\"env.action_space\": \"minimal\""));
    EXPECT_THAT(folder.read("out/evaluation.json"), HasSubstr("\"agent\": \"ppo\""));
    EXPECT_THAT(evaluation_text(report), HasSubstr("ppo on Breakout after 4 agent steps, run\n"));
    EXPECT_THAT(evaluation_text(report), HasSubstr("greedy, epsilon 0.2"));
    EXPECT_THAT(folder.read("out/evaluation.json"), HasSubstr("\"random_play\": null\n"));
    // What is printed and stored is of the games in the table.
    Evaluation uneven;
    uneven.mean_return = 3;
    uneven.standard_deviation = 3.7;
    uneven.rewards = {{0.0f, 1}};
    for (const double episode_return : {0, 0, 2, 3, 10})
        uneven.games.push_back({.episode_return = episode_return});
    write_evaluation_report(folder.path() / "uneven", {.source = "run",
                                                       .protocol = "fixed_episodes",
                                                       .sampled = false,
                                                       .policy = policy.info(),
                                                       .plan = plan,
                                                       .evaluation = uneven});
    const auto stored = nlohmann::json::parse(folder.read("uneven/evaluation.json"));
    EXPECT_EQ(stored.at("mean"), 3);
    EXPECT_EQ(stored.at("standard_deviation"), 3.7);
    EXPECT_EQ(stored.at("median"), 2);
    EXPECT_NEAR(stored.at("interquartile_mean"), 5.0 / 3, 1e-12);
    EXPECT_EQ(stored.at("minimum"), 0);
    EXPECT_EQ(stored.at("maximum"), 10);
    EXPECT_EQ(stored.at("games"), 5);
    EXPECT_EQ(stored.at("steps"), nullptr);

    EXPECT_THAT(evaluation_text(report), HasSubstr("games                 2, "));
    plan.games = 5;
    plan.steps = 10;
    write_evaluation_report(folder.path() / "limited", report);
    EXPECT_EQ(nlohmann::json::parse(folder.read("limited/evaluation.json")).at("steps"), 10);
    EXPECT_THAT(evaluation_text(report),
                HasSubstr("games                 2 of 5 (none begins after 10 agent steps), "));

    // What random play scores depends on the rules, and on the joystick.
    EXPECT_THAT(evaluation_text(report), HasSubstr("not known with these actions and rules\n"));
    plan.env.max_frames_per_episode = 108'000;
    EXPECT_THAT(evaluation_text(report), HasSubstr("random play           1.70, published\n"));
    plan.env.action_space = ActionSet::continuous;
    const auto& play = joystick_random("breakout", "200m");
    EXPECT_EQ(plan.env.sticky_probability, 0.25);
    EXPECT_THAT(
        evaluation_text(report),
        HasSubstr(fmt::format("random play           {:.2f} ({:.2f} to {:.2f}), measured with the joystick\n",
                              play.mean, play.low, play.high)));
    plan.env.action_space = ActionSet::minimal;

    EXPECT_NO_THROW(require_playable(policy.info(), plan.env));
    plan.env.game = "alien";
    EXPECT_THAT([&] { require_playable(policy.info(), plan.env); },
                testing::ThrowsMessage<std::invalid_argument>(HasSubstr("4 joystick events of Breakout")));
    plan.env.action_space = ActionSet::continuous;
    EXPECT_THAT([&] { require_playable(policy.info(), plan.env); },
                testing::ThrowsMessage<std::invalid_argument>(HasSubstr("env.action_space=minimal")));
}

TEST(PolicyEvaluationEmulator, APolicyPlaysInTheCoordinatesThatItWasTrainedIn) {
    const TemporaryFolder folder;
    const auto policy = trained("ppo", make_ppo, folder.path() / "run", {"env.joystick=cartesian"});
    EXPECT_EQ(policy.info().joystick, Joystick::cartesian);
    auto plan = short_games();
    plan.env = env_config_of(policy.info());
    EXPECT_EQ(plan.env.joystick, Joystick::cartesian);
    EXPECT_NO_THROW(require_playable(policy.info(), plan.env));
    plan.env.joystick = Joystick::polar;
    EXPECT_THAT([&] { require_playable(policy.info(), plan.env); },
                testing::ThrowsMessage<std::invalid_argument>(
                    AllOf(HasSubstr("env.joystick=cartesian"), HasSubstr("polar"))));
}

TEST(PolicyEvaluationEmulator, APolicyPlaysOnAsManyFramesAsItWasTrainedOn) {
    const TemporaryFolder folder;
    const auto policy = trained("ppo", make_ppo, folder.path() / "run",
                                {"env.frame_stack=2", "env.obs=ram", "agent.encoder=flat"});
    EXPECT_EQ(policy.info().stack, 2);
    auto plan = short_games();
    plan.env = env_config_of(policy.info());
    plan.env.max_frames_per_episode = 80;
    plan.games = 1;
    EXPECT_NO_THROW(require_playable(policy.info(), plan.env));
    EXPECT_EQ(evaluate(decide_by(policy, false, 1), plan).games.size(), 1);
    plan.env.frame_stack = 4;
    EXPECT_THAT([&] { require_playable(policy.info(), plan.env); },
                testing::ThrowsMessage<std::invalid_argument>(
                    AllOf(HasSubstr("env.frame_stack=2"), HasSubstr("act on 4: leave env.frame_stack out"))));
}

// What a game makes of chosen coordinates is what it makes of the joystick that they stand for.
TEST(EvaluationEmulator, ChosenActionsAreInTheCoordinatesOfTheGame) {
    for (const auto joystick : {Joystick::cartesian, Joystick::direction, Joystick::factored}) {
        auto plan = short_games();
        plan.games = 3;
        plan.epsilon = 0;
        plan.env.joystick = joystick;
        const auto space = action_space(plan.env);
        const auto right = [&](const torch::Tensor& observations,
                               std::span<const std::int64_t> games) -> Chosen {
            // Game 0 goes to the right, game 1 up, the others to the left.
            const auto count = observations.size(0);
            if (joystick == Joystick::factored) {
                auto actions = torch::empty({count}, torch::kInt64);
                for (std::int64_t i = 0; i < count; ++i) {
                    const auto game = games[static_cast<std::size_t>(i)];
                    actions[i] = game == 0 ? 14 : game == 1 ? 10 : 2;  // (2, 1, 0), (1, 2, 0), (0, 1, 0)
                }
                return {actions};
            }
            auto actions = torch::zeros({count, box_size(space)});
            for (std::int64_t i = 0; i < count; ++i) {
                const auto game = games[static_cast<std::size_t>(i)];
                actions[i][game == 1 ? 1 : 0] = game == 0 ? 0.9 : game == 1 ? 0.9 : -0.9;
                if (joystick == Joystick::direction) actions[i][2] = 1;
            }
            return {actions};
        };
        const auto evaluation = evaluate(right, plan);
        const auto only = [&](std::size_t game, Event event) {
            const auto& events = evaluation.games.at(game).events;
            return events[static_cast<std::size_t>(event)] == evaluation.games.at(game).length;
        };
        EXPECT_TRUE(only(0, Event::right)) << static_cast<int>(joystick);
        EXPECT_TRUE(only(1, Event::up)) << static_cast<int>(joystick);
        EXPECT_TRUE(only(2, Event::left)) << static_cast<int>(joystick);
    }
}

}  // namespace
}  // namespace cale
