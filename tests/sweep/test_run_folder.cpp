// Where a run stands, from its folder alone; and who may run it.
#include "sweep/run_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <string>

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "fake_program.h"
#include "storage/run_lock.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

class RunFolder : public testing::Test {
  protected:
    RunStatus status(bool evaluates = true) {
        return status_of(folder_.path() / "run", {.total_steps = 100, .evaluates = evaluates});
    }
    RunPhase state(bool evaluates = true) { return status(evaluates).state; }
    void checkpoint(const std::string& step) {
        fs::create_directories(folder_ / ("run/checkpoints/step_" + step));
    }

    test::TemporaryFolder folder_;
};

TEST_F(RunFolder, SaysHowFarTheRunIs) {
    EXPECT_EQ(state(), RunPhase::waiting);
    folder_.write("run/config.yaml", "");
    EXPECT_EQ(state(), RunPhase::waiting) << "no checkpoint yet: it will start again";
    fs::create_directories(folder_ / "run/checkpoints/step_000000100.partial");
    EXPECT_EQ(state(), RunPhase::waiting) << "a checkpoint under way is none";
    checkpoint("000000050");
    EXPECT_EQ(state(), RunPhase::interrupted);
    EXPECT_EQ(status().step, 50);
    checkpoint("000000104");
    EXPECT_EQ(state(), RunPhase::interrupted) << "the evaluation at the end is missing";
    EXPECT_EQ(state(/*evaluates=*/false), RunPhase::finished);
    folder_.write("run/eval/step_000000050.csv", "");
    EXPECT_EQ(state(), RunPhase::interrupted);
    folder_.write("run/eval/step_000000104.csv", "");
    EXPECT_EQ(state(), RunPhase::finished);
    folder_.write("run/metadata.json", R"({"finished": false})");
    EXPECT_EQ(state(), RunPhase::interrupted) << "its last checkpoint was to be written once more";
    EXPECT_EQ(state(/*evaluates=*/false), RunPhase::finished) << "it pauses there";
    folder_.write("run/metadata.json", R"({"finished": true})");
    EXPECT_EQ(state(), RunPhase::finished);
    EXPECT_EQ(status().step, 104);
}

TEST_F(RunFolder, ShowsTheNewestWholeRow) {
    folder_.write("run/progress.csv",
                  "global_step,frame,seconds,steps_per_second,charts/avg_episodic_return,losses/q\n"
                  "10,40,1,9,,0.5\n"
                  "20,80,2,10.5,-3.25,0.4\n"
                  "30,120,3,1");
    EXPECT_EQ(status().step, 20);
    EXPECT_EQ(status().steps_per_second, 10.5);
    EXPECT_EQ(status().mean_return, -3.25);
    folder_.write("run/progress.csv", "global_step,frame\n");
    EXPECT_EQ(status().step, 0);
    EXPECT_FALSE(status().mean_return);
}

TEST_F(RunFolder, RemembersWhyARunWasGivenUp) {
    folder_.write("run/config.yaml", "");
    remember_failure(folder_ / "run", "exit code 1: it broke");
    EXPECT_EQ(state(), RunPhase::failed);
    EXPECT_EQ(status().message, "exit code 1: it broke");
    forget_failure(folder_ / "run");
    EXPECT_EQ(state(), RunPhase::waiting);
}

TEST_F(RunFolder, AFreshStartKeepsWhatTheRunSaid) {
    for (const std::string file :
         {"config.yaml", "episodes.csv", "eval/x.csv", "output.log", ".claim", ".lock"})
        folder_.write("run/" + file, "first\nlast\n\n");
    prepare_for_start(folder_ / "run");
    EXPECT_EQ(folder_.read("run/output.log"), "first\nlast\n\n");
    EXPECT_TRUE(fs::exists(folder_ / "run/.claim"));
    EXPECT_TRUE(fs::exists(folder_ / "run/.lock")) << "a program that was started by hand may hold it";
    EXPECT_FALSE(fs::exists(folder_ / "run/episodes.csv"));
    EXPECT_FALSE(fs::exists(folder_ / "run/eval"));
    EXPECT_EQ(last_log_line(folder_ / "run"), "last");
    EXPECT_EQ(last_log_line(folder_ / "none"), "");
    EXPECT_EQ(log_size(folder_ / "run"), 12);
    EXPECT_EQ(last_log_line(folder_ / "run", 6), "last");
    EXPECT_EQ(last_log_line(folder_ / "run", 12), "") << "that was an earlier session's";
}

TEST_F(RunFolder, AChildKeepsTheClaimAsLongAsItLives) {
    const auto run = folder_.path() / "run";
    fs::create_directories(run);
    EXPECT_FALSE(RunClaim::is_taken(run));
    pid_t child = 0;
    {
        const auto claim = RunClaim::take(run);
        ASSERT_TRUE(claim);
        EXPECT_FALSE(RunClaim::take(run)) << "one holder at a time";
        child = ::fork();
        if (child == 0) {
            ::pause();
            ::_exit(0);
        }
    }
    EXPECT_TRUE(RunClaim::is_taken(run)) << "the parent let go, the child did not";
    EXPECT_EQ(state(), RunPhase::running);
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    EXPECT_FALSE(RunClaim::is_taken(run)) << "the operating system took it back";
    EXPECT_TRUE(RunClaim::take(run));
}

TEST_F(RunFolder, ARunThatWasStartedByHandIsTaken) {
    const auto run = folder_.path() / "run";
    fs::create_directories(run);
    {
        const RunLock by_hand(run);
        EXPECT_TRUE(RunLock::is_taken(run));
        EXPECT_TRUE(RunClaim::is_taken(run));
        EXPECT_FALSE(RunClaim::take(run));
        EXPECT_EQ(state(), RunPhase::running);
    }
    EXPECT_FALSE(RunLock::is_taken(run));
    EXPECT_TRUE(RunClaim::take(run));
}

TEST_F(RunFolder, AClaimIsNoStandardStreamOfAChild) {
    const auto run = folder_.path() / "run";
    fs::create_directories(run);
    const pid_t child = ::fork();
    if (child == 0) {
        ::close(STDIN_FILENO);
        const auto claim = RunClaim::take(run);
        ::_exit(claim && ::fcntl(STDIN_FILENO, F_GETFD) < 0 ? 0 : 1);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(status, 0) << "its number is another one";
}

}  // namespace
}  // namespace cale
