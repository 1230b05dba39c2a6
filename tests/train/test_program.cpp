// train_sac and cale from their command lines to their exit codes.
#include "train/program.h"
#include "train/threads.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <future>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <ATen/Parallel.h>
#include <fmt/format.h>
#include <torch/types.h>
#include <nlohmann/json.hpp>

#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/sac.h"
#include "cale/games.h"
#include "settings/versions.h"
#include "storage/files.h"
#include "storage/run_lock.h"
#include "support/temporary_folder.h"
#include "support/working_folder.h"
#include "train/agent_file.h"
#include "train/export.h"
#include "train/log.h"

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
    const int code = run_program(agent, "Trains.", make, static_cast<int>(argv.size()), argv.data());
    return {code, testing::internal::GetCapturedStderr()};
}

Answer train_sac(const std::vector<std::string>& arguments) {
    return train("sac", make_sac, arguments);
}

/// Resumes the run in this folder, to so many steps.
std::vector<std::string> resuming(const std::filesystem::path& run, int steps,
                                  const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"--resume", "--run-dir", run.string(), "--no-progress",
                                       "train.total_steps=" + std::to_string(steps)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
}

/// A run of a few steps with a small network.
std::vector<std::string> small(const std::filesystem::path& run_dir, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--run-dir",
                                          run_dir.string(),
                                          "--threads",
                                          "1",
                                          "--no-progress",
                                          "agent.encoder=data_efficient",
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
    EXPECT_THAT(answer.stderr_text,
                testing::HasSubstr("  updates       none: they begin after agent.min_replay = 20,000 "
                                   "transitions\n"));

    const auto run = (folder.path() / "run").string();
    EXPECT_THAT(train_sac(small(run + "/")).stderr_text, testing::HasSubstr(": a run is in there already;"));
    for (const auto* inside : {"/a", "/checkpoints/step_000000012/b/"}) {
        const auto refused = train_sac(small(run + inside));
        EXPECT_EQ(refused.code, 2);
        EXPECT_EQ(refused.stderr_text, "train_sac: --run-dir " + run + inside +
                                           ": it is in the folder of another run, " + run +
                                           "; choose another one\n");
    }
}

TEST(ProgramEmulator, AFolderOfRunsIsNoRuns) {
    const TemporaryFolder folder;
    const auto run = (folder.path() / "mine" / "run").string(), mine = (folder.path() / "mine").string();
    ASSERT_EQ(train_sac(small(run)).code, 0);
    for (const auto& above : {mine, folder.path().string()}) {
        const auto refused = train_sac(small(above));
        EXPECT_EQ(refused.code, 2);
        EXPECT_EQ(refused.stderr_text, "train_sac: --run-dir " + above + ": it holds other runs, such as " +
                                           run + "; give the run a folder of its own, such as " + above +
                                           "/my_run\n");
    }
    const auto sweep = folder.path() / "sweep";
    std::filesystem::create_directory(sweep);
    write_file_atomically(sweep / "sweep_runs.txt", "Pong__sac__1\n");
    EXPECT_THAT(train_sac(small(sweep)).stderr_text, testing::HasSubstr(": it holds a sweep's runs;"));
    EXPECT_EQ(train_sac(small(folder.path() / "mine" / "my_run")).code, 0);
}

/// Has no settings.
struct WalkConfig {
    static constexpr bool kDiscrete = false;
};
template <class Visit>
void fields(WalkConfig&, Visit&&) {}

/// Pushes the joystick to the right.
class Walk : public Agent {
  public:
    torch::Tensor act(const torch::Tensor& observations, ActMode) override {
        return torch::tensor({1.0f, 0.0f, 0.0f}).repeat({observations.size(0), 1});
    }
    void observe(const StepBatch&) override {}
    bool update(const torch::Tensor&) override { return false; }
    std::map<std::string, double> metrics() override { return {}; }
    TensorMap state() override { return {}; }
    void load_state(const TensorMap&) override {}
};

nlohmann::json metadata_of(const std::filesystem::path& run) {
    return nlohmann::json::parse(read_file(run / "metadata.json"));
}

TEST(ProgramEmulator, TrainsOnePolicyInSeveralGames) {
    const TemporaryFolder folder;
    const auto config = folder.write("two.yaml", "env:\n  game: [pong, breakout]\n").string();
    const auto run = folder.path() / "run";
    // Every game lasts ten agent steps, so that each ends in each environment.
    const std::vector<std::string> settings{
        "env.num_envs=2",       "env.max_frames_per_episode=40", "agent.min_replay=100",
        "train.total_steps=60", "train.checkpoint_every=20",     "eval.episodes=2"};
    auto arguments = small(run, {"--config", config});
    arguments.insert(arguments.end(), settings.begin(), settings.end());
    const auto answer = train_sac(arguments);
    ASSERT_EQ(answer.code, 0) << answer.stderr_text;
    EXPECT_THAT(answer.stderr_text, testing::HasSubstr("sac on ALE/Pong+Breakout-v5"));
    const auto episodes = read_file(run / "episodes.csv");
    EXPECT_THAT(episodes, testing::ContainsRegex("\nr,l,t,global_step,frame,seed,env,truncated,game\n"));
    EXPECT_THAT(episodes, testing::ContainsRegex(",0,1,Pong\n"));
    EXPECT_THAT(episodes, testing::ContainsRegex(",1,1,Breakout\n"));
    EXPECT_EQ(metadata_of(run)["rom_md5"],
              "60e0ea3cbe0913d39803477945e9e5ec,f34f08e5eb96e500e851a80be3277a56");
    EXPECT_THAT(read_file(run / "eval" / "step_000000060.csv"),
                testing::MatchesRegex("episode,return,length,frames,game\n0,.*,Pong\n1,.*,Breakout\n"));
    const auto longer = train_sac(resuming(run, 80, {}));
    EXPECT_EQ(longer.code, 0) << longer.stderr_text;
    const auto policy = policy_of(run);
    EXPECT_EQ(policy.info().game, "Pong+Breakout");
    EXPECT_EQ(env_config_of(policy.info()).game, "pong,breakout");
}

TEST(ProgramEmulator, PausesAtAStepAndGoesOnAsIfItHadNot) {
    const TemporaryFolder folder;
    const std::vector<std::string> learns{
        "agent.min_replay=20",  "agent.batch_size=4", "env.max_frames_per_episode=60",
        "train.total_steps=60", "eval.episodes=1",    "eval.video=false"};
    const auto whole = folder.path() / "whole", paused = folder.path() / "paused";
    ASSERT_EQ(train_sac(small(whole, learns)).code, 0);

    auto until = learns;
    until.insert(until.end(), {"--until", "3e1"});
    const auto answer = train_sac(small(paused, until));
    EXPECT_EQ(answer.code, 0);
    EXPECT_THAT(answer.stderr_text, testing::HasSubstr("Paused at agent step 30; resume with --resume"));
    EXPECT_EQ(metadata_of(paused)["stopped"], "--until 30");
    EXPECT_TRUE(std::filesystem::exists(paused / "checkpoints/step_000000030"));
    EXPECT_FALSE(std::filesystem::exists(paused / "eval"));
    EXPECT_EQ(train_sac(resuming(paused, 60, {"--until", "30"})).code, 0) << "it is there already";
    EXPECT_FALSE(std::filesystem::exists(paused / "checkpoints/step_000000031"));
    EXPECT_THAT(train_sac(resuming(paused, 60, {"--until", "20"})).stderr_text,
                testing::HasSubstr("Paused at agent step 30, where it was: --until 20 is behind it; resume"));
    ASSERT_EQ(train_sac(resuming(paused, 60, {"--until", "100"})).code, 0);
    EXPECT_EQ(metadata_of(paused)["finished"], true);
    for (const std::string file : {"eval/step_000000060.csv",
                                   "checkpoints/step_000000060/agent.safetensors.zst", "joystick_events.csv"})
        EXPECT_EQ(read_file(paused / file), read_file(whole / file)) << file;

    for (const char* step : {"0", "-3", "soon"}) {
        const auto refused = train_sac(small(folder.path() / "new", {"--until", step}));
        EXPECT_EQ(refused.code, 2);
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr("--until must be "));
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr(fmt::format("not '{}'", step)));
    }
}

TEST(ProgramEmulator, AStoredReplayIsUsedAlsoWhereNoneIsStoredAnyMore) {
    const TemporaryFolder folder;
    const std::vector<std::string> learns{"agent.min_replay=20", "agent.batch_size=4",
                                          "env.max_frames_per_episode=60", "train.total_steps=60"};
    const auto whole = folder.path() / "whole", changed = folder.path() / "changed";
    ASSERT_EQ(train_sac(small(whole, learns)).code, 0);
    auto until = learns;
    until.insert(until.end(), {"--until", "30"});
    ASSERT_EQ(train_sac(small(changed, until)).code, 0);
    ASSERT_EQ(train_sac(resuming(changed, 60, {"train.save_replay=false"})).code, 0);
    const std::filesystem::path last = "checkpoints/step_000000060";
    EXPECT_EQ(read_file(changed / last / "agent.safetensors.zst"),
              read_file(whole / last / "agent.safetensors.zst"));
    EXPECT_TRUE(std::filesystem::exists(whole / last / "replay.zst"));
    EXPECT_FALSE(std::filesystem::exists(changed / last / "replay.zst"));
}

TEST(ProgramEmulator, WithoutItsReplayAResumedRunCollectsAnewBeforeItLearns) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    ASSERT_EQ(train_sac(small(run, {"agent.min_replay=20", "agent.batch_size=4", "agent.update_period=1",
                                    "env.max_frames_per_episode=60", "train.total_steps=80",
                                    "train.save_replay=false", "--until", "40"}))
                  .code,
              0);
    const auto updates_by = [&](const char* step) {
        return load_agent(run / "checkpoints" / step).at("adam/steps").item<float>();
    };
    EXPECT_FALSE(std::filesystem::exists(run / "checkpoints/step_000000040/replay.zst"));
    const auto resumed = train_sac(resuming(run, 80, {}));
    ASSERT_EQ(resumed.code, 0) << resumed.stderr_text;
    const auto more = updates_by("step_000000080") - updates_by("step_000000040");
    EXPECT_GT(more, 0);
    EXPECT_LE(more, 20) << "in the first 20 of the 40 steps the replay fills again";
}

