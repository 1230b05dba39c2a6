#include "evaluate/run_evaluations.h"

#include <filesystem>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/temporary_folder.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

using test::TemporaryFolder;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(RunFolders, AreInTheOrderOfTheirNamesAndNumbers) {
    const TemporaryFolder folder;
    for (const std::string run : {"Pong__sac__10", "Pong__sac__9", "Alien__sac__2", "deep/er/Pong__sac__1"})
        folder.write(run + "/config.yaml", "");
    for (const std::string run : {"Pong__sac__10", "Pong__sac__9", "Alien__sac__2"})
        folder.write(run + "/checkpoints/step_000000001/state.json", "");
    folder.write("deep/er/Pong__sac__1/episodes.csv", "");
    folder.write("settings/config.yaml", "");
    fs::create_directory_symlink(folder / "Pong__sac__9", folder / "link");
    fs::create_directory_symlink(folder.path(), folder / "deep" / "loop");
    fs::create_directory_symlink("itself", folder / "itself");
    std::vector<std::string> names;
    for (const auto& run : run_folders(folder.path()))
        names.push_back(run.lexically_relative(folder.path()).string());
    EXPECT_THAT(
        names, ElementsAre("Alien__sac__2", "Pong__sac__9", "Pong__sac__10", "deep/er/Pong__sac__1", "link"));
}

EvaluationProtocol some_protocol() {
    return {.name = "fixed_episodes",
            .games = 100,
            .steps = kNoLimit,
            .epsilon = 0.001,
            .noop_max = 29,
            .seed = 1,
            .choice = "own",
            .settings = {{"env.threshold", "0.3"}}};
}

TEST(RunEvaluations, AreInAFolderOfTheirProtocol) {
    const TemporaryFolder run;
    const auto folder = evaluations_folder(run.path(), some_protocol());
    EXPECT_EQ(folder, evaluations_folder(run.path(), some_protocol()));
    EXPECT_THAT(folder.filename(), testing::ResultOf([](const fs::path& name) { return name.string(); },
                                                     testing::MatchesRegex("fixed_episodes-[0-9a-f]{8}")));
    for (const auto& change : std::vector<std::function<void(EvaluationProtocol&)>>{
             [](auto& protocol) { protocol.games = 99; }, [](auto& protocol) { protocol.steps = 99; },
             [](auto& protocol) { protocol.epsilon = 0; }, [](auto& protocol) { protocol.noop_max = 0; },
             [](auto& protocol) { protocol.noop_max.reset(); }, [](auto& protocol) { protocol.seed = 2; },
             [](auto& protocol) { protocol.choice = "greedy"; },
             [](auto& protocol) { protocol.settings.clear(); }}) {
        auto other = some_protocol();
        change(other);
        EXPECT_NE(evaluations_folder(run.path(), other), folder);
    }
    make_evaluations_folder(folder, some_protocol());
    make_evaluations_folder(folder, some_protocol());
    EXPECT_THAT(run.read(fs::relative(folder / "protocol.json", run.path()).string()),
                testing::AllOf(HasSubstr("\"games\": 100"), HasSubstr("\"steps\": null")));
    run.write(fs::relative(folder / "protocol.json", run.path()).string(), "{}");
    EXPECT_THAT([&] { make_evaluations_folder(folder, some_protocol()); },
                testing::ThrowsMessage<std::runtime_error>(HasSubstr("move the folder away")));
}

TEST(RunEvaluations, ThoseThatCannotBeReadAreNotThere) {
    const TemporaryFolder folder;
    EXPECT_FALSE(evaluation_result(folder.path(), 700));
    folder.write("step_000000700.csv", "episode,return,length,frames\n0,2,7,28\n");
    EXPECT_FALSE(evaluation_result(folder.path(), 700));
    folder.write("step_000000700.json", R"({"games": 1, "mean": 2.5, "standard_dev)");
    EXPECT_FALSE(evaluation_result(folder.path(), 700));
    folder.write(
        "step_000000700.json",
        R"({"games": 1, "mean": 2.5, "standard_deviation": 1, "median": 2, "human_normalised": null})");
    for (const auto* damaged : {"episode,return,length,frames\n", "episode,return,length,frames\n0,2",
                                "episode,return,length,frames\n0,2\n", ""}) {
        folder.write("step_000000700.csv", damaged);
        EXPECT_FALSE(evaluation_result(folder.path(), 700)) << damaged;
    }
    folder.write("step_000000700.csv", "episode,return,length,frames\n0,2,7,28\n");
    const auto result = evaluation_result(folder.path(), 700);
    ASSERT_TRUE(result);
    EXPECT_FALSE(evaluation_result(folder.path(), 700, "5ef2a0c1")) << "it does not say of which policy";
    folder.write("step_000000700.json", R"({"games": 1, "mean": 2.5, "standard_deviation": 1, "median": 2,)"
                                        R"( "human_normalised": null, "policy_crc32c": "5ef2a0c1"})");
    EXPECT_TRUE(evaluation_result(folder.path(), 700, "5ef2a0c1"));
    EXPECT_FALSE(evaluation_result(folder.path(), 700, "5ef2a0c2"));
    EXPECT_EQ(partial_evaluation("runs", 700, "5ef2a0c1"), "runs/step_000000700-5ef2a0c1.partial");
    EXPECT_EQ(result->mean, 2.5);
    EXPECT_FALSE(result->human_normalised);
    EXPECT_EQ(evaluation_table(
                  {{.run = "Pong__sac__1", .result = result}, {.run = "b", .failure = "no checkpoint"}}),
              "run           agent steps  games        mean        std      median  human-normalised\n"
              "Pong__sac__1          700      1        2.50       1.00        2.00                 -\n"
              "b             none: no checkpoint\n");
}

TEST(PlayedGames, OutliveTheProcess) {
    const TemporaryFolder folder;
    const auto file = folder / "step_1.partial";
    EvaluatedGame game{.episode_return = -0.1, .length = 3, .frames = 12, .rewards = {{-0.1F, 1}, {0.0F, 2}}};
    game.events[7] = 3;
    {
        PlayedGames games(file);
        EXPECT_TRUE(games.known().empty());
        games.write(4, game);
        games.write(0, {});
    }
    const auto whole = folder.read("step_1.partial");
    folder.write("step_1.partial", whole + R"({"game":9,"return":1)");
    {
        PlayedGames games(file);
        ASSERT_EQ(games.known().size(), 2u);
        const auto& same = games.known().at(4);
        EXPECT_EQ(same.episode_return, game.episode_return);
        EXPECT_EQ(same.length, 3);
        EXPECT_EQ(same.frames, 12);
        EXPECT_EQ(same.events, game.events);
        EXPECT_EQ(same.rewards, game.rewards);
        games.write(9, game);
    }
    EXPECT_EQ(PlayedGames(file).known().size(), 3u);
    folder.write("step_1.partial", whole + "no game\n" + whole);
    EXPECT_EQ(PlayedGames(file).known().size(), 2u);
    EXPECT_EQ(folder.read("step_1.partial"), whole);
}

}  // namespace
}  // namespace cale
