// train_sac from its command line to its exit code.
#include "experiment/program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <ATen/Parallel.h>

#include "agents/ppo.h"
#include "agents/sac.h"
#include "cale/games.h"
#include "experiment/files.h"
#include "experiment/run_lock.h"
#include "temporary_folder.h"

namespace cale {
namespace {

using test::TemporaryFolder;

struct Answer {
    int code;
    std::string stderr_text;
};

template <class Config>
Answer train(const std::string& agent, std::unique_ptr<Agent> (*make)(const Config&, const AgentSpec&),
             const std::vector<std::string>& arguments) {
    const auto program = "train_" + agent;
    std::vector<const char*> argv{program.c_str()};
    for (const auto& argument : arguments) argv.push_back(argument.c_str());
    testing::internal::CaptureStderr();
    const int code = run_program<Config>(agent, "Trains.", make, static_cast<int>(argv.size()), argv.data());
    return {code, testing::internal::GetCapturedStderr()};
}

Answer train_sac(const std::vector<std::string>& arguments) {
    return train("sac", make_sac, arguments);
}

/// A run of a few steps with a small network.
std::vector<std::string> small(const std::filesystem::path& run_dir, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--run-dir",
                                          run_dir.string(),
                                          "--threads",
                                          "1",
                                          "--no-progress",
                                          "agent.encoder=phi_dqn",
                                          "agent.hidden_units=8",
                                          "agent.replay_capacity=1000",
                                          "train.total_steps=12",
                                          "eval.episodes=0"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
}

TEST(ProgramEmulator, TrainsAndWritesWhatItRan) {
    const TemporaryFolder folder;
    const auto answer = train_sac(small(folder.path() / "run", {"env.game=ALE/MsPacman-v5", "--seed", "5"}));
    EXPECT_EQ(answer.code, 0) << answer.stderr_text;
    EXPECT_THAT(read_file(folder.path() / "run" / "config.yaml"), testing::HasSubstr("seed: 5"));
    EXPECT_THAT(read_file(folder.path() / "run" / "metadata.json"), testing::HasSubstr("ALE/MsPacman-v5"));
}

TEST(ProgramEmulator, MistakesAreOneSentenceAndExitCode2) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    const auto wrong = folder.write("roms/pong.bin", "no game").parent_path().string();
    for (const auto& [mistake, said] :
         std::vector<std::pair<std::string, std::string>>{{"env.gmae=pong", "env.game"},
                                                          {"env.game=pongg", "pong"},
                                                          {"env.threshold=1.5", "0 to 1"},
                                                          {"env.rom_dir=/nowhere", "/nowhere"},
                                                          {"env.rom_dir=" + wrong, "with MD5"}}) {
        const auto answer = train_sac(small(run, {mistake}));
        EXPECT_EQ(answer.code, 2) << mistake;
        EXPECT_THAT(answer.stderr_text, testing::HasSubstr(said)) << mistake;
        EXPECT_EQ(std::count(answer.stderr_text.begin(), answer.stderr_text.end(), '\n'), 1)
            << answer.stderr_text;
        EXPECT_FALSE(std::filesystem::exists(run)) << "nothing may be left behind";
    }
    EXPECT_EQ(train_sac({"--device", "tpu"}).code, 2);
}

TEST(ProgramEmulator, OverlapIsForAgentsWithAReplay) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    const auto answer = train("ppo", make_ppo, {"--run-dir", run.string(), "train.overlap=true"});
    EXPECT_EQ(answer.code, 2);
    EXPECT_THAT(answer.stderr_text, testing::HasSubstr("train.overlap: ppo learns only from"));
    EXPECT_FALSE(std::filesystem::exists(run));
    EXPECT_EQ(train_sac(small(run, {"train.overlap=true"})).code, 0);
}

TEST(ProgramEmulator, AResumedRunKeepsItsThreads) {
    const TemporaryFolder folder;
    const int before = at::get_num_threads();
    auto arguments = small(folder.path());
    arguments[3] = "2";  // of --threads
    ASSERT_EQ(train_sac(arguments).code, 0);
    at::set_num_threads(1);
    // Without --threads: auto.
    const auto longer =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20", "--no-progress"});
    EXPECT_EQ(longer.code, 0) << longer.stderr_text;
    EXPECT_EQ(at::get_num_threads(), 2);
    at::set_num_threads(before);
}

TEST(ProgramEmulator, AFolderWithARunIsNotOverwritten) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto again = train_sac(small(folder.path()));
    EXPECT_EQ(again.code, 2);
    EXPECT_THAT(again.stderr_text, testing::HasSubstr("--resume"));
}

TEST(ProgramEmulator, ResumesOnlyTheSameConfiguration) {
    const TemporaryFolder folder;
    EXPECT_EQ(train_sac({"--resume", "--run-dir", (folder.path() / "none").string()}).code, 3);

    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto other =
        train_sac({"--resume", "--run-dir", folder.path().string(), "agent.gamma=0.5", "--no-progress"});
    EXPECT_EQ(other.code, 3);
    EXPECT_THAT(other.stderr_text, testing::HasSubstr("agent.gamma was 0.99 and is now 0.5"));

    const auto longer =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20", "--no-progress"});
    EXPECT_EQ(longer.code, 0) << longer.stderr_text;
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "checkpoints" / "step_000000020"));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 20"));
}

TEST(ProgramEmulator, ResumesAnotherConfigurationOnlyWhenToldTo) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto resume = [&](std::vector<std::string> more) {
        std::vector<std::string> arguments{
            "--resume",        "--run-dir", folder.path().string(), "--no-progress", "train.total_steps=20",
            "--accept-changes"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return train_sac(arguments);
    };
    const auto other_game = resume({"env.game=breakout", "agent.learning_rate=0.5"});
    EXPECT_EQ(other_game.code, 3);
    EXPECT_THAT(other_game.stderr_text, testing::HasSubstr("cannot go on in another environment: env.game"));
    EXPECT_THAT(read_file(folder.path() / "metadata.json"),
                testing::Not(testing::HasSubstr("accepted_changes")));

    const auto changed = resume({"agent.learning_rate=0.5"});
    EXPECT_EQ(changed.code, 0) << changed.stderr_text;
    EXPECT_THAT(changed.stderr_text, testing::HasSubstr("changed in mid-run: agent.learning_rate was"));
    EXPECT_THAT(read_file(folder.path() / "metadata.json"), testing::HasSubstr("agent.learning_rate was"));
    EXPECT_EQ(resume({"agent.hidden_units=9"}).code, 3) << "another network";
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("hidden_units: 8"));
    EXPECT_EQ(train_sac(small(folder.path() / "new", {"--accept-changes"})).code, 2);
}

TEST(ProgramEmulator, ARunIsTrainedByOneProcessAtATime) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const RunLock lock(folder.path());
    const auto second = train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20"});
    EXPECT_EQ(second.code, 1);
    EXPECT_THAT(second.stderr_text, testing::HasSubstr("is training in " + folder.path().string()));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 12"));
}

TEST(ProgramSlow, EveryGameRunsUnderThe100kPreset) {
    for (const Game& game : games()) {
        const TemporaryFolder folder;
        const auto answer = train_sac(
            small(folder.path(), {"--config", CALE_SOURCE_DIR "/configs/sac/atari100k.yaml",
                                  "env.game=" + std::string(game.name), "train.save_replay=false"}));
        EXPECT_EQ(answer.code, 0) << game.name << ": " << answer.stderr_text;
    }
}

}  // namespace
}  // namespace cale
