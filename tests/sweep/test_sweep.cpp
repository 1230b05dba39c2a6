// `cale sweep` as its user meets it, and the sweeps that are shipped, with the real programs.
#include "sweep/sweep.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "fake_program.h"
#include "settings/config.h"
#include "storage/files.h"
#include "sweep/plan.h"
#include "sweep/run_folder.h"
#include "sweep/shell.h"
#include "sweep/sweep_file.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

class SweepCommand : public testing::Test {
  protected:
    SweepCommand() {
        options_.file = fake_.write("mine.yaml", fmt::format("agent: fake\n"
                                                             "set: {{env.rom_dir: {}/roms}}\n"
                                                             "grid: {{train.seed: 1..2, env.game: pong}}\n",
                                                             fake_.path().string()));
        options_.folder = fake_.sweep();
        options_.cale = fake_.path() / "cale";
    }
    std::string answer() {
        const auto file = fake_.path() / "answer";
        std::FILE* out = std::fopen(file.c_str(), "w");
        code_ = run_sweep(options_, out);
        std::fclose(out);
        return read_file(file);
    }
    test::FakeProgram fake_;
    SweepOptions options_;
    int code_ = -1;
};

TEST_F(SweepCommand, TrainsAndShowsHowItStands) {
    options_.only = {"*__2"};
    EXPECT_EQ(answer(), "");
    EXPECT_EQ(code_, 0);
    options_.only = {};
    options_.task = SweepTask::show_status;
    EXPECT_THAT(answer(), HasSubstr("Pong__fake__1     waiting"));
    EXPECT_THAT(answer(), HasSubstr("Pong__fake__2     finished"));
    EXPECT_THAT(answer(), HasSubstr("2 runs: 1 finished, 1 waiting\n"));
}

TEST_F(SweepCommand, ADryRunPrintsCommandsAndDoesNothing) {
    options_.task = SweepTask::show_commands;
    const auto text = answer();
    EXPECT_THAT(text,
                HasSubstr(fmt::format("{}/train_fake env.rom_dir={}/roms train.seed=1 env.game=pong "
                                      "--run-dir {}/Pong__fake__1 --threads 1 --device cpu --no-progress\n",
                                      fake_.path().string(), fake_.path().string(), fake_.sweep().string())));
    EXPECT_FALSE(fs::exists(fake_.sweep()));
    fs::create_directories(fake_.sweep() / "Pong__fake__1/checkpoints/step_000000050");
    fs::create_directories(fake_.sweep() / "Pong__fake__2/checkpoints/step_000000100");
    for (const std::string run : {"Pong__fake__1", "Pong__fake__2"})
        for (const auto* file : {"/config.yaml", "/episodes.csv"}) fake_.write("runs/" + run + file, "");
    EXPECT_THAT(answer(), HasSubstr("--resume\n# finished: Pong__fake__2\n"));

    options_.launcher = Launcher::slurm;
    options_.sbatch_options = {"--time=1:00:00"};
    EXPECT_THAT(answer(), HasSubstr("#SBATCH --time=1:00:00\n"));
    const auto memory = largest_memory(plan(read_sweep(options_.file), fake_.path()));
    EXPECT_THAT(answer(), HasSubstr(fmt::format("#SBATCH --mem={}M\n", (memory + (1 << 20) - 1) >> 20)));
    options_.sharing.memory_per_run = std::int64_t{7} << 20;
    EXPECT_THAT(answer(), HasSubstr("#SBATCH --mem=7M\n"));
    options_.sharing.devices = {"cpu", "cuda:0"};
    EXPECT_THROW(answer(), ConfigError) << "before a queue of tasks finds out";
    options_.sharing.devices.clear();
    EXPECT_THAT(answer(), HasSubstr("mine.yaml --dir " + fake_.sweep().string() +
                                    " --jobs 1 --threads 1 --retries 2 "));
    options_.overrides = {"agent.rate=2e-4"};
    options_.sharing.devices = {"cpu"};
    EXPECT_THAT(answer(), HasSubstr(" --retries 2 --device cpu --set agent.rate=2e-4 --only "));
}