TEST(ProgramEmulator, MetadataSayWithWhatAndForHowLong) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path(), {"env.game=breakout", "--seed", "5"})).code, 0);
    const auto first = metadata_of(folder.path());
    EXPECT_EQ(first["rom_md5"], "f34f08e5eb96e500e851a80be3277a56");
    EXPECT_EQ(first["commit"], cale_commit());
    EXPECT_TRUE(first["cpu"].is_string() && !first["cpu"].get<std::string>().empty());
    EXPECT_EQ(first["seed"], 5);
    EXPECT_EQ(first["threads"], 1);
    EXPECT_EQ(first["processes"], 1);
    EXPECT_GT(first["wall_seconds"], 0.0);
    EXPECT_EQ(first["finished"], true);
    EXPECT_TRUE(first["stopped"].is_null());
    EXPECT_FALSE(first.contains("resumed"));

    const auto longer =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20", "--no-progress"});
    ASSERT_EQ(longer.code, 0) << longer.stderr_text;
    const auto second = metadata_of(folder.path());
    EXPECT_GT(second["wall_seconds"], first["wall_seconds"]) << "of both sessions";
    EXPECT_EQ(second["started"], first["started"]);
    EXPECT_EQ(second["command"], first["command"]);
    ASSERT_EQ(second["resumed"].size(), 1u);
    EXPECT_EQ(second["resumed"][0]["commit"], cale_commit());
    EXPECT_THAT(second["resumed"][0]["command"].get<std::string>(), testing::HasSubstr("--resume"));
}

TEST(ProgramEmulator, MetadataSayWhyARunStopped) {
    struct Stopping : Walk {
        torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
            if (++decisions == 5)
                for (const int twice : {SIGHUP, SIGHUP}) raise(twice);
            return Walk::act(observations, mode);
        }
        int decisions = 0;
    };
    struct Failing : Walk {
        torch::Tensor act(const torch::Tensor&, ActMode) override {
            throw std::runtime_error("the actor's output is not finite");
        }
    };
    ::signal(SIGHUP, SIG_DFL);  // under nohup it is ignored, and stays so
    const TemporaryFolder folder;
    const auto run = [&](const std::string& name, auto make) {
        const auto code = train("walk", +make,
                                {"--run-dir", folder / name, "--threads", "1", "--no-progress",
                                 "train.total_steps=20", "eval.episodes=0"})
                              .code;
        const auto metadata = metadata_of(folder / name);
        EXPECT_EQ(metadata["finished"], false);
        return fmt::format("{}: {}", code, metadata["stopped"].get<std::string>());
    };
    EXPECT_EQ(run("stopped",
                  [](const WalkConfig&, const AgentSpec&) -> std::unique_ptr<Agent> {
                      return std::make_unique<Stopping>();
                  }),
              "130: SIGHUP");
    EXPECT_EQ(run("failed",
                  [](const WalkConfig&, const AgentSpec&) -> std::unique_ptr<Agent> {
                      return std::make_unique<Failing>();
                  }),
              "1: the actor's output is not finite");
}

TEST(ProgramEmulator, MetadataThatAreDamagedAreNamedAndLeftAlone) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto file = folder.path() / "metadata.json";
    const auto good = read_file(file);
    const auto resume = [&](const std::vector<std::string>& more = {}) {
        return train_sac(resuming(folder.path(), 20, more));
    };
    for (const std::string& damaged :
         {good.substr(0, good.size() / 2), std::string("[]"), std::string(),
          std::string(R"({"threads": "2"})"), std::string(R"({"threads": 0})"),
          std::string(R"({"threads": 4294967297})"), std::string(R"({"wall_seconds": -1})"),
          std::string(R"({"resumed": {"at": 1}})")}) {
        write_file_atomically(file, damaged);
        for (const auto& more : std::vector<std::vector<std::string>>{{}, {"--threads", "1"}}) {
            const auto answer = resume(more);
            EXPECT_EQ(answer.code, 3) << damaged;
            EXPECT_THAT(answer.stderr_text, testing::HasSubstr(file.string() + " is damaged: "));
            EXPECT_THAT(answer.stderr_text, testing::HasSubstr("put a copy of it back"));
            EXPECT_EQ(std::count(answer.stderr_text.begin(), answer.stderr_text.end(), '\n'), 1);
            EXPECT_EQ(read_file(file), damaged) << "nothing is lost";
        }
    }
    std::filesystem::remove(file);
    EXPECT_THAT(resume().stderr_text, testing::HasSubstr("say --threads with that number"));
    EXPECT_EQ(resume({"--threads", "1"}).code, 0) << "as the sentence says";
    EXPECT_EQ(metadata_of(folder.path())["finished"], true);
}

TEST(ProgramEmulator, MetadataOfAnOlderVersionAreCarriedOn) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    auto old = metadata_of(folder.path());
    for (const auto* key : {"commit", "cpu", "rom_md5", "wall_seconds", "finished", "stopped"})
        old.erase(key);
    old["somebody's"] = "note";
    write_file_atomically(folder.path() / "metadata.json", old.dump());
    const auto longer =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20", "--no-progress"});
    ASSERT_EQ(longer.code, 0) << longer.stderr_text;
    const auto now = metadata_of(folder.path());
    EXPECT_EQ(now["somebody's"], "note");
    EXPECT_EQ(now["finished"], true);
    EXPECT_GT(now["wall_seconds"], 0.0);
}

TEST(ProgramEmulator, MistakesAreOneSentenceAndExitCode2) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    const auto wrong = folder.write("roms/pong.bin", "no game").parent_path().string();
    for (const auto& [mistake, said] : std::vector<std::pair<std::string, std::string>>{
             {"env.gmae=pong", "env.game"},
             {"env.game=pongg", "pong"},
             {"env.game=pong,breakout", "for a run of each game there is `cale sweep`"},
             {"train.steps=100", "did you mean 'train.total_steps'?"},
             {"agent.encoder=IMPALA", "did you mean 'impala'?"},
             {"train.seed=12345678901234567890", "0 to 4294967295"},
             {"env.threshold=1.5", "0 to 1"},
             {"agent.adam_epsilon=0", "1e-12"},
             {"env.rom_dir=/nowhere", "/nowhere"},
             {"env.stick_damping=1", "set env.stick_speed too, such as 0.2"},
             {"env.mode=7", "env.mode is 7, which Pong does not have: it has 0, 1"},
             {"env.rom_dir=/m\xfcller", "which is UTF-8"},
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

TEST(ProgramEmulator, ARelativeFolderOfRomsIsFoundFromEveryFolder) {
    const TemporaryFolder folder;
    const auto roms = find_rom("pong", "").parent_path();
    std::filesystem::create_directory_symlink(roms, folder.path() / "roms");
    const auto run = folder.path() / "run";
    {
        const test::WorkingFolder here(folder.path());
        const auto begun = train_sac(small(run, {"env.rom_dir=roms"}));
        ASSERT_EQ(begun.code, 0) << begun.stderr_text;
    }
    EXPECT_THAT(read_file(run / "config.yaml"),
                testing::HasSubstr("rom_dir: " + (folder.path() / "roms").string() + "\n"));
    const auto resumed = train_sac(resuming(run, 80, {}));
    EXPECT_EQ(resumed.code, 0) << resumed.stderr_text;
}

TEST(ProgramEmulator, TrainsBesideAConsoleThatDoesNotWait) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    const auto refused = train_sac(small(run, {"train.realtime=true", "env.num_envs=2"}));
    EXPECT_EQ(refused.code, 2);
    EXPECT_EQ(refused.stderr_text,
              "train_sac: train.realtime is for one game, and env.num_envs is 2: set it to 1\n");
    const std::vector<std::string> settings{"train.realtime=true", "env.num_envs=1"};
    const auto answer = train_sac(small(run, settings));
    ASSERT_EQ(answer.code, 0) << answer.stderr_text;
    const auto progress = read_progress(run / "progress.csv");
    for (const auto* column : {"realtime/missed_frames", "realtime/late_frames"})
        EXPECT_EQ(progress.at(column).size(), progress.at("frame").size()) << column;
    EXPECT_GE(progress.at("frame").back(), 4 * progress.at("global_step").back() - 3);
    // It begins a new game, and ends.
    const auto resumed = train_sac(resuming(run, 20, {}));
    EXPECT_EQ(resumed.code, 0) << resumed.stderr_text;
}

TEST(ProgramEmulator, AConfigurationOfAnotherAgentIsNamedAsSuch) {
    const auto answer = train_sac({"--config", CALE_SOURCE_DIR "/configs/dqn/atari100k.yaml"});
    EXPECT_EQ(answer.code, 2);
    EXPECT_THAT(answer.stderr_text, testing::EndsWith("; this is a configuration of train_dqn\n"));
}

TEST(ProgramEmulator, WhatDoesNotFitIntoMemoryIsRefusedBeforeItIsMade) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "runs" / "run";
    const auto answer = train_sac(small(run, {"agent.hidden_units=65536", "agent.hidden_layers=16"}));
    EXPECT_EQ(answer.code, 1);
    EXPECT_THAT(
        answer.stderr_text,
        testing::AllOf(testing::StartsWith("train_sac: the network, with its gradients, Adam's moments and "
                                           "checkpoints, needs "),
                       testing::EndsWith(" GB are available: lower agent.hidden_units, "
                                         "agent.hidden_layers or agent.critic_atoms\n")));
    EXPECT_FALSE(std::filesystem::exists(run.parent_path()));
}

std::unique_ptr<Agent> make_nothing(const SacConfig&, const AgentSpec&) {
    throw std::runtime_error("nothing is made");
}

TEST(ProgramEmulator, SaysWhatItTrainsBeforeItMakesIt) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "runs" / "run";
    const auto answer = train("sac", make_nothing, small(run));
    EXPECT_EQ(answer.code, 1);
    EXPECT_THAT(answer.stderr_text,
                testing::AllOf(testing::StartsWith("sac on ALE/Pong-v5\n  encoder       data_efficient\n"),
                               testing::HasSubstr("  run folder    " + run.string() + "\n"),
                               testing::Not(testing::HasSubstr("\n  evaluation")),
                               testing::EndsWith("\ntrain_sac: nothing is made\n")));
    EXPECT_FALSE(std::filesystem::exists(run.parent_path())) << "nor does it leave a folder behind";
    EXPECT_THAT(train("sac", make_nothing, small(run, {"eval.episodes=3", "eval.every=1000"})).stderr_text,
                testing::HasSubstr("\n  evaluation    3 games at the end, and every 1,000 steps\n"));
}

TEST(Program, AnAgentsNameFitsIntoFilesNames) {
    const auto answer = train("c51.v2", make_nothing, {"--help"});
    EXPECT_EQ(answer.code, 2);
    EXPECT_EQ(answer.stderr_text,
              "train_c51.v2: an agent cannot be called 'c51.v2' in run_program(): its name takes at most 64 "
              "letters, digits, '_' and '-'\n");
}

