// Several runs at once that succeed, fail, are slow, and are killed; and sweeps that are killed.
#include "sweep/local_runner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "fake_program.h"
#include "sweep/machine.h"
#include "sweep/run_folder.h"

namespace cale {
namespace {

using testing::HasSubstr;
using testing::Not;

class LocalSweep : public testing::Test {
  protected:
    int run(const std::vector<PlannedRun>& runs, std::size_t at_once = 2, int retries = 1,
            const std::string& said = "said") {
        const std::unique_ptr<std::FILE, int (*)(std::FILE*)> out(
            std::fopen((fake_.path() / said).c_str(), "w"), &std::fclose);
        const Slots slots{.slots = std::vector<Slot>(at_once), .reason = ""};
        return run_locally(runs, fake_.sweep(), slots, {.retries = retries, .out = out.get()});
    }
    /// The sweep as a process of its own.
    pid_t start(const std::vector<PlannedRun>& runs, const std::string& said = "said") {
        const pid_t sweep = ::fork();
        if (sweep == 0) {
            ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // a test that fails leaves nothing behind
            ::signal(SIGHUP, SIG_DFL);           // under nohup it is ignored
            ::_exit(run(runs, 2, 1, said));
        }
        return sweep;
    }
    static int exit_code_of(pid_t process) {
        int status = 0;
        ::waitpid(process, &status, 0);
        return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    }
    RunPhase state(const std::string& run) {
        return status_of(fake_.sweep() / run, {.total_steps = 100, .evaluates = false}).state;
    }
    bool says(const std::string& run, const std::string& words) {
        return fake_.output(run).find(words) != std::string::npos;
    }
    std::string said(const std::string& name = "said") {
        std::ifstream in(fake_.path() / name);
        return {std::istreambuf_iterator<char>(in), {}};
    }