TEST_F(SweepCommand, ASearchIsTrainedAndCompared) {
    options_.file = fake_.write("searched.yaml", fmt::format("agent: fake\n"
                                                             "set: {{env.rom_dir: {}/roms}}\n"
                                                             "grid: {{train.seed: 1, env.game: pong}}\n"
                                                             "search:\n"
                                                             "  samples: 2\n"
                                                             "  settings: {{agent.rate: 1..5}}\n",
                                                             fake_.path().string()));
    const auto refusal = [&] { return test::error_of<ConfigError>([&] { answer(); }); };
    EXPECT_THAT(refusal(), HasSubstr("searched.yaml has 'search:', so say --search random"));
    options_.search = SearchMethod::halving;
    options_.only = {"*"};
    EXPECT_THAT(refusal(), HasSubstr("leave --only out"));
    options_.only = {};
    options_.launcher = Launcher::slurm;
    EXPECT_THAT(refusal(), HasSubstr("leave --launcher slurm out"));
    options_.launcher = Launcher::local;
    options_.task = SweepTask::show_commands;
    EXPECT_THAT(answer(), HasSubstr("--no-progress --until 12\n")) << "an eighth of 100 steps";
    options_.search = SearchMethod::random;
    EXPECT_THAT(answer(), Not(HasSubstr("--until")));
    options_.launcher = Launcher::slurm;
    EXPECT_THAT(answer(), HasSubstr(" --search random --only "));
    options_.launcher = Launcher::local;

    options_.task = SweepTask::train;
    EXPECT_THAT(answer(),
                HasSubstr("Agent step 100, the end:\n   rank  sample  agent.rate\n   1.50       1 "));
    EXPECT_EQ(code_, 0);
    EXPECT_TRUE(fs::exists(fake_.sweep() / "Pong__fake__sample=2__1"));
    EXPECT_TRUE(fs::exists(fake_.sweep() / "search_best.yaml"));
    options_.overrides = {"agent.rate=7,8,9"};
    EXPECT_THAT(answer(),
                HasSubstr("# refused: Pong__fake__sample=1__1: trained with other settings: agent.rate was"));
    EXPECT_EQ(code_, 1) << "the folder has runs of other samples";
    options_.task = SweepTask::show_status;
    options_.search = SearchMethod::none;
    EXPECT_THAT(answer(), HasSubstr("2 runs: 2 refused")) << "no method is needed to see how they stand";
    options_.task = SweepTask::show_commands;
    options_.search = SearchMethod::halving;
    EXPECT_THAT(answer(), HasSubstr("# refused: Pong__fake__sample=1__1"));
    EXPECT_EQ(code_, 1);
    options_.overrides = {};
    options_.search = SearchMethod::random;
    EXPECT_EQ(answer(), "# finished: the search, 2 runs\n");
    EXPECT_EQ(code_, 0);
    options_.task = SweepTask::train;
    options_.search = SearchMethod::random;

    options_.file = fake_.path() / "mine.yaml";
    EXPECT_THAT(refusal(), HasSubstr("mine.yaml has no 'search:'"));
}

TEST_F(SweepCommand, ListsAllItsRunsForTheReport) {
    options_.only = {"*__2"};
    answer();
    EXPECT_EQ(read_file(fake_.sweep() / "sweep_runs.txt"), "Pong__fake__1\nPong__fake__2\n");
}

TEST_F(SweepCommand, RunsThatAreAddedOnTheCommandLineStandBesideThoseThatWereThere) {
    answer();
    options_.overrides = {"train.seed=3"};
    answer();
    EXPECT_EQ(read_file(fake_.sweep() / "sweep_runs.txt"), "Pong__fake__3\nPong__fake__1\nPong__fake__2\n");
    options_.overrides = {};
    answer();
    EXPECT_EQ(read_file(fake_.sweep() / "sweep_runs.txt"), "Pong__fake__1\nPong__fake__2\n");
}

TEST_F(SweepCommand, OfRunsThatAreAddedThoseAreListedThatAreAskedFor) {
    answer();
    options_.overrides = {"train.seed=3,4"};
    options_.only = {"*__4"};
    answer();
    EXPECT_EQ(read_file(fake_.sweep() / "sweep_runs.txt"), "Pong__fake__4\nPong__fake__1\nPong__fake__2\n");
}

TEST_F(SweepCommand, RunsOfTheFileAreListedThoughAPartIsTrainedInAnotherWay) {
    options_.overrides = {"log.every=20"};
    options_.only = {"*__1"};
    answer();
    EXPECT_EQ(read_file(fake_.sweep() / "sweep_runs.txt"), "Pong__fake__1\nPong__fake__2\n");
}