TEST(ProgramEmulator, RunsThatStartInTheSameSecondHaveFoldersOfTheirOwn) {
    const TemporaryFolder folder;
    const test::WorkingFolder here(folder.path());
    const auto now = std::time(nullptr);
    for (int second = 0; second < 60; ++second) {  // as other runs would have made them
        std::filesystem::create_directories(fmt::format("runs/Pong__sac__1__{}", now + second));
        std::filesystem::create_directories(fmt::format("runs/Pong__sac__1__{}_2", now + second));
    }
    auto arguments = small("");
    arguments.erase(arguments.begin(), arguments.begin() + 2);  // --run-dir
    const auto answer = train_sac(arguments);
    EXPECT_EQ(answer.code, 0) << answer.stderr_text;
    std::vector<std::string> trained;
    for (const auto& run : std::filesystem::directory_iterator(folder / "runs"))
        if (!std::filesystem::is_empty(run)) trained.push_back(run.path().filename());
    EXPECT_THAT(trained, testing::ElementsAre(testing::EndsWith("_3")));
}

TEST(ProgramEmulator, ARunThatWasStoppedBeforeItsFirstCheckpointCanBeStarted) {
    const TemporaryFolder folder;
    const auto resume = [&] {
        return train_sac({"--resume", "--run-dir", folder.path().string(), "--no-progress"});
    };
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    std::filesystem::remove_all(folder / "checkpoints");
    folder.write("progress.csv", "");
    folder.write("episodes.csv", "#{}\nr,l,t,global_step,frame,seed,env,truncated\n1\n");
    EXPECT_EQ(train_sac(small(folder.path())).code, 2) << "what it recorded is not overwritten";
    EXPECT_THAT(resume().stderr_text, testing::HasSubstr("; give --run-dir another folder\n"));

    folder.write("episodes.csv", "#{}\nr,l,t,global_step,frame,seed,env,truncated\n");
    const auto resumed = resume();
    EXPECT_EQ(resumed.code, 3);
    EXPECT_THAT(resumed.stderr_text,
                testing::HasSubstr("holds no checkpoint to resume from; start the run again, "
                                   "without --resume\n"));
    EXPECT_EQ(train_sac(small(folder.path())).code, 0);
}

TEST(ProgramEmulator, AConfigurationThatIsNoRunsIsNotOverwritten) {
    const TemporaryFolder folder;
    folder.write("config.yaml", "env: {game: pong}\n");
    const auto refused = train_sac(small(folder.path()));
    EXPECT_EQ(refused.code, 2);
    EXPECT_EQ(
        refused.stderr_text,
        fmt::format("train_sac: --run-dir {}: its config.yaml is no run's, and would be replaced; choose "
                    "another folder\n",
                    folder.path().string()));
    EXPECT_EQ(folder.read("config.yaml"), "env: {game: pong}\n");
    EXPECT_THAT(train_sac({"--resume", "--run-dir", folder.path().string()}).stderr_text,
                testing::HasSubstr("holds no checkpoint to resume from; give --run-dir another folder\n"));
}

TEST(ProgramEmulator, FilesThatAreNoRunsAreNotReplaced) {
    for (const auto* name :
         {"metadata.json", "episodes.csv", "learning_curve.svg", "checkpoints/my.partial/notes"}) {
        const TemporaryFolder folder;
        folder.write(name, "mine");
        const auto refused = train_sac(small(folder.path()));
        EXPECT_EQ(refused.code, 2) << name;
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr("is no run's, and would be replaced"));
        EXPECT_EQ(folder.read(name), "mine");
    }
}

TEST(ProgramEmulator, ARefusedResumeCutsNothingOff) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path(), {"log.every=4"})).code, 0);
    const auto episodes = folder.read("episodes.csv");
    const auto later = episodes + episodes.substr(episodes.rfind('\n', episodes.size() - 2) + 1);
    folder.write("episodes.csv", later);
    std::filesystem::remove(folder / "progress.csv");
    EXPECT_EQ(train_sac({"--resume", "--run-dir", folder.path().string(), "--no-progress"}).code, 3);
    EXPECT_EQ(folder.read("episodes.csv"), later);
}

TEST(ProgramEmulator, ARunThatCannotBeResumedStaysFinished) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path(), {"log.every=4"})).code, 0);
    const std::vector<std::string> resume = {"--resume", "--run-dir", folder.path().string(),
                                             "--no-progress"};
    for (const auto* name : {"progress.csv", "episodes.csv"}) {
        const auto whole = folder.read(name);
        folder.write(name, "");
        const auto cut = train_sac(resume);
        EXPECT_EQ(cut.code, 3);
        EXPECT_THAT(cut.stderr_text,
                    testing::EndsWith("was cut or replaced since; restore it, or start a new run\n"));
        std::filesystem::remove(folder / name);
        const auto refused = train_sac(resume);
        EXPECT_EQ(refused.code, 3);
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr(std::string(name) + " is missing, which had "));
        EXPECT_THAT(refused.stderr_text, testing::EndsWith(": restore it, or start a new run\n"));
        folder.write(name, whole);
    }
    const auto whole = folder.read("episodes.csv");
    auto damaged = whole;  // and as long
    damaged.replace(damaged.find("\nr,l,t,"), 7, "\nq,l,t,");
    folder.write("episodes.csv", damaged);
    const auto refused = train_sac(resume);
    EXPECT_EQ(refused.code, 3);
    EXPECT_THAT(refused.stderr_text, testing::HasSubstr("episodes.csv is not an episodes.csv: its header "));
    EXPECT_THAT(refused.stderr_text, testing::EndsWith("; restore it, or start a new run\n"));
    folder.write("episodes.csv", whole);
    EXPECT_EQ(metadata_of(folder.path())["finished"], true);
    EXPECT_EQ(metadata_of(folder.path())["stopped"], nullptr);
}

TEST(ProgramEmulator, AConfigurationThatWasCutShortIsNotContinuedWithDefaults) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto whole = folder.read("config.yaml");
    const std::vector<std::string> resume = {"--resume", "--run-dir", folder.path().string(),
                                             "--no-progress"};
    const auto train = whole.find("\ntrain:\n");
    ASSERT_NE(train, whole.npos);
    for (const auto size : {train + 1, std::size_t{0}}) {
        folder.write("config.yaml", whole.substr(0, size));
        const auto refused = train_sac(resume);
        EXPECT_EQ(refused.code, 3);
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr("config.yaml lacks "));
        EXPECT_THAT(refused.stderr_text, testing::EndsWith("/config.yaml there\n"));
        EXPECT_EQ(folder.read("config.yaml"), whole.substr(0, size));
    }
    folder.write("config.yaml", whole.substr(0, whole.find("total_steps: ") + 6));
    EXPECT_THAT(train_sac(resume).stderr_text,
                testing::EndsWith("; the run's checkpoints have copies of it\n"));
    folder.write("config.yaml", whole);
    EXPECT_EQ(train_sac(resume).code, 0);
}

TEST(ProgramEmulator, ACheckpointsFolderIsNoRunsAndStaysAsItIs) {
    const TemporaryFolder folder;
    const auto run = std::filesystem::canonical(folder.path()) / "run";
    ASSERT_EQ(train_sac(small(run)).code, 0);
    for (const auto* inside : {"checkpoints/step_000000012", "checkpoints/step_000000012/", "checkpoints"}) {
        const auto answer = train_sac({"--resume", "--run-dir", (run / inside).string()});
        EXPECT_EQ(answer.code, 3);
        EXPECT_EQ(answer.stderr_text,
                  fmt::format("train_sac: {} is a part of the run {}; give --run-dir that\n",
                              (run / inside).string(), run.string()));
        EXPECT_FALSE(std::filesystem::exists(run / inside / ".lock"));
    }
}

TEST(ProgramEmulator, ComputesInBf16WhereTheProcessorDoes) {
    const TemporaryFolder folder;
    const auto answer = train_sac(small(folder.path() / "run", {"train.precision=bf16"}));
    if (multiplies_bf16()) {
        EXPECT_EQ(answer.code, 0) << answer.stderr_text;
    } else {
        EXPECT_EQ(answer.code, 2);
        EXPECT_THAT(answer.stderr_text,
                    testing::HasSubstr("train.precision: bf16 is slower than float32 on this processor"));
        EXPECT_FALSE(std::filesystem::exists(folder.path() / "run"));
    }
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

    const auto longer = train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20",
                                   "env.game=ALE/Pong-v5", "--no-progress"});
    EXPECT_EQ(longer.code, 0) << longer.stderr_text;
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "checkpoints" / "step_000000020"));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 20"));
}

TEST(ProgramEmulator, SaysThatARunContinuesOnAnotherDevice) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto resume = [&](int steps) {
        return train_sac({"--resume", "--run-dir", folder.path().string(), "--no-progress", "--device", "cpu",
                          fmt::format("train.total_steps={}", steps)});
    };
    auto metadata = metadata_of(folder.path());
    metadata["device"] = "cuda:0";
    write_file_atomically(folder.path() / "metadata.json", metadata.dump());
    const auto moved = resume(15), stayed = resume(20);
    EXPECT_EQ(moved.code, 0) << moved.stderr_text;
    EXPECT_THAT(moved.stderr_text, testing::HasSubstr("the run was trained on cuda:0 and continues on cpu"));
    EXPECT_EQ(stayed.code, 0) << stayed.stderr_text;
    EXPECT_THAT(stayed.stderr_text, testing::Not(testing::HasSubstr("continues on")));
}

TEST(ProgramEmulator, ACheckpointWhoseConfigurationIsDamagedIsPassedOver) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path(), {"train.checkpoint_every=6"})).code, 0);
    const auto file = folder.path() / "checkpoints/step_000000012/config.yaml";
    const auto whole = read_file(file);
    const auto agent = whole.find("\nagent:\n");
    ASSERT_NE(agent, whole.npos);
    for (const auto& damaged : {whole.substr(0, agent + 1), std::string()}) {
        write_file_atomically(file, damaged);
        const TemporaryFolder copy;
        std::filesystem::copy(folder.path(), copy.path(), std::filesystem::copy_options::recursive);
        const auto resumed = train_sac(resuming(copy.path(), 20, {}));
        EXPECT_EQ(resumed.code, 0) << resumed.stderr_text;
        EXPECT_THAT(resumed.stderr_text, testing::HasSubstr("Resumed at agent step 6"));
    }
}