    test::FakeProgram fake_;
};

TEST_F(LocalSweep, TrainsAllRunsOnce) {
    const auto runs = fake_.runs({"fast", "fast", "fast"});
    EXPECT_EQ(run(runs), 0);
    for (const std::string name : {"fast_0", "fast_1", "fast_2"}) {
        EXPECT_EQ(state(name), RunPhase::finished);
        EXPECT_EQ(fake_.output(name), "started with output.log \n");
    }
    EXPECT_THAT(said(), HasSubstr("[3/3] finished   "));
    EXPECT_THAT(said(), HasSubstr(", return 7.5\n"));
    EXPECT_THAT(said(), HasSubstr("3 runs: 3 finished\n"));

    EXPECT_EQ(run(runs), 0);
    EXPECT_EQ(fake_.output("fast_0"), "started with output.log \n") << "a finished run is left alone";
}

TEST_F(LocalSweep, RunsHaveTheirOutputWhereTheSweepHasNoStandardInput) {
    const pid_t sweep = ::fork();
    if (sweep == 0) {
        ::close(STDIN_FILENO);
        ::_exit(run(fake_.runs({"fast"})));
    }
    EXPECT_EQ(exit_code_of(sweep), 0);
    EXPECT_EQ(fake_.output("fast_0"), "started with output.log \n");
}

TEST_F(LocalSweep, AFailureIsTriedAgainAndStopsNobody) {
    EXPECT_EQ(run(fake_.runs({"fail", "fail_once", "unresumable", "fast"})), 1);
    EXPECT_EQ(state("fail_0"), RunPhase::failed);
    EXPECT_EQ(state("fail_once_1"), RunPhase::finished);
    EXPECT_EQ(state("unresumable_2"), RunPhase::failed);
    EXPECT_EQ(state("fast_3"), RunPhase::finished);
    EXPECT_EQ(fake_.output("fail_0"),
              "started with output.log \nit breaks always\n"
              "started with output.log \nit breaks always\n")
        << "once more, from the beginning for want of a checkpoint";
    EXPECT_TRUE(says("fail_once_1", "it broke\nresumed\n"));
    EXPECT_EQ(fake_.output("unresumable_2"), "started with output.log \nanother configuration\n")
        << "another try would end likewise";
    EXPECT_EQ(status_of(fake_.sweep() / "fail_0", {.total_steps = 100, .evaluates = false}).message,
              "exit code 1: it breaks always");
    EXPECT_THAT(said(), HasSubstr("FAILED     fail_0  exit code 1: it breaks always\n"));
    EXPECT_THAT(said(), HasSubstr("4 runs: 2 finished, 2 failed\n"));
}

TEST_F(LocalSweep, ARunThatBeginsWithOtherSettingsThanPlannedIsStopped) {
    auto runs = fake_.runs({"slow", "fast", "fast"});
    const auto other = std::make_shared<const SettingTexts>(SettingTexts{{"agent.loss", "mse"}});
    runs[0].base = runs[1].base = other;  // as if a file had said so when the sweep read it
    runs[2].base = std::make_shared<const SettingTexts>(SettingTexts{{"agent.loss", "huber"}});
    EXPECT_EQ(run(runs), 1);
    for (const std::string name : {"slow_0", "fast_1"})
        EXPECT_THAT(said(), HasSubstr(" REFUSED    " + name +
                                      "  its program read other settings than the sweep: agent.loss was mse "
                                      "and is now huber; a file of its configuration was changed meanwhile"));
    EXPECT_THAT(said(), HasSubstr("3 runs: 1 finished, 2 refused\n"));
}

TEST_F(LocalSweep, ARunThatCameToTheStepOfItsPauseIsNotCalledFinished) {
    auto runs = fake_.runs({"fast", "fast"});
    EXPECT_EQ(run(runs), 0);
    runs[0].until = runs[0].end.total_steps;
    EXPECT_EQ(run(runs), 0);
    EXPECT_THAT(said(), HasSubstr("2 runs: 1 finished, 1 paused\n"));
}

TEST_F(LocalSweep, ARunThatDivergesIsNotTriedAgain) {
    EXPECT_EQ(run(fake_.runs({"diverge"})), 1);
    EXPECT_EQ(fake_.output("diverge_0"), "started with output.log \na loss became nan\n");
}

TEST_F(LocalSweep, ARunThatIsKilledStartsAgain) {
    EXPECT_EQ(run(fake_.runs({"killed_once"})), 0);
    EXPECT_THAT(said(), HasSubstr("killed by signal 9 (Killed); retrying (1 of 1)"));
}

TEST_F(LocalSweep, AProgramThatCannotBeStartedIsAFailure) {
    auto runs = fake_.runs({"fast"});
    runs[0].program = fake_.path() / "train_nothing";
    EXPECT_EQ(run(runs, 1, 0), 1);
    EXPECT_THAT(said(), HasSubstr("the program could not be started"));
}

TEST_F(LocalSweep, AnInterruptLeavesCheckpointsToGoOnFrom) {
    const auto runs = fake_.runs({"slow", "slow", "slow"});
    const std::string first = "started with", again = "Interrupted\nresumed\n";
    std::string expected = first;
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
        const auto sweep = start(runs);
        ASSERT_TRUE(test::wait_until([&] {
            return state("slow_0") == RunPhase::running && state("slow_1") == RunPhase::running &&
                   says("slow_0", expected) && says("slow_1", expected) && fake_.ready("slow_0") &&
                   fake_.ready("slow_1");
        }));
        ::kill(sweep, signal);
        EXPECT_EQ(exit_code_of(sweep), 130);
        EXPECT_EQ(state("slow_0"), RunPhase::interrupted);
        EXPECT_EQ(state("slow_1"), RunPhase::interrupted);
        EXPECT_EQ(state("slow_2"), RunPhase::waiting) << "nothing is started on the way out";
        expected = expected == first ? again : expected + again;
    }
    fake_.go();
    EXPECT_EQ(run(runs), 0);
    EXPECT_TRUE(says("slow_0", "Interrupted\nresumed\n"));
}

TEST_F(LocalSweep, KilledItselfItTakesItsRunsWithItAndTheNextGoesOn) {
    const auto runs = fake_.runs({"slow", "fast"});
    const auto sweep = start(runs);
    ASSERT_TRUE(
        test::wait_until([&] { return fake_.ready("slow_0") && state("fast_1") == RunPhase::finished; }));
    ::kill(sweep, SIGKILL);
    EXPECT_EQ(exit_code_of(sweep), -SIGKILL);
    EXPECT_TRUE(test::wait_until([&] { return state("slow_0") == RunPhase::interrupted; }))
        << "the run got its own signal, and wrote a checkpoint";
    fake_.go();
    EXPECT_EQ(run(runs), 0);
    EXPECT_TRUE(says("slow_0", "Interrupted\nresumed\n"));
    EXPECT_EQ(fake_.output("fast_1"), "started with output.log \n");
}

TEST_F(LocalSweep, SaysWhatTheStopOfOneRunWaitsFor) {
    const auto runs = fake_.runs({"slow"});
    const auto sweep = start(runs);
    ASSERT_TRUE(test::wait_until([&] { return fake_.ready("slow_0"); }));
    ::kill(sweep, SIGINT);
    EXPECT_EQ(exit_code_of(sweep), 130);
    EXPECT_THAT(said(),
                HasSubstr("Stopping 1 run, which writes a checkpoint first. Ctrl-C again kills it.\n"));
}

TEST_F(LocalSweep, ARunOfOtherSettingsIsRefusedAndTheOthersGoOn) {
    auto runs = fake_.runs({"fast", "fast"});
    EXPECT_EQ(run({runs[0]}), 0);
    runs[0].run.settings.push_back({"agent.loss", "mse"});
    EXPECT_EQ(run(runs), 1);
    EXPECT_THAT(said(), HasSubstr("REFUSED    fast_0  trained with other settings: agent.loss was huber and "
                                  "is now mse; give the sweep another --dir"));
    EXPECT_THAT(said(), HasSubstr("2 runs: 1 finished, 1 refused\n"));
    EXPECT_EQ(fake_.output("fast_0"), "started with output.log \n");
    EXPECT_EQ(state("fast_0"), RunPhase::finished) << "nothing is left behind in a run of somebody else";
}

TEST_F(LocalSweep, ARunOfAnotherSweepWithOtherSettingsIsRefusedOnceItIsDone) {
    auto runs = fake_.runs({"slow"});
    const auto first = start(runs);
    ASSERT_TRUE(test::wait_until([&] { return says("slow_0", "started"); }));
    runs[0].run.settings.push_back({"agent.loss", "mse"});
    const auto second = start(runs, "said by the second");
    ASSERT_TRUE(test::wait_until(
        [&] { return said("said by the second").find("another process is training") != std::string::npos; }));
    fake_.go();
    EXPECT_EQ(exit_code_of(first), 0);
    EXPECT_EQ(exit_code_of(second), 1);
    EXPECT_THAT(said("said by the second"), HasSubstr("REFUSED    slow_0  trained with other settings"));
}

TEST_F(LocalSweep, AFolderThatCannotBeMadeIsAFailureOfOneSentence) {
    fake_.write("runs/fast_0", "a file");
    EXPECT_EQ(run(fake_.runs({"fast", "fast"}), 2, 1), 1);
    EXPECT_THAT(said(), testing::Not(HasSubstr("retrying"))) << "a file does not go away by waiting";
    EXPECT_THAT(said(), HasSubstr("FAILED     fast_0  cannot write '" + (fake_.sweep() / "fast_0").string() +
                                  "': Not a directory\n"));
    EXPECT_EQ(state("fast_1"), RunPhase::finished);
}

TEST_F(LocalSweep, ARunOfAnotherSweepIsWaitedFor) {
    const auto runs = fake_.runs({"slow"});
    const auto first = start(runs);
    ASSERT_TRUE(test::wait_until([&] { return says("slow_0", "started"); }));
    const auto second = start(runs, "said by the second");
    ASSERT_TRUE(test::wait_until(
        [&] { return said("said by the second").find("another process is training") != std::string::npos; }));
    fake_.go();
    EXPECT_EQ(exit_code_of(first), 0);
    EXPECT_EQ(exit_code_of(second), 0);
    EXPECT_EQ(fake_.output("slow_0"), "started with output.log \n") << "it ran once";
}

TEST_F(LocalSweep, ARunThatCameFurtherIsTriedAgainBehindTheOthers) {
    auto runs = fake_.runs({"fast", "fast"});
    // Fails three times, each time one step further.
    runs[0].program =
        fake_.write_script("train_on",
                           "#!/bin/bash\n"
                           "while [ $1 != --run-dir ]; do shift; done\n"
                           "n=$(ls $2/checkpoints 2>/dev/null | wc -l)\n"
                           "echo {} >$2/metadata.json\n: >$2/config.yaml\n"
                           "printf '#{}\\nr,global_step\\n' >$2/episodes.csv\n"
                           "if [ $n = 3 ]; then mkdir $2/checkpoints/step_000000100; exit 0; fi\n"
                           "mkdir -p $2/checkpoints/step_00000000$((n + 1))\nexit 1\n");
    EXPECT_EQ(run(runs, /*at_once=*/1, /*retries=*/1), 0) << said();
    EXPECT_EQ(state("fast_0"), RunPhase::finished);
    EXPECT_LT(said().find("finished   fast_1"), said().find("resumed    fast_0"));
}

TEST_F(LocalSweep, ASecondInterruptKillsARunThatDoesNotStop) {
    auto runs = fake_.runs({"slow"});
    runs[0].program =
        fake_.write_script("train_deaf",
                           "#!/bin/bash\nhere=$(dirname $0)\ntrap 'touch $here/signalled' TERM\n"
                           "touch $here/ready_slow_0\n"
                           "for i in {1..500}; do sleep 0.02; done\ntouch $here/survived\n");
    const auto sweep = start(runs);
    ASSERT_TRUE(test::wait_until([&] { return fake_.ready("slow_0"); }));
    ::kill(sweep, SIGINT);
    ASSERT_TRUE(test::wait_until([&] { return std::filesystem::exists(fake_.path() / "signalled"); }));
    ::kill(sweep, SIGINT);
    EXPECT_EQ(exit_code_of(sweep), 130);
    EXPECT_FALSE(std::filesystem::exists(fake_.path() / "survived"));
}

TEST_F(LocalSweep, TwoInterruptsAtOnceAreOneStop) {
    using Clock = std::chrono::steady_clock;
    auto apart = Clock::duration::max();
    for (int tries = 0; tries < 20 && apart > std::chrono::milliseconds(50); ++tries) {
        const auto sweep = start(fake_.runs({"slow"}));
        ASSERT_TRUE(test::wait_until([&] { return fake_.ready("slow_0"); }));
        // As of a wrapper that passes on what the terminal has sent to both.
        const auto begun = Clock::now();
        ::kill(sweep, SIGINT);
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
        ::kill(sweep, SIGINT);
        apart = Clock::now() - begun;  // longer on a machine that is busy
        EXPECT_EQ(exit_code_of(sweep), 130);
    }
    EXPECT_LE(apart, std::chrono::milliseconds(50)) << "twenty times";
    EXPECT_EQ(state("slow_0"), RunPhase::interrupted) << "and has its checkpoint";
}

TEST_F(LocalSweep, ARunGetsItsSignalOnce) {
    auto runs = fake_.runs({"slow"});
    runs[0].program =
        fake_.write_script("train_slowly_stopped",
                           "#!/bin/bash\nhere=$(dirname $0)\ntrap 'echo once >>$here/signalled' TERM\n"
                           "touch $here/ready_slow_0\n"
                           "until [ -e $here/signalled ]; do sleep 0.02; done\n"
                           "for i in {1..75}; do sleep 0.02; done\nexit 130\n");
    const auto sweep = start(runs);
    ASSERT_TRUE(test::wait_until([&] { return fake_.ready("slow_0"); }));
    ::kill(sweep, SIGTERM);
    EXPECT_EQ(exit_code_of(sweep), 130);
    EXPECT_EQ(said("signalled"), "once\n");
}

TEST_F(LocalSweep, RunsHaveTheDeviceAndTheCoresOfTheirPlaces) {
    auto runs = fake_.runs({"fast", "fast"});
    for (auto& planned : runs)
        planned.program = fake_.write_script(
            "train_where", "#!/bin/bash\necho \"$@\"\ngrep Cpus_allowed_list /proc/self/status\nexit 2\n");
    const int core = usable_cores().back();
    const Slots slots{.slots = {{.device = "cuda:1", .cpus = {core}}, {.device = "cuda:2"}}, .reason = ""};
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> out(
        std::fopen((fake_.path() / "said").c_str(), "w"), &std::fclose);
    EXPECT_EQ(run_locally(runs, fake_.sweep(), slots, {.threads = 3, .retries = 2, .out = out.get()}), 1);
    const std::string both[] = {fake_.output("fast_0"), fake_.output("fast_1")};
    const auto& pinned = both[both[0].find("cuda:1") == std::string::npos ? 1 : 0];
    EXPECT_THAT(both,
                testing::UnorderedElementsAre(HasSubstr("--threads 3 --device cuda:1 --no-progress\n"),
                                              HasSubstr("--threads 3 --device cuda:2 --no-progress\n")));
    EXPECT_THAT(pinned, testing::EndsWith("\t" + std::to_string(core) + "\n"));
    EXPECT_EQ(std::ranges::count(pinned, '\n'), 2) << "another try would end the same way";
}

}  // namespace
}  // namespace cale