TEST_F(SweepCommand, AFailedRunIsSaidByTheExitCodeOfTheStatusToo) {
    options_.overrides = {"agent.mode=fail"};
    options_.retries = 0;
    answer();
    EXPECT_EQ(code_, 1);
    options_.task = SweepTask::show_status;
    EXPECT_THAT(answer(), HasSubstr("2 failed"));
    EXPECT_EQ(code_, 1);
}

TEST_F(SweepCommand, NothingIsStartedAfterAMistake) {
    options_.only = {"Ping*"};
    EXPECT_THAT(test::error_of<ConfigError>([&] { answer(); }),
                HasSubstr("--only Ping*: no run has such a name; one is called Pong__fake__1"));
    options_.only = {"Pong*", "Ping*"};
    EXPECT_THAT(test::error_of<ConfigError>([&] { answer(); }), HasSubstr("--only Ping*: no run"));
    options_.only = {};
    options_.overrides = {"agent.typo=1"};
    EXPECT_THAT(test::error_of<ConfigError>([&] { answer(); }), HasSubstr("unknown key 'agent.typo'"));
    EXPECT_FALSE(fs::exists(fake_.sweep()));
}

TEST_F(SweepCommand, RunsOfOtherSettingsAreNotPassedOffAsItsOwn) {
    options_.overrides = {"agent.loss=huber"};
    answer();
    EXPECT_EQ(code_, 0);

    options_.overrides = {"agent.loss=mse", "agent.rate=0.0001", "log.every=7"};
    const std::string reason =
        "trained with other settings: agent.loss was huber and is now mse; give the sweep another --dir, or "
        "take the change back\n";
    answer();
    EXPECT_EQ(code_, 1);
    options_.task = SweepTask::show_status;
    EXPECT_THAT(answer(), HasSubstr("Pong__fake__1     refused"));
    EXPECT_THAT(answer(), HasSubstr("  " + reason));
    EXPECT_THAT(answer(), HasSubstr("2 runs: 2 refused\n"));
    EXPECT_EQ(code_, 1);
    options_.task = SweepTask::show_commands;
    EXPECT_EQ(answer(), "# refused: Pong__fake__1: " + reason + "# refused: Pong__fake__2: " + reason);
    EXPECT_EQ(code_, 1);
    options_.launcher = Launcher::slurm;
    EXPECT_EQ(answer(), "# refused: Pong__fake__1: " + reason + "# refused: Pong__fake__2: " + reason);
    EXPECT_EQ(code_, 1);
}

TEST_F(SweepCommand, WhatChangesNoResultIsNoOtherRunAndALongerOneGoesOn) {
    options_.overrides = {"agent.rate=1e-4"};
    answer();
    options_.overrides = {"agent.rate=0.0001", "log.every=7", "agent.loss=huber"};
    options_.task = SweepTask::show_status;
    EXPECT_THAT(answer(), HasSubstr("2 runs: 2 finished\n"));
    EXPECT_EQ(code_, 0);

    options_.overrides.emplace_back("train.total_steps=200");
    EXPECT_THAT(answer(), HasSubstr("2 runs: 2 interrupted\n"));
    options_.task = SweepTask::train;
    answer();
    EXPECT_EQ(code_, 0);
    EXPECT_THAT(fake_.output("Pong__fake__1"), HasSubstr("resumed\n"));
    options_.task = SweepTask::show_status;
    EXPECT_THAT(answer(), HasSubstr("2 runs: 2 finished\n"));

    options_.overrides.back() = "train.total_steps=1_50";
    EXPECT_THAT(answer(), HasSubstr("train.total_steps was 200 and is now 1_50"));
    EXPECT_EQ(code_, 1);
}

TEST_F(SweepCommand, AFolderThatCannotHoldRunsIsRefusedBeforeAnythingStarts) {
    options_.folder = fake_.write("file", "");
    for (const auto task : {SweepTask::train, SweepTask::show_status, SweepTask::show_commands}) {
        options_.task = task;
        EXPECT_EQ(test::error_of<ConfigError>([&] { answer(); }),
                  options_.folder.string() + ": it is a file, not a folder; name another folder by --dir");
    }
    options_.task = SweepTask::train;
    fake_.write("run/config.yaml", "");
    fake_.write("run/metadata.json", "");
    options_.folder = fake_.path() / "run";
    EXPECT_EQ(test::error_of<ConfigError>([&] { answer(); }),
              options_.folder.string() +
                  ": it is the folder of one run, not of a sweep's; name another folder by --dir");
    options_.folder = fake_.path() / "run/new";
    EXPECT_THAT(test::error_of<ConfigError>([&] { answer(); }),
                HasSubstr(": it is in the folder of a run, "));
    options_.folder = fake_.path() / "file/runs";
    EXPECT_EQ(test::error_of<ConfigError>([&] { answer(); }),
              options_.folder.string() +
                  ": nothing can be written there: Not a directory; name another folder by --dir");
}