TEST(ProgramEmulator, SettingsAreComparedWithThoseOfTheCheckpointThatIsResumedFrom) {
    const TemporaryFolder folder;
    const auto run = folder.path();
    ASSERT_EQ(train_sac(small(run, {"train.checkpoint_every=6"})).code, 0);
    // The newest checkpoint is written again, with the change.
    ASSERT_EQ(train_sac(resuming(run, 12, {"--accept-changes", "agent.learning_rate=0.5"})).code, 0);
    std::filesystem::resize_file(run / "checkpoints/step_000000012/games.safetensors", 20);
    const auto resumed = train_sac(resuming(run, 12, {}));
    EXPECT_EQ(resumed.code, 0) << resumed.stderr_text;
    EXPECT_THAT(resumed.stderr_text, testing::HasSubstr("changed in mid-run: agent.learning_rate was "))
        << "of steps 7 to 12, which are trained again";
    EXPECT_THAT(resumed.stderr_text, testing::HasSubstr("Resumed at agent step 6"));

    std::filesystem::resize_file(run / "checkpoints/step_000000012/games.safetensors", 20);
    const auto shorter = train_sac(resuming(run, 8, {}));
    EXPECT_EQ(shorter.code, 0) << "it is at step 6: " << shorter.stderr_text;
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
    EXPECT_THAT(other_game.stderr_text,
                testing::HasSubstr("cannot be continued in another environment: env.game"));
    EXPECT_THAT(read_file(folder.path() / "metadata.json"),
                testing::Not(testing::HasSubstr("accepted_changes")));

    const auto other_seed = resume({"train.seed=9"});
    EXPECT_EQ(other_seed.code, 3);
    EXPECT_THAT(other_seed.stderr_text, testing::HasSubstr("continue from its checkpoint, whatever its seed: "
                                                           "train.seed was"));

    const auto changed = resume({"agent.learning_rate=0.5"});
    EXPECT_EQ(changed.code, 0) << changed.stderr_text;
    EXPECT_THAT(changed.stderr_text, testing::HasSubstr("changed in mid-run: agent.learning_rate was"));
    EXPECT_THAT(read_file(folder.path() / "metadata.json"), testing::HasSubstr("agent.learning_rate was"));
    const auto misfit = resume({"agent.hidden_units=9"});
    EXPECT_EQ(misfit.code, 3) << "another network";
    EXPECT_THAT(
        misfit.stderr_text,
        testing::HasSubstr("agent.hidden_units was 8 and is now 9, which what is stored may not fit: "));
    EXPECT_THAT(misfit.stderr_text, testing::Not(testing::HasSubstr("move it away")))
        << "the one before fits no more";
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("hidden_units: 8"));
    EXPECT_EQ(train_sac(small(folder.path() / "new", {"--accept-changes"})).code, 2);
}

/// A run of three rollouts with a small network.
std::vector<std::string> small_ppo(const std::filesystem::path& run_dir, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"--run-dir",
                                          run_dir.string(),
                                          "--threads",
                                          "1",
                                          "--no-progress",
                                          "agent.encoder=data_efficient",
                                          "agent.hidden_units=8",
                                          "agent.rollout_steps=8",
                                          "agent.minibatch_size=4",
                                          "agent.epochs=1",
                                          "train.total_steps=24",
                                          "eval.episodes=0"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
}

TEST(ProgramEmulator, OverlapIsForEveryAgent) {
    const TemporaryFolder folder;
    EXPECT_EQ(train_sac(small(folder.path() / "sac", {"train.overlap=true"})).code, 0);
    EXPECT_EQ(train("ppo", make_ppo, small_ppo(folder.path() / "ppo", {"train.overlap=true"})).code, 0);
}

TEST(ProgramEmulator, ARunWhoseScheduleLastsForAllOfItIsLengthenedOnlyWhenToldTo) {
    const TemporaryFolder folder;
    const auto lengthened = [](const std::filesystem::path& run, const std::vector<std::string>& more = {}) {
        return train("ppo", make_ppo, resuming(run, 32, more));
    };
    const auto annealed = folder.path() / "annealed";
    ASSERT_EQ(train("ppo", make_ppo, small_ppo(annealed)).code, 0);
    const auto refused = lengthened(annealed);
    EXPECT_EQ(refused.code, 3);
    EXPECT_THAT(refused.stderr_text,
                testing::HasSubstr("train.total_steps was 24 and is now 32, which changes the schedule of "
                                   "agent.anneal_learning_rate; resume with the run's own"));
    EXPECT_THAT(refused.stderr_text, testing::HasSubstr("say --accept-changes"));
    const auto accepted = lengthened(annealed, {"--accept-changes"});
    EXPECT_EQ(accepted.code, 0) << accepted.stderr_text;
    EXPECT_THAT(read_file(annealed / "metadata.json"), testing::HasSubstr("train.total_steps was 24"));
    EXPECT_EQ(lengthened(annealed).code, 0) << "accepted once is enough";

    for (const std::string constant : {"agent.anneal_learning_rate=false", "agent.anneal_steps=5"}) {
        const auto run = folder.path() / constant;
        ASSERT_EQ(train("ppo", make_ppo, small_ppo(run, {constant})).code, 0);
        const auto answer = lengthened(run);
        EXPECT_EQ(answer.code, 0) << constant << ": " << answer.stderr_text;
    }
}

TEST(ProgramEmulator, ARunSaysWhichScheduleLastsForAllOfIt) {
    const TemporaryFolder folder;
    const auto metadata = [&](const std::string& run) {
        return read_file(folder.path() / run / "metadata.json");
    };
    ASSERT_EQ(train_sac(small(folder.path() / "sac")).code, 0);
    EXPECT_THAT(metadata("sac"), testing::HasSubstr("\"schedule_over_run\": \"\""));
    ASSERT_EQ(train("ppo", make_ppo, small_ppo(folder.path() / "ppo")).code, 0);
    EXPECT_THAT(metadata("ppo"), testing::HasSubstr("\"schedule_over_run\": \"agent.anneal_learning_rate\""));
    const auto run = (folder.path() / "ppo").string();
    ASSERT_EQ(train("ppo", make_ppo,
                    {"--resume", "--run-dir", run, "--no-progress", "--accept-changes",
                     "agent.anneal_learning_rate=false"})
                  .code,
              0);
    EXPECT_THAT(metadata("ppo"), testing::HasSubstr("\"schedule_over_run\": \"\""));
}

TEST(Program, SettingsThatDoNotFitTogetherAreRefusedBeforeTheyArePrinted) {
    const auto print = [](std::vector<std::string> settings) {
        settings.insert(settings.begin(), "--print-config");
        testing::internal::CaptureStdout();
        auto answer = train("ppo", make_ppo, settings);
        return std::pair(answer, testing::internal::GetCapturedStdout());
    };
    const auto [fine, printed] = print({"agent.minibatch_size=128"});
    EXPECT_EQ(fine.code, 0) << fine.stderr_text;
    EXPECT_THAT(printed, testing::HasSubstr("minibatch_size: 128"));
    const std::string multiple = "agent.rollout_steps is 1024, which is no multiple of ";
    for (const auto& [settings, sentence] : std::vector<std::pair<std::vector<std::string>, std::string>>{
             {{"agent.minibatch_size=300"}, multiple + "agent.minibatch_size = 300; change one of the two"},
             {{"env.num_envs=3"}, multiple + "env.num_envs = 3; change one of the two"},
             {{"agent.replay_terminal=dopamine", "env.num_envs=2"},
              "dopamine is a rule for env.num_envs = 1"},
             {{"agent.stack_after_update=repeated", "env.num_envs=2"}, "repeated is for env.num_envs = 1"}}) {
        const auto [refused, nothing] = print(settings);
        EXPECT_EQ(refused.code, 2) << sentence;
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr("train_ppo: ")) << sentence;
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr(sentence));
        EXPECT_EQ(nothing, "");
    }
    for (const auto& [setting, sentence] : std::vector<std::pair<std::string, std::string>>{
             {"env.action_space=minimal", "set env.action_space to continuous"},
             {"env.paddle=absolute", "MsPacman has no paddle"},
             {"env.stick_damping=1", "env.stick_damping is set, but env.stick_speed is none"},
             {"env.obs=ram", "set agent.encoder to mlp or flat, or env.obs to pixels"}}) {
        const auto refused = train_sac({"--print-config", "env.game=ms_pacman", setting});
        EXPECT_EQ(refused.code, 2) << setting;
        EXPECT_THAT(refused.stderr_text, testing::HasSubstr(sentence));
    }
}

TEST(ProgramEmulator, SettingsThatWereEditedInTheRunsFolderAreAnotherConfiguration) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto config = folder.path() / "config.yaml";
    const auto settings = read_file(config);
    const auto resume = [&](const std::vector<std::string>& more = {}) {
        return train_sac(resuming(folder.path(), 20, more));
    };
    write_file_atomically(config, settings + "\n");  // says the same
    EXPECT_EQ(resume().code, 0);
    auto edited = settings;
    edited.replace(edited.find("gamma: 0.99"), 11, "gamma: 0.5 ");
    EXPECT_THAT(resume({"agent.gamma=0.5"}).stderr_text,
                testing::EndsWith("as it was), say --accept-changes, or start a new run\n"));
    EXPECT_THAT(resume({"env.noop_max=3"}).stderr_text, testing::EndsWith("as it was) or start a new run\n"));
    const auto eval = settings.find("\neval:\n") + 7;
    for (const auto& [text, sentence] : {std::pair(edited, "another configuration: agent.gamma was 0.99"),
                                         {std::string(), "config.yaml lacks "},
                                         {settings.substr(0, eval), "config.yaml lacks "},
                                         {settings.substr(0, eval) + "  # agent st", "config.yaml lacks "}}) {
        write_file_atomically(config, text);
        const auto answer = resume();
        EXPECT_EQ(answer.code, 3);
        EXPECT_THAT(answer.stderr_text, testing::HasSubstr(sentence));
    }
    write_file_atomically(config, settings);
    ASSERT_EQ(resume({"--accept-changes", "agent.learning_rate=0.5"}).code, 0);
    EXPECT_EQ(resume().code, 0) << "accepted once is enough";
}

TEST(ProgramEmulator, AChangeIsAcceptedOnceAlsoWhereNoCheckpointHasIt) {
    const TemporaryFolder folder;
    const TemporaryFolder before;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto checkpoints = folder.path() / "checkpoints";
    std::filesystem::copy(checkpoints, before.path() / "checkpoints",
                          std::filesystem::copy_options::recursive);
    ASSERT_EQ(train_sac(resuming(folder.path(), 12, {"--accept-changes", "agent.learning_rate=0.5"})).code,
              0);
    // As if it had been killed before it wrote a checkpoint.
    std::filesystem::remove_all(checkpoints);
    std::filesystem::copy(before.path() / "checkpoints", checkpoints,
                          std::filesystem::copy_options::recursive);
    EXPECT_EQ(train_sac(resuming(folder.path(), 20, {"agent.learning_rate=0.25"})).code, 3);
    const auto resumed = train_sac(resuming(folder.path(), 20, {}));
    EXPECT_EQ(resumed.code, 0) << resumed.stderr_text;
    EXPECT_THAT(read_file(checkpoints / "step_000000020/config.yaml"),
                testing::HasSubstr("learning_rate: 0.5"));
}

TEST(ProgramEmulator, AFinishedRunIsNotEvaluatedAgain) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path(),
                              {"eval.episodes=1", "eval.video=false", "env.max_frames_per_episode=60"}))
                  .code,
              0);
    const auto table = folder.path() / "eval/step_000000012.csv";
    const auto played = read_file(table);
    write_file_atomically(table, "kept");
    const auto again = train_sac(resuming(folder.path(), 12, {}));
    EXPECT_EQ(again.code, 0) << again.stderr_text;
    EXPECT_EQ(read_file(table), "kept");
    EXPECT_EQ(metadata_of(folder.path())["finished"], true);
    std::filesystem::remove(table);
    EXPECT_EQ(train_sac(resuming(folder.path(), 12, {})).code, 0);
    EXPECT_EQ(read_file(table), played) << "what is missing is played";
    EXPECT_EQ(train_sac(resuming(folder.path(), 12, {"eval.episodes=2"})).code, 0);
    EXPECT_NE(read_file(table), played) << "and what is asked for anew";
}

TEST(ProgramEmulator, ALastEvaluationThatWasDueIsNotPlayedAgainEither) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path(), {"eval.episodes=1", "eval.every=6", "eval.video=false",
                                              "env.max_frames_per_episode=60"}))
                  .code,
              0);
    const auto table = folder.path() / "eval/step_000000012.csv";
    write_file_atomically(table, "kept");
    EXPECT_EQ(train_sac(resuming(folder.path(), 12, {})).code, 0);
    EXPECT_EQ(read_file(table), "kept");
    std::filesystem::remove(table);
    EXPECT_EQ(train_sac(resuming(folder.path(), 12, {})).code, 0);
    const auto lines = [&] {
        const auto text = read_file(table);
        return std::count(text.begin(), text.end(), '\n');
    };
    const auto with_one_game = lines();
    EXPECT_EQ(train_sac(resuming(folder.path(), 12, {"eval.episodes=3"})).code, 0);
    EXPECT_EQ(lines(), with_one_game + 2) << "what is asked for anew is played";
}

TEST(ProgramEmulator, ACheckpointThatCannotBeReadNowIsNoReasonToGiveTheRunUp) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto file = folder.path() / "checkpoints/step_000000012/policy.safetensors";
    const auto whole = read_file(file);
    std::filesystem::remove(file);
    std::filesystem::create_symlink(file, file);  // its reading fails as the system says
    const auto refused = train_sac(resuming(folder.path(), 20, {}));
    EXPECT_EQ(refused.code, 1);
    EXPECT_THAT(refused.stderr_text, testing::HasSubstr("step_000000012 cannot be read now: "));
    std::filesystem::remove(file);
    write_file_atomically(file, whole);
    EXPECT_EQ(train_sac(resuming(folder.path(), 20, {})).code, 0);
}

TEST(ProgramEmulator, ARunCannotBecomeShorterThanItIs) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const auto shorter =
        train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=5", "--no-progress"});
    EXPECT_EQ(shorter.code, 3);
    EXPECT_THAT(shorter.stderr_text,
                testing::HasSubstr("it is at agent step 12 already, and train.total_steps is 5"));
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 12"));
}

TEST(ProgramEmulator, ARunOfSeveralEnvironmentsCanBeResumedWhereItEnded) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path(), {"env.num_envs=5"})).code, 0);
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "checkpoints/step_000000015")) << "of 12";
    EXPECT_EQ(train_sac(resuming(folder.path(), 12, {})).code, 0);
    EXPECT_EQ(train_sac(resuming(folder.path(), 10, {})).code, 3);
}

TEST(ProgramEmulator, AFolderThatCannotBeMadeIsNamed) {
    const TemporaryFolder folder;
    const auto file = folder.write("file", "");
    const auto answer = train_sac(small(file / "run"));
    EXPECT_EQ(answer.code, 2);
    EXPECT_THAT(answer.stderr_text, testing::HasSubstr("--run-dir " + (file / "run").string() +
                                                       ": the folder cannot be made (Not a directory)"));
}

TEST(ProgramEmulator, ARunIsTrainedByOneProcessAtATime) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path())).code, 0);
    const RunLock lock(folder.path());
    const auto second = train_sac({"--resume", "--run-dir", folder.path().string(), "train.total_steps=20"});
    EXPECT_EQ(second.code, 1);
    EXPECT_THAT(second.stderr_text, testing::HasSubstr("is training in " + folder.path().string()));
    EXPECT_THAT(train_sac(small(folder.path())).stderr_text,
                testing::HasSubstr(": another process is training in there;"))
        << "which no --resume would help";
    EXPECT_THAT(read_file(folder.path() / "config.yaml"), testing::HasSubstr("total_steps: 12"));
}

// ---- cale -----------------------------------------------------------------------------

struct Said {
    int code = 0;
    std::string text{};  // on both outputs
};

Said shell_says(const std::string& command) {
    std::FILE* const pipe = ::popen(command.c_str(), "r");
    Said said;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) said.text.push_back(static_cast<char>(c));
    said.code = WEXITSTATUS(::pclose(pipe));
    return said;
}

/// The program `cale`, in `folder`, with a shell's words.
Said cale_says(const std::string& words, const std::filesystem::path& folder = ".") {
    return shell_says(
        fmt::format("cd '{}' && {}/cale {} 2>&1 < /dev/null", folder.string(), CALE_BINARY_DIR, words));
}

TEST(ProgramEmulator, ARunThatAFullDiskStopsSaysHowToResumeIt) {
    const TemporaryFolder folder;
    const auto run = (folder.path() / "run").string();
    ASSERT_EQ(train_sac(small(run, {"--until", "4"})).code, 0);
    // A limit on the size of files stands in for the disk: config.yaml may be so long, a checkpoint may not.
    const auto command =
        fmt::format("{}/train_sac --resume --run-dir '{}' --no-progress 2>&1", CALE_BINARY_DIR, run);
    const auto stopped = shell_says("ulimit -f 32; " + command);
    EXPECT_EQ(stopped.code, 1);
    EXPECT_THAT(stopped.text,
                testing::EndsWith(": File too large; then resume with --resume --run-dir " + run + "\n"));
    const auto resumed = shell_says(command);
    EXPECT_EQ(resumed.code, 0) << resumed.text;
    EXPECT_EQ(metadata_of(run)["finished"], true);
}

TEST(CaleProgram, MistakesAreOneSentenceAndExitCode2) {
    for (
        const auto& [words, sentence] : std::vector<std::pair<std::string, std::string>>{
            {"evalute", "cale: unknown command 'evalute'; did you mean 'evaluate'?"},
            {"nosuch", "cale: unknown command 'nosuch'; cale --help lists them"},
            {"train_sac",
             "cale: train_sac is a program of its own: train_sac env.game=pong (see train_sac --help)"},
            {"der x",
             "cale: train_der is a program of its own: train_der env.game=pong (see train_der --help)"},
            {"train",
             "cale: unknown command 'train'; agents are trained by programs of their own: train_sac, "
             "train_sacd, "
             "train_ppo, train_dqn, train_der"},
            {"--verson", "cale: unknown option '--verson'; did you mean '--version'? (see cale --help)"},
            {"evaluate", "cale evaluate: POLICY is missing (see cale evaluate --help)"},
            {"evaluate --frobnicate",
             "cale evaluate: unknown option '--frobnicate' (see cale evaluate --help)"},
            {"evaluate x --epislon=0",
             "cale evaluate: unknown option '--epislon'; did you mean '--epsilon'? (see cale evaluate "
             "--help)"},
            {"evaluate x env.game=pong",
             "cale evaluate: unexpected argument 'env.game=pong'; settings are given as --set KEY=VALUE (see "
             "cale evaluate --help)"},
            {"evaluate x --seed", "cale evaluate: --seed needs a value (see cale evaluate --help)"},
            {"evaluate x --seed 1 --seed 2",
             "cale evaluate: --seed is given more than once (see cale evaluate --help)"},
            {"evaluate x --video=maybe", "cale evaluate: --video takes no value (see cale evaluate --help)"},
            {"report --strict=yes x", "cale report: --strict takes no value (see cale report --help)"},
            {"stick --set flavour=sweet",
             "cale stick: --set flavour=sweet: unknown key 'flavour'; train_sac --help lists env.*"},
            {"evaluate x --greedy --sampled", "cale evaluate: --greedy excludes --sampled: give one of them"},
            {"evaluate x --protocol fixed_step",
             "cale evaluate: --protocol is 'fixed_step': give fixed_episodes or fixed_steps; did you mean "
             "'fixed_steps'?"},
            {"evaluate x --out ''", "cale evaluate: --out is '': give DIR, or leave it out"},
            {"evaluate x --out --video", "cale evaluate: --out is '--video': give DIR, or leave it out"},
            {"map -o ''", "cale map: --output is '': give FILE, or leave it out"},
            {"evaluate x --video-episode 3",
             "cale evaluate: --video-episode requires --video: give both, or neither"},
            {"report x --baselines-file y",
             "cale report: --baselines-file requires --baselines: give both, or neither"},
            {"evaluate x --device foo",
             "cale evaluate: --device must be auto, cpu, cuda or cuda:<index>, not 'foo'"},
            {"play", "cale play: give a GAME, a --policy FILE, or both"},
            {"play pong --greedy", "cale play: --greedy requires --policy: give both, or neither"},
            {"games road", "cale games: there is no game 'road'; did you mean road_runner?"},
            {"games --rom-dir /nowhere", "cale games: --rom-dir /nowhere: there is no such folder"},
            {"map -o map.pdf", "cale map: --output map.pdf: a picture's name must end in .svg or .png"},
            {"stick --set env.game=breakout --set env.paddle=absolute",
             "cale stick: env.paddle=absolute: the paddle is placed, and no stick moves it; leave it out"},
            {"stick --set env.game=pnog", "cale stick: there is no game 'pnog'; did you mean pong?"},
            {"map -o .", "cale map: --output .: that is a folder; give the name of a file"},
            {"export x",
             "cale export: give --output FILE, the file to write, or --web DIR, the folder for a page"},
            {"export x -o y --web z", "cale export: --output excludes --web: give one of them"},
            {"sweep x --status --dry-run", "cale sweep: --dry-run excludes --status: give one of them"},
            {"sweep x --sbatch-option=--time=8:00:00", "cale sweep: --sbatch-option is for --launcher slurm"},
            {"export x -o /nowhere/x",
             "cale export: --output /nowhere/x: there is no folder '/nowhere'; make it, or give another"}}) {
        const auto said = cale_says(words);
        EXPECT_EQ(said.text, sentence + "\n");
        EXPECT_EQ(said.code, 2) << words;
    }
}