TEST_F(SweepCommand, ACudaDeviceThatIsNotThereIsSaidOnce) {
    options_.sharing.devices = {"cuda:0"};
    EXPECT_THAT(test::error_of<ConfigError>([&] { answer(); }),
                HasSubstr("--device cuda:0: this LibTorch finds no"));
    EXPECT_FALSE(fs::exists(fake_.sweep()));
}

TEST(SweepCommandLine, RefusesValuesThatSayNothing) {
    const auto answer = [](const std::string& options) {
        return answer_of(fmt::format("{}/cale sweep {}/sweeps/smoke.yaml --dry-run {} 2>&1; echo $?",
                                     CALE_BINARY_DIR, CALE_SOURCE_DIR, options))
            .text;
    };
    EXPECT_EQ(answer("--dir ''"), "cale sweep: --dir is '': give DIR, or leave it out\n2\n");
    EXPECT_EQ(answer("--memory nan"), "cale sweep: --memory is 'nan': give a number from 0 to 100000\n2\n");
}

std::vector<fs::path> shipped_sweeps() {
    std::vector<fs::path> found;
    for (const auto& entry : fs::recursive_directory_iterator(CALE_SOURCE_DIR "/sweeps")) {
        if (entry.is_regular_file()) found.push_back(entry.path());
    }
    std::sort(found.begin(), found.end());
    return found;
}

class ShippedSweepEmulator : public testing::TestWithParam<fs::path> {};

TEST_P(ShippedSweepEmulator, IsAcceptedByItsProgramsAndHasAsManyRunsAsItSays) {
    const auto sweep = read_sweep(GetParam());
    const auto runs = plan(sweep, CALE_BINARY_DIR);
    auto text = read_file(GetParam());
    std::erase(text, ',');
    EXPECT_THAT(text, testing::ContainsRegex(fmt::format("[^0-9]{} runs", runs.size())));
    for (const auto& run : runs) EXPECT_TRUE(run.end.evaluates) << run.run.name;
}

INSTANTIATE_TEST_SUITE_P(Files, ShippedSweepEmulator, testing::ValuesIn(shipped_sweeps()),
                         [](const auto& chosen) { return chosen.param.stem().string(); });

/// What does not depend on the clock in a run's folder.
std::string results_of(const fs::path& run) {
    return read_file(run / "episodes.csv") + read_file(run / "eval/step_000000120.csv") +
           read_file(run / "checkpoints/step_000000120/agent.safetensors.zst");
}

TEST(SmokeSweepSlow, SurvivesKillsWithTheSameResults) {
    const test::TemporaryFolder folder;
    const auto command = [&](const std::string& name) {
        return fmt::format(
            "{}/cale sweep {}/sweeps/smoke.yaml --dir {} --jobs 1 --set env.game=pong --set train.seed=1 "
            "--set agent.encoder=phi_dqn --set train.total_steps=120 --set train.checkpoint_every=40 --set "
            "eval.episodes=1 >> {} 2>&1",
            CALE_BINARY_DIR, CALE_SOURCE_DIR, (folder / name).string(), (folder / "said").string());
    };
    ASSERT_EQ(answer_of(command("whole")).status, 0) << folder.read("said");
    // Whatever is under way after these times: planning, a run, its start, its checkpoint.
    int killed = 0;
    for (const double seconds : {0.2, 0.7, 1.4, 2.1})
        killed +=
            answer_of(fmt::format("timeout -s KILL {} {}", seconds, command("killed"))).status != 0 ? 1 : 0;
    EXPECT_GT(killed, 0) << "it was faster than any of these times";
    // And once a run has a checkpoint.
    answer_of(
        fmt::format("{} & sweep=$!\n"
                    "for i in $(seq 3000); do\n"
                    "ls -d {}/*/checkpoints/step_000000040 >/dev/null 2>&1 && break; sleep 0.02\n"
                    "done\n"
                    "kill -KILL $sweep",
                    command("killed"), (folder / "killed").string()));
    ASSERT_EQ(answer_of(command("killed")).status, 0) << folder.read("said");
    EXPECT_THAT(folder.read("said"), HasSubstr("resumed"));
    for (const std::string run : {"Pong__sac__encoder=phi_dqn__exploration=standard__1",
                                  "Pong__sac__encoder=phi_dqn__exploration=epsilon_greedy__1"}) {
        EXPECT_TRUE(results_of(folder / "killed" / run) == results_of(folder / "whole" / run)) << run;
    }
}

TEST(SearchSlow, TheRunThatGoesOnIsTheOneThatWasNeverPaused) {
    const test::TemporaryFolder folder;
    const auto file =
        folder.write("searched.yaml",
                     "agent: sac\n"
                     "set:\n"
                     "  env.obs: ram\n"
                     "  env.observe_joystick: true\n"
                     "  env.action_latency: 0-8\n"
                     "  env.max_frames_per_episode: 80\n"
                     "  agent.encoder: mlp\n"
                     "  agent.batch_size: 4\n"
                     "  agent.min_replay: 20\n"
                     "  agent.replay_capacity: 1_000\n"
                     "  train.total_steps: 120\n"
                     "  eval.episodes: 1\n"
                     "grid: {train.seed: 1, env.game: pong}\n"
                     "search:\n"
                     "  samples: 3\n"
                     "  first_steps: 40\n"
                     "  settings: {agent.hidden_units: 8..32, agent.learning_rate: log 1e-4..1e-2}\n");
    const auto search = [&](const std::string& method) {
        return answer_of(fmt::format("{}/cale sweep {} --search {} --dir {} --jobs 2 2>{}", CALE_BINARY_DIR,
                                     file.string(), method, (folder / method).string(),
                                     (folder / "said").string()));
    };
    const auto halving = search("halving");
    ASSERT_EQ(halving.status, 0) << folder.read("said");
    EXPECT_THAT(halving.text, HasSubstr("Agent step 40: the better 2 of 3 samples continue.\n"));
    EXPECT_THAT(halving.text, HasSubstr("Agent step 80: the better 1 of 2 samples continue.\n"));
    ASSERT_EQ(search("random").status, 0) << folder.read("said");
    const auto best = folder.read("halving/search_best.yaml");
    const auto run = fmt::format("Pong__sac__sample={}__1", best.substr(std::string("# Sample ").size(), 1));
    EXPECT_TRUE(results_of(folder / "halving" / run) == results_of(folder / "random" / run)) << run;
    EXPECT_TRUE(fs::exists(folder / "random" / run / "videos/step_000000120.mp4"))
        << "the joystick's bytes are no picture";
    EXPECT_EQ(
        answer_of(fmt::format("{}/train_sac --config {} --print-config >{}", CALE_BINARY_DIR,
                              (folder / "halving/search_best.yaml").string(), (folder / "printed").string()))
            .status,
        0);
    EXPECT_THAT(folder.read("printed"), HasSubstr("observe_joystick: true\n"));
}

TEST_F(SweepCommand, TheStatusHasTheStatesOfTheQueue) {
    const std::string path = std::getenv("PATH");
    ::setenv("PATH", (fake_.path().string() + ":" + path).c_str(), 1);
    fake_.write_script("squeue", "#!/bin/bash\necho '17 0 PENDING'\n");
    fake_.write("runs/slurm.json", R"([{"job": "17", "runs": ["Pong__fake__1"]}])");
    fake_.write("runs/Pong__fake__1/failure.txt", "it broke");
    options_.task = SweepTask::show_status;
    const auto text = answer();
    ::setenv("PATH", path.c_str(), 1);
    EXPECT_THAT(text, HasSubstr("Pong__fake__1     pending"));
    EXPECT_THAT(text, HasSubstr("2 runs: 1 waiting, 1 pending\n"));
    EXPECT_EQ(code_, 0) << "it is in the queue again";
}

TEST_F(SweepCommand, WaitsForItsRunsThoughWhoStartedItWaitsForNone) {
    std::signal(SIGCHLD, SIG_IGN);
    EXPECT_EQ(answer(), "");
    std::signal(SIGCHLD, SIG_DFL);
    EXPECT_EQ(code_, 0);
}

}  // namespace
}  // namespace cale