TEST(CaleProgram, AnEvaluationChoosesItsActionsAsItIsTold) {
    const TemporaryFolder folder;
    ASSERT_EQ(train("ppo", make_ppo, small_ppo(folder.path() / "ppo")).code, 0);
    ASSERT_EQ(train_sac(small(folder.path() / "sac")).code, 0);
    // With neither sticky actions nor no-ops a game depends on what the policy chooses alone.
    const auto events = [&](const std::string& out, const std::string& words) {
        const auto said = cale_says("evaluate " + words +
                                        " --episodes 1 --noop-max 0 --set env.sticky_probability=0 --set "
                                        "env.max_frames_per_episode=80 --out " +
                                        out,
                                    folder.path());
        EXPECT_EQ(said.code, 0) << said.text;
        return folder.read(out + "/evaluation_events.csv");
    };
    const auto choice = [&](const std::string& out) {
        return nlohmann::json::parse(folder.read(out + "/evaluation.json")).at("choice");
    };
    const auto own = events("own", "ppo --epsilon 0");
    EXPECT_EQ(choice("own"), "sampled");
    EXPECT_EQ(events("sampled", "ppo --epsilon 0 --sampled"), own);
    EXPECT_NE(events("other_seed", "ppo --epsilon 0 --seed 2"), own);
    const auto greedy = events("greedy", "ppo --epsilon 0 --greedy");
    EXPECT_EQ(choice("greedy"), "greedy");
    EXPECT_EQ(events("greedy_other_seed", "ppo --epsilon 0 --greedy --seed 2"), greedy);
    EXPECT_NE(events("random", "ppo --epsilon 1 --greedy"), greedy);
    events("sac_greedy", "sac --epsilon 0");
    EXPECT_EQ(choice("sac_greedy"), "greedy");
    events("sac_sampled", "sac --epsilon 0 --sampled");
    EXPECT_EQ(choice("sac_sampled"), "sampled");
}

TEST(CaleProgram, AnEvaluationThatCannotBeWrittenIsShown) {
    const TemporaryFolder folder;
    const auto command = fmt::format(
        "cd '{}' && ulimit -f 0 && {}/cale evaluate {}/policies/boxing_sac.safetensors --episodes 1 --set "
        "env.max_frames_per_episode=40 --out games 2>&1 | cat",
        folder.path().string(), CALE_BINARY_DIR, CALE_SOURCE_DIR);
    const auto said = shell_says(command).text;
    EXPECT_THAT(said, testing::HasSubstr("return, mean"));
    EXPECT_THAT(said, testing::HasSubstr("File too large"));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "games"));
}

TEST(CaleProgram, APolicySeesLostLivesAsInItsTrainingWhateverIsSet) {
    const TemporaryFolder folder;
    ASSERT_EQ(
        train_sac(small(folder.path() / "run", {"env.game=breakout", "env.terminal_on_life_loss=true"})).code,
        0);
    const auto evaluated = [&](const std::string& out, const std::string& words) {
        const auto said =
            cale_says("evaluate run --sampled --episodes 1 --noop-max 0 --out " + out + words, folder.path());
        EXPECT_EQ(said.code, 0) << said.text;
        return said.text;
    };
    const std::string note = "cale evaluate: env.terminal_on_life_loss=false is not applied: ";
    EXPECT_EQ(cale_says("evaluate run --out no --set env.noop_max=3", folder.path()).text,
              "cale evaluate: --set env.noop_max=3: no-ops are given by --noop-max\n");
    EXPECT_THAT(evaluated("as_trained", ""), testing::Not(testing::HasSubstr(note)));
    EXPECT_THAT(evaluated("set", " --set env.terminal_on_life_loss=false"), testing::HasSubstr(note));
    const auto games = read_file(folder.path() / "as_trained" / "evaluation.csv");
    EXPECT_EQ(read_file(folder.path() / "set" / "evaluation.csv"), games);
    EXPECT_THAT(read_file(folder.path() / "set" / "evaluation.json"),
                testing::HasSubstr("\"env.terminal_on_life_loss\": \"true\""));
    // A step that a lost life cuts short has fewer than four frames.
    const auto row = games.substr(games.find('\n') + 1);
    double episode = 0, episode_return = 0, length = 0, frames = 0;
    ASSERT_EQ(std::sscanf(row.c_str(), "%lf,%lf,%lf,%lf", &episode, &episode_return, &length, &frames), 4)
        << row;
    EXPECT_LT(frames, 4 * length - 4) << "more than its last step was cut short";
}

TEST(CaleProgram, DrawsNothingFromActionValues) {
    const TemporaryFolder folder;
    ASSERT_EQ(train("dqn", make_dqn,
                    {"--run-dir", (folder.path() / "run").string(), "--threads", "1", "--no-progress",
                     "agent.encoder=data_efficient", "agent.hidden_units=8", "agent.replay_capacity=1000",
                     "train.total_steps=12", "eval.episodes=0"})
                  .code,
              0);
    const auto said = cale_says(
        "evaluate run --sampled --episodes 1 --steps 20 --protocol fixed_steps --out e", folder.path());
    EXPECT_EQ(said.code, 0) << said.text;
    EXPECT_THAT(said.text,
                testing::HasSubstr("cale evaluate: --sampled: this policy has action values, which "
                                   "are no distribution, and no noise: it plays greedily\n"));
    EXPECT_THAT(read_file(folder.path() / "e" / "evaluation.json"),
                testing::HasSubstr("\"choice\": \"greedy\""));
    const auto film = cale_says(
        "play --policy run/checkpoints/step_000000012/policy.safetensors --sampled "
        "--no-window --video f.mp4 --set env.max_frames_per_episode=40",
        folder.path());
    EXPECT_EQ(film.code, 0) << film.text;
    EXPECT_THAT(film.text, testing::HasSubstr("cale play: --sampled: this policy has action values"));
    EXPECT_EQ(cale_says("play run/config.yaml", folder.path()).text,
              "cale play: run/config.yaml is no game; a policy is given by --policy run/config.yaml\n");
}

TEST(EveryProgram, FailsWhereItsStandardOutputCannotBeWritten) {
    for (const std::string words :
         {"cale games", "cale games --csv", "cale games pong", "cale map", "cale --help", "cale games --help",
          "cale --version", "cale completion bash", "train_sac --help", "train_sac --version",
          "train_sac --print-config"}) {
        const auto said = shell_says(fmt::format("{}/{} 2>&1 > /dev/full", CALE_BINARY_DIR, words));
        EXPECT_EQ(said.code, 1) << words;
        EXPECT_THAT(said.text,
                    testing::ContainsRegex(
                        "^[a-z_ ]+: cannot write to the standard output: (No space left on device|part "
                        "of it is lost; is the disk full\\?)\n$"))
            << words;
    }
}

TEST(EveryProgram, WithoutStandardStreamsWritesItsTablesAndNothingElse) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    std::string words;
    for (const auto& word : small(run, {"log.every=4"})) words += " '" + word + "'";
    shell_says(fmt::format("{}/train_sac{} <&- >&- 2>&-", CALE_BINARY_DIR, words));
    for (const auto* name : {"episodes.csv", "progress.csv", ".lock"})
        for (const auto* printed : {"step ", "run folder"})
            EXPECT_THAT(read_file(run / name), testing::Not(testing::HasSubstr(printed))) << name;
    EXPECT_TRUE(std::filesystem::exists(run / "metadata.json"));
}

TEST(EveryProgram, TakesAConfigurationFromAnotherCommand) {
    const auto said = shell_says(
        fmt::format("bash -c '{}/train_sac --config <(echo \"train: {{seed: 77}}\") --print-config' 2>&1",
                    CALE_BINARY_DIR));
    EXPECT_EQ(said.code, 0) << said.text;
    EXPECT_THAT(said.text, testing::HasSubstr("seed: 77\n"));
    const auto endless = shell_says(fmt::format("{}/train_sac --config /dev/zero 2>&1", CALE_BINARY_DIR));
    EXPECT_EQ(endless.code, 2);
    EXPECT_EQ(
        endless.text,
        "train_sac: cannot read '/dev/zero': it is no regular file, and more comes out of it than 1048576 "
        "bytes\n");
}

TEST(CaleProgram, NumbersAreAllThatIsWritten) {
    const std::string whole = "give a whole number from ", any = "give a number from ";
    for (const auto& [words, way_out] : std::vector<std::pair<std::string, std::string>>{
             {"evaluate x --episodes x", whole + "1 to 1000000"},
             {"evaluate x --episodes 2.5", whole + "1 to 1000000"},
             {"evaluate x --seed -1", whole + "0 to 4294967295"},
             {"evaluate x --seed 99999999999999999999", whole},
             {"evaluate x --epsilon nan", any + "0 to 1"},
             {"evaluate x --epsilon 2", any + "0 to 1"},
             {"evaluate x --video --video-minutes nan", any},
             {"map --threshold nan", any + "0 to 1"},
             {"play pong --speed nan", any + "0 to 100"},
             {"play pong --seed -5", whole}}) {
        const auto said = cale_says(words);
        const auto value = words.substr(words.rfind(' ') + 1);
        EXPECT_THAT(said.text, testing::HasSubstr(" is '" + value + "': " + way_out)) << words;
        EXPECT_EQ(std::count(said.text.begin(), said.text.end(), '\n'), 1) << said.text;
        EXPECT_EQ(said.code, 2) << words;
    }
}

TEST(CaleProgram, HelpAndVersion) {
    const auto help = cale_says("--help");
    EXPECT_EQ(help.code, 0);
    EXPECT_EQ(cale_says("help").text, help.text);
    const auto nothing = cale_says("");
    EXPECT_EQ(nothing.text, help.text);
    EXPECT_EQ(nothing.code, 2);
    for (const std::string command : {"bench", "completion", "evaluate", "export", "fit-stick", "games",
                                      "map", "play", "report", "stick", "sweep"}) {
        const auto text = cale_says("help " + command).text;
        EXPECT_EQ(text, cale_says(command + " --help").text);
        EXPECT_THAT(text, testing::AllOf(testing::HasSubstr("Examples:\n  "),
                                         testing::HasSubstr("cale " + command + " "),
                                         testing::HasSubstr("Exit codes: 0 ")));
    }
    EXPECT_THAT(cale_says("--version").text,
                testing::MatchesRegex("cale [0-9.]+ \\(LibTorch [0-9.]+.*, ALE [0-9.]+\\)\n"));
}

TEST(CaleProgram, PlaysInNoWindowWhereThereIsNoDisplay) {
    const auto said = shell_says(fmt::format(
        "env -u DISPLAY -u WAYLAND_DISPLAY -u XDG_RUNTIME_DIR -u SDL_VIDEODRIVER {}/cale play pong 2>&1",
        CALE_BINARY_DIR));
    EXPECT_EQ(said.code, 1);
    EXPECT_THAT(said.text, testing::MatchesRegex("cale play: [^\n]*give --policy FILE[^\n]*\n"));
}

TEST(CaleProgram, CompletesTheSettingsOfAllAgentsForASweep) {
    const auto offered = [](const std::string& words) {
        return shell_says(fmt::format("bash -c 'source <({0}/cale completion bash); COMP_WORDS=(cale {1}); "
                                      "COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _cale 2>/dev/null; "
                                      "echo \"${{COMPREPLY[@]}}\"'",
                                      CALE_BINARY_DIR, words))
            .text;
    };
    EXPECT_EQ(offered("sweep --set train.se"), "train.seed=\n");
    EXPECT_EQ(offered("sweep --set env.game = paper"), "paper_ten\n");
    EXPECT_THAT(offered("sweep --set env.joystick = \"\""), testing::HasSubstr("factored"));
    EXPECT_EQ(offered("evaluate --set train.se"), "\n");
}

TEST(CaleProgram, APipedConfigurationExtendsAbsolutePaths) {
    const auto said = [](const std::string& base) {
        return shell_says(
            fmt::format("echo 'extends: {}' | {}/train_sac --config /dev/stdin --print-config 2>&1", base,
                        CALE_BINARY_DIR));
    };
    EXPECT_EQ(said(CALE_SOURCE_DIR "/configs/sac/atari100k.yaml").code, 0);
    const auto refused = said("configs/sac/atari100k.yaml");
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.text, testing::HasSubstr("'extends' must be an absolute path here"));
}

TEST(CaleProgram, FilesThatAreNoPolicyAreNotRead) {
    const TemporaryFolder folder;
    folder.write("text.txt", "A text, whose first letters would be a length of millions of gigabytes.");
    const auto text = cale_says("export text.txt -o out", folder.path());
    EXPECT_EQ(text.code, 1);
    EXPECT_THAT(text.text, testing::StartsWith("cale export: 'text.txt' is not a policy file: it does not"));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "out"));
    // /dev/zero would be read for ever.
    EXPECT_EQ(cale_says("evaluate /dev/null").text,
              "cale evaluate: '/dev/null' is not a policy file: it is no regular file\n");
}

TEST(CaleProgram, ExportReplacesWhatItWroteAndNothingElse) {
    const TemporaryFolder folder;
    const std::string export_to = "export " CALE_SOURCE_DIR "/policies/boxing_sac.safetensors -o ";
    const auto write = export_to + "mine.safetensors";
    const auto mine = folder.write("mine.safetensors", "another program's tensors");
    const auto refused = cale_says(write, folder.path());
    EXPECT_EQ(refused.code, 2);
    EXPECT_THAT(refused.text, testing::EndsWith("mine.safetensors is there, and no cale export has written "
                                                "it; give another\n"));
    std::filesystem::remove(mine);
    EXPECT_EQ(cale_says(write, folder.path()).code, 0);
    EXPECT_EQ(cale_says(write, folder.path()).code, 0) << "again";
    EXPECT_EQ(cale_says(write + " --format onnx", folder.path()).code, 0) << "in another format";
    EXPECT_EQ(cale_says(write + " --format onnx", folder.path()).code, 0) << "again";
    EXPECT_EQ(cale_says(export_to + "upper.ONNX", folder.path()).code, 0);
    std::ifstream model(folder.path() / "upper.ONNX", std::ios::binary);
    EXPECT_EQ(model.get(), 8) << "ONNX begins with its version, a policy file with a length";
    folder.write("step_000000100/manifest.json", "{}");
    const auto inside = cale_says(export_to + "step_000000100/policy.safetensors", folder.path());
    EXPECT_EQ(inside.code, 2);
    EXPECT_THAT(inside.text,
                testing::HasSubstr("policy.safetensors lies in a checkpoint, which would then be damaged"));
    folder.write("step_000000100/policy.safetensors", "");
    std::filesystem::create_symlink("step_000000100/policy.safetensors", folder.path() / "link.safetensors");
    EXPECT_EQ(cale_says(export_to + "link.safetensors", folder.path()).code, 2) << "it leads into one";
    folder.write("other.onnx", "pytorch: layer_norm.scale");
    EXPECT_EQ(cale_says("export mine.safetensors -o other.onnx", folder.path()).code, 2);
}

/// A run of SAC with one game behind it, of this return, as `cale report` reads it.
void write_run(const TemporaryFolder& folder, const std::string& name, const std::string& game, int seed,
               int game_return) {
    folder.write(name + "/episodes.csv",
                 fmt::format("#{{\"env_id\":\"ALE/{}-v5\",\"agent\":\"sac\",\"seed\":{}}}\n"
                             "r,l,t,global_step,frame,seed,env,truncated\n{},100,1.5,100,400,1,0,0\n",
                             game, seed, game_return));
    folder.write(name + "/config.yaml", "agent: {encoder: phi_sac}\n");
}

TEST(CaleProgram, AReportIsCalledAfterItsFirstRuns) {
    const TemporaryFolder folder;
    write_run(folder, "sweeps/encoders/a", "Pong", 1, -20);
    for (const std::string runs : {"sweeps/encoders", "sweeps/encoders/", "sweeps/encoders/a/.."}) {
        const auto said = cale_says("report --resamples 10 " + runs, folder.path());
        EXPECT_EQ(said.code, 0) << said.text;
        EXPECT_THAT(said.text, testing::HasSubstr("reports/encoders/report.html"));
        EXPECT_GT(std::filesystem::remove_all(folder.path() / "reports/encoders"), 1u) << runs;
    }
    EXPECT_EQ(cale_says("report sweeps -o sweeps/encoders/a/config.yaml", folder.path()).text,
              "cale report: --output sweeps/encoders/a/config.yaml: this folder cannot be made: Not a "
              "directory; give another\n");
    folder.write("sweeps/encoders/a/metadata.json", "{}");
    EXPECT_EQ(cale_says("report sweeps -o sweeps/encoders/a", folder.path()).text,
              "cale report: sweeps/encoders/a: it is the folder of a run; name another folder by --output\n");
}

TEST(CaleProgram, AReportThatIsStrictFailsWhereARunIsMissing) {
    const TemporaryFolder folder;
    const auto add_run = [&](const std::string& game, int seed) {
        write_run(folder, fmt::format("runs/{}{}", game, seed), game, seed, 1);
    };
    add_run("Pong", 1);
    add_run("Pong", 2);
    add_run("Boxing", 1);
    EXPECT_EQ(cale_says("report runs --resamples 10", folder.path()).code, 0);
    const auto incomplete = cale_says("report runs --resamples 10 --strict", folder.path());
    EXPECT_EQ(incomplete.code, 1);
    EXPECT_THAT(incomplete.text, testing::HasSubstr("1 run is missing:\n  sac on Boxing, seed 2\n"));
    EXPECT_THAT(incomplete.text,
                testing::HasSubstr("cale report: --strict: the grid of the runs is not complete"));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "reports/runs/report.html"));
    add_run("Boxing", 2);
    EXPECT_EQ(cale_says("report runs --resamples 10 --strict", folder.path()).code, 0);
}

TEST(CaleProgram, AReportHasTheScoresOfATableOfTheUsersBesideIt) {
    const TemporaryFolder folder;
    write_run(folder, "run", "Pong", 1, -20);
    folder.write("mine.csv", "\xef\xbb\xbfgame,mine\npong,10\n");
    const auto said =
        cale_says("report run --resamples 10 --baselines mine --baselines-file mine.csv", folder.path());
    EXPECT_EQ(said.code, 0) << said.text;
    EXPECT_THAT(read_file(folder.path() / "reports/run/report.html"), testing::HasSubstr("mine"));
    EXPECT_THAT(cale_says("report run --baselines m --baselines-file mine.csv", folder.path()).text,
                testing::HasSubstr("mine.csv has no such column; the nearest are mine"));
    const auto blanks = cale_says(
        "report run --resamples 10 --baselines 'cale, mine' --baselines-file mine.csv", folder.path());
    EXPECT_THAT(blanks.text, testing::HasSubstr("--baselines cale: mine.csv has no such column"));
    const auto listed = cale_says("report run --resamples 10 --group-by 'agent, colour'", folder.path());
    EXPECT_THAT(listed.text, testing::HasSubstr("--group-by colour: no run has such a setting"));
    const auto replaced = cale_says(
        "report run --resamples 10 --baselines sac --baselines-file "
        "reports/run/run_curves.csv",
        folder.path());
    EXPECT_EQ(replaced.code, 2);
    EXPECT_THAT(replaced.text,
                testing::HasSubstr("--baselines-file reports/run/run_curves.csv: it is in reports/run"));
    const auto piped =
        shell_says(fmt::format("cd '{}' && cat mine.csv | {}/cale report run --resamples 10 --baselines mine "
                               "--baselines-file /dev/stdin -o piped 2>&1",
                               folder.path().string(), CALE_BINARY_DIR));
    EXPECT_EQ(piped.code, 0) << piped.text;
}

TEST(CaleProgram, ACommandThatFailsLeavesNoEmptyFolder) {
    const TemporaryFolder folder;
    folder.write("policy.safetensors", "no policy");
    EXPECT_EQ(cale_says("export policy.safetensors --web new/page", folder.path()).code, 1);
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "new"));
}

TEST(CaleEmulator, EvaluatesAndExportsARun) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path() / "run")).code, 0);
    const std::string evaluates =
        "evaluate run --steps 1 --parallel 1 --protocol fixed_steps --set env.max_frames_per_episode=40";
    for (int i = 0; i < 2; ++i) ASSERT_EQ(cale_says(evaluates, folder.path()).code, 0);
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path() / "evaluations"), {}), 2)
        << "in the same second, too";
    EXPECT_EQ(cale_says("evaluate run --set agent.gamma=0.1", folder.path()).text,
              "cale evaluate: --set agent.gamma=0.1: nothing is trained here, so only settings env.* can be "
              "changed\n");
    folder.write("file", "");
    const auto no_folder = cale_says("evaluate run --out file", folder.path());
    EXPECT_EQ(no_folder.code, 2);
    EXPECT_THAT(no_folder.text, testing::StartsWith("cale evaluate: --out file: this folder cannot be made"));

    EXPECT_EQ(cale_says("export run -o run.onnx", folder.path()).code, 0);
    EXPECT_EQ(cale_says("export run -o run.safetensors", folder.path()).code, 0);
    EXPECT_EQ(cale_says("export run.safetensors -o again.onnx --format policy", folder.path()).code, 0);
    EXPECT_EQ(folder.read("again.onnx"), folder.read("run.safetensors"));
    EXPECT_THAT(cale_says("export run.onnx -o x", folder.path()).text,
                testing::HasSubstr("is not a policy file"));
}

TEST(CaleEmulator, EvaluatesEveryRunOfAFolderOnce) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path() / "runs" / "Pong__sac__1")).code, 0);
    ASSERT_EQ(train_sac(small(folder.path() / "runs" / "Pong__sac__10", {"--seed", "10"})).code, 0);
    folder.write("runs/Pong__sac__9/config.yaml", "");
    folder.write("runs/Pong__sac__9/episodes.csv", "");
    const std::string words = "evaluate runs --episodes 3 --parallel 1 --set env.max_frames_per_episode=40";
    const auto first = cale_says(words, folder.path());
    EXPECT_EQ(first.code, 1) << "one run has no checkpoint";
    EXPECT_THAT(first.text, testing::HasSubstr("runs        3, 0 of them evaluated already\n"));
    EXPECT_THAT(first.text, testing::HasSubstr("\nrun 1/3  1/3 games  return "));
    EXPECT_THAT(first.text, testing::HasSubstr("\n[1/3] Pong__sac__1: mean return "));
    EXPECT_THAT(first.text, testing::HasSubstr("\n[2/3] Pong__sac__9: no policy can be made of "));
    const auto table = first.text.substr(first.text.find("\nrun  "));
    EXPECT_THAT(table,
                testing::ContainsRegex("\nrun  [^\n]*\nPong__sac__1  [^\n]*\nPong__sac__9 +none: [^\n]*"
                                       "\nPong__sac__10  [^\n]*\n"));

    const auto again = cale_says(words, folder.path());
    EXPECT_EQ(again.text.find("games  return"), std::string::npos) << again.text;
    EXPECT_EQ(again.text.substr(again.text.find("\nrun  ")), table);

    EXPECT_THAT(cale_says(words + " --seed 2", folder.path()).text,
                testing::HasSubstr("0 of them evaluated already"))
        << "another protocol";

    const auto other = folder.path() / "other", replaced = folder.path() / "runs/Pong__sac__1";
    ASSERT_EQ(train_sac(small(other, {"--seed", "3"})).code, 0);
    std::filesystem::rename(replaced / "evaluations", other / "evaluations");
    std::filesystem::remove_all(replaced);
    std::filesystem::rename(other, replaced);
    const auto afterwards = cale_says(words, folder.path()).text;
    EXPECT_THAT(afterwards, testing::HasSubstr("3, 1 of them evaluated already")) << "another policy";
    EXPECT_THAT(afterwards, testing::HasSubstr("\n[1/3] Pong__sac__1: mean return "));

    // The games are those that each run's own evaluation has.
    const auto alone = cale_says(
        "evaluate runs/Pong__sac__10 --episodes 3 --parallel 1 --out alone --set "
        "env.max_frames_per_episode=40",
        folder.path());
    EXPECT_THAT(alone.text, testing::StartsWith("1/3 games  return "));
    int found = 0;
    for (const auto& place :
         std::filesystem::directory_iterator(folder.path() / "runs/Pong__sac__10/evaluations")) {
        if (read_file(place.path() / "protocol.json").find("\"seed\": 1,") == std::string::npos) continue;
        ++found;
        EXPECT_EQ(read_file(place.path() / "step_000000012.csv"), folder.read("alone/evaluation.csv"));
        EXPECT_FALSE(std::filesystem::exists(place.path() / "step_000000012.partial"));
    }
    EXPECT_EQ(found, 1);

    EXPECT_EQ(
        cale_says("evaluate runs --out x", folder.path()).text,
        "cale evaluate: --out: runs holds runs, whose evaluations are written into their own folders, "
        "without films and step logs; leave --out out, or name one of the runs, such as runs/Pong__sac__1\n");
    const auto report = cale_says("report runs --score evaluation --resamples 10", folder.path());
    EXPECT_EQ(report.code, 0) << report.text;
    EXPECT_THAT(read_file(folder.path() / "reports/runs/scores.csv"), testing::HasSubstr("Pong"));
}

/// What `command` wrote to the standard error before it was killed, which is once that has `lines` lines.
std::string killed_after(int lines, const std::string& command) {
    int ends[2] = {};
    EXPECT_EQ(::pipe(ends), 0);
    const pid_t child = ::fork();
    if (child == 0) {
        ::dup2(ends[1], STDERR_FILENO);
        ::close(ends[0]);
        ::execl("/bin/sh", "sh", "-c", ("exec " + command).c_str(), nullptr);
        ::_exit(127);
    }
    ::close(ends[1]);
    std::FILE* const pipe = ::fdopen(ends[0], "r");
    std::string text;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) {
        text.push_back(static_cast<char>(c));
        if (c == '\n' && --lines == 0) ::kill(child, SIGKILL);
    }
    std::fclose(pipe);
    ::waitpid(child, nullptr, 0);
    return text;
}

TEST(CaleEmulator, AKilledEvaluationOfRunsContinuesInMidRun) {
    const TemporaryFolder folder;
    for (const auto* runs : {"whole", "killed"})
        ASSERT_EQ(train_sac(small(folder.path() / runs / "run")).code, 0);
    const auto words = [&](const std::string& runs) {
        return fmt::format("evaluate {}/{} --episodes 6 --parallel 1 --set env.max_frames_per_episode=40",
                           folder.path().string(), runs);
    };
    ASSERT_EQ(cale_says(words("whole")).code, 0);
    // Four lines of the header, and one for the first game.
    const auto before = killed_after(5, fmt::format("{}/cale {}", CALE_BINARY_DIR, words("killed")));
    const auto after = cale_says(words("killed"));
    EXPECT_EQ(after.code, 0) << after.text;
    const auto games_in = [](std::string_view text) {
        int games = 0;
        for (auto at = text.find(" games  return "); at != text.npos;
             at = text.find(" games  return ", at + 1))
            ++games;
        return games;
    };
    EXPECT_GE(games_in(before), 1) << before;
    EXPECT_LT(games_in(before), 6) << "it was killed too late";
    EXPECT_LE(games_in(before) + games_in(after.text), 6) << "none is played twice\n" << before << after.text;
    const auto tables = [&](const char* runs) {
        std::map<std::string, std::string> files;
        for (const auto& file :
             std::filesystem::recursive_directory_iterator(folder.path() / runs / "run/evaluations"))
            if (file.path().extension() == ".csv") files[file.path().filename()] = read_file(file.path());
        return files;
    };
    EXPECT_EQ(tables("killed").size(), 3u);
    EXPECT_EQ(tables("killed"), tables("whole"));
}

TEST(CaleEmulator, AFoldersNameNeedNotBeUtf8) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "m\xfcller";
    ASSERT_EQ(train_sac(small(run)).code, 0);
    const auto resumed =
        train_sac({"--resume", "--run-dir", run.string(), "train.total_steps=20", "--no-progress"});
    EXPECT_EQ(resumed.code, 0) << resumed.stderr_text;
    const auto evaluated =
        cale_says("evaluate m\xfcller --episodes 1 --set env.max_frames_per_episode=40", folder.path());
    EXPECT_EQ(evaluated.code, 0) << evaluated.text;
}

TEST(CaleEmulator, FilmsAPolicyWhereThereIsNoDisplay) {
    const TemporaryFolder folder;
    ASSERT_EQ(train_sac(small(folder.path() / "run")).code, 0);
    for (const auto* name : {"DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR", "SDL_VIDEODRIVER"})
        ::unsetenv(name);
    const auto film = cale_says("play --policy run --set env.max_frames_per_episode=40", folder.path());
    EXPECT_EQ(film.code, 0) << film.text;
    EXPECT_THAT(film.text, testing::HasSubstr("filming instead\n"));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "play_pong.mp4")) << film.text;
    EXPECT_THAT(cale_says("play pong").text, testing::HasSubstr("give --policy FILE"));

    const auto before = folder.read("play_pong.mp4");
    const auto words = "play --policy run --no-window --set env.max_frames_per_episode=40";
    const auto second = cale_says(words, folder.path());
    EXPECT_THAT(second.text,
                testing::ContainsRegex("return [-0-9]+ after [0-9]+ agent steps\nplay_pong_2.mp4\n"));
    EXPECT_EQ(
        cale_says(fmt::format("{} --video play_pong.mp4", words), folder.path()).text,
        "cale play: --video play_pong.mp4: there is such a file already; give another name, or delete it\n");
    EXPECT_EQ(folder.read("play_pong.mp4"), before);
    std::filesystem::create_directory(folder.path() / "12:30");
    const auto with_colons = cale_says(fmt::format("{} --video 12:30/film:1.mp4", words), folder.path());
    EXPECT_EQ(with_colons.code, 0) << with_colons.text;
    EXPECT_GT(std::filesystem::file_size(folder.path() / "12:30/film:1.mp4"), 0u);
    EXPECT_EQ(cale_says("play --policy none --no-window --video new.mp4", folder.path()).code, 1);
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "new.mp4")) << "nothing was filmed";
}

TEST(CaleEmulator, FilmsMadeAtOnceHaveNamesOfTheirOwn) {
    const TemporaryFolder folder;
    const auto play =
        "play --policy " CALE_SOURCE_DIR
        "/policies/road_runner_sac.safetensors --no-window --set env.max_frames_per_episode=120";
    std::vector<std::future<Said>> films;
    for (int i = 0; i < 3; ++i)
        films.push_back(std::async(std::launch::async, [&] { return cale_says(play, folder.path()); }));
    std::set<std::string> names;
    for (auto& film : films) {
        const auto said = film.get();
        EXPECT_EQ(said.code, 0) << said.text;
        names.insert(said.text.substr(std::min(said.text.find("play_road_runner"), said.text.size())));
    }
    EXPECT_THAT(names, testing::ElementsAre("play_road_runner.mp4\n", "play_road_runner_2.mp4\n",
                                            "play_road_runner_3.mp4\n"));
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
