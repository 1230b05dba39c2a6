// Slurm's side of a sweep, with scripts in the place of sbatch, squeue and scontrol. What a real Slurm does
// is tested by hand: tests/sweep/slurm_by_hand.
#include "sweep/slurm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <sys/wait.h>
#include <unistd.h>

#include "fake_program.h"
#include "settings/config.h"
#include "storage/run_lock.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;
using testing::UnorderedElementsAre;

class Slurm : public testing::Test {
  protected:
    void SetUp() override {
        const char* path = std::getenv("PATH");
        path_ = path != nullptr ? path : "";
        ::setenv("PATH", (fake_.path().string() + ":" + path_).c_str(), 1);
        fake_.write_script("sbatch",
                           "#!/bin/bash\n"
                           "n=$(($(cat $(dirname $0)/jobs 2>/dev/null || echo 16) + 1))\n"
                           "echo $n | tee $(dirname $0)/jobs\n");
        fake_.write_script("squeue", "#!/bin/bash\ncat $(dirname $0)/queue 2>/dev/null\nexit 0\n");
        fake_.write_script("scontrol",
                           "#!/bin/bash\n"
                           "if [ $1 = show ]; then echo 'MaxArraySize            = 2'; exit; fi\n"
                           "echo \"$@\" >>$(dirname $0)/scontrol.log\n");
    }
    void TearDown() override { ::setenv("PATH", path_.c_str(), 1); }

    SlurmOptions options() const {
        return {.name = "mine",
                .memory = std::int64_t{1} << 30,
                .options = {},
                .command = {(fake_.path() / "cale").string(), "sweep", "my file.yaml"}};
    }
    std::string read(const std::string& name) const {
        std::ifstream in(fake_.path() / name);
        return {std::istreambuf_iterator<char>(in), {}};
    }

    test::FakeProgram fake_;
    std::string path_;
};

TEST_F(Slurm, TheScriptIsAnArrayWithATaskForEachRun) {
    auto wanted = options();
    wanted.at_once = 8;
    wanted.threads = 2;
    wanted.memory = 3'000'000'000;
    wanted.options = {"--time=8:00:00", "--partition=gpu"};
    const std::vector<std::string> names = {"Pong__sac__1", "Pong__sac__2"};
    const auto script = slurm_script("/my sweep", names, wanted);
    for (const auto* line :
         {"#!/bin/bash\n", "\n#SBATCH --job-name=\"mine\"\n", "\n#SBATCH --array=0-1%8\n",
          "\n#SBATCH --cpus-per-task=2\n", "\n#SBATCH --mem=2862M\n",
          "\n#SBATCH --output=\"/my sweep/slurm/%A_%a.out\"\n", "\n#SBATCH --requeue\n",
          "\n#SBATCH --signal=B:USR1@120\n#SBATCH --time=8:00:00\n#SBATCH --partition=gpu\n",
          "\nruns=(\n    Pong__sac__1\n    Pong__sac__2\n)\n",
          "/cale sweep 'my file.yaml' --only \"${runs[$SLURM_ARRAY_TASK_ID]}\" &\n"})
        EXPECT_THAT(script, HasSubstr(line));
    EXPECT_THAT(slurm_script("/100%j", names, wanted), HasSubstr("--output=\"/100%%j/slurm/%A_%a.out\"\n"));
    auto quoted = wanted;
    quoted.name = "a\"b";
    EXPECT_THAT(test::error_of<ConfigError>([&] { slurm_script("/a", names, quoted); }),
                HasSubstr("sweep a\"b: a directive of Slurm's takes no sweep with a quote"));
    EXPECT_THAT(test::error_of<ConfigError>([&] { slurm_script("/a \"b\"", names, wanted); }),
                HasSubstr("takes no folder with a quote or a line break in its name"));
}

/// Runs the script as a task of an array, with a `cale` that ends with 130 when it is told to stop.
class SlurmScript : public Slurm {
  protected:
    int run_and_signal(int signal) {
        fake_.write_script("cale",
                           "#!/bin/bash\n"
                           "trap 'exit 130' TERM\n"
                           "echo \"$@\" >$(dirname $0)/called\n"
                           "for i in {1..500}; do sleep 0.02; done\n"
                           "exit 7\n");
        const std::vector<std::string> names = {"Pong__sac__1", "Pong__sac__2"};
        const auto script = fake_.write("script", slurm_script(fake_.path(), names, options()));
        const pid_t task = ::fork();
        if (task == 0) {
            ::setenv("SLURM_ARRAY_TASK_ID", "1", 1);
            ::setenv("SLURM_JOB_ID", "17", 1);  // one task has the array's own number
            ::setenv("SLURM_ARRAY_JOB_ID", "17", 1);
            ::execlp("bash", "bash", script.c_str(), nullptr);
        }
        EXPECT_TRUE(test::wait_until([&] { return !read("called").empty(); }));
        ::kill(task, signal);
        int status = 0;
        ::waitpid(task, &status, 0);
        return WEXITSTATUS(status);
    }
};

TEST_F(SlurmScript, IsPreemptedAtACheckpointAndLeavesTheRestToSlurm) {
    EXPECT_EQ(run_and_signal(SIGTERM), 130);
    EXPECT_EQ(read("called"), "sweep my file.yaml --only Pong__sac__2\n");
    EXPECT_EQ(read("scontrol.log"), "");
}

TEST_F(SlurmScript, GoesBackIntoTheQueueWhenItsTimeIsUp) {
    EXPECT_EQ(run_and_signal(SIGUSR1), 130);
    EXPECT_EQ(read("scontrol.log"), "requeue 17_1\n") << "of the array this task alone";
}

TEST_F(Slurm, SubmitsWhatIsLeftInArraysOfTheClustersSize) {
    auto runs = fake_.runs({"fast", "fast", "fast", "fast", "fast"});
    fs::create_directories(fake_.sweep() / "fast_1/checkpoints/step_000000100");
    for (const auto* file : {"config.yaml", "episodes.csv"})
        fake_.write(std::string("runs/fast_1/") + file, "");
    EXPECT_THAT(job_arrays(runs, fake_.sweep()),
                ElementsAre(ElementsAre("fast_0", "fast_2"), ElementsAre("fast_3", "fast_4")));
    EXPECT_THAT(submit(runs, fake_.sweep(), options()),
                ElementsAre("job array 17: 2 runs, " + (fake_.sweep() / "slurm/array_1.sh").string(),
                            "job array 18: 2 runs, " + (fake_.sweep() / "slurm/array_2.sh").string()));
    EXPECT_THAT(read("runs/slurm/array_1.sh"), HasSubstr("runs=(\n    fast_0\n    fast_2\n)\n"));

    fake_.write("queue", "17 0 PENDING\n17 1 RUNNING\n18 1 COMPLETING\n99 0 PENDING\n");
    EXPECT_THAT(queued_runs(fake_.sweep()),
                UnorderedElementsAre(Pair("fast_0", "pending"), Pair("fast_2", "running")));
    EXPECT_EQ(submit(runs, fake_.sweep(), options()).size(), 1u) << "what is queued is not submitted twice";
    EXPECT_THAT(read("runs/slurm/array_3.sh"), HasSubstr("runs=(\n    fast_3\n    fast_4\n)\n"));
}

TEST_F(Slurm, KnowsItsJobsAmongNotesOfTheCluster) {
    const auto runs = fake_.runs({"fast", "fast"});
    fake_.write_script("sbatch",
                       "#!/bin/bash\necho 'sbatch: your project has 17 hours left' >&2\necho '31;cluster'\n");
    EXPECT_THAT(submit(runs, fake_.sweep(), options()), ElementsAre(HasSubstr("job array 31: 2 runs")));
    fake_.write("queue", "the cluster is down on Monday\n31 0 PENDING\n31 1 PENDING\n");
    EXPECT_THAT(queued_runs(fake_.sweep()),
                UnorderedElementsAre(Pair("fast_0", "pending"), Pair("fast_1", "pending")));
}

TEST_F(Slurm, SaysWhatItHasSubmittedBeforeARefusal) {
    const auto runs = fake_.runs({"fast", "fast", "fast"});
    fake_.write_script("sbatch",
                       "#!/bin/bash\n"
                       "case $2 in *array_2.sh) echo 'the limit is one array'; exit 1 ;; esac\n"
                       "echo 31\n");
    EXPECT_THAT(test::error_of<std::runtime_error>([&] { submit(runs, fake_.sweep(), options()); }),
                HasSubstr("the limit is one array; submitted before it: job array 31: 2 runs"));
}

TEST_F(Slurm, TwoDoNotSubmitAtATime) {
    const auto runs = fake_.runs({"fast"});
    fs::create_directories(fake_.sweep());
    {
        const RunLock other(fake_.sweep());
        EXPECT_THAT(test::error_of<ConfigError>([&] { submit(runs, fake_.sweep(), options()); }),
                    HasSubstr("another cale sweep is submitting the runs of " + fake_.sweep().string()));
    }
    EXPECT_EQ(submit(runs, fake_.sweep(), options()).size(), 1u);
}

TEST_F(Slurm, NamesAJobThatItCannotRecord) {
    const auto runs = fake_.runs({"fast"});
    const auto refusal = [&] {
        return test::error_of<std::runtime_error>([&] { submit(runs, fake_.sweep(), options()); });
    };
    fake_.write_script("sbatch", "#!/bin/bash\necho 'queued'\n");
    EXPECT_THAT(refusal(), testing::AllOf(HasSubstr("does not say which job"), HasSubstr("queued")));
    const auto index = (fake_.sweep() / "slurm.json").string();
    fake_.write_script("sbatch", "#!/bin/bash\nmkdir -p " + index + "/full\necho 31\n");
    EXPECT_THAT(refusal(), HasSubstr("scancel 31"));
}

TEST_F(Slurm, LeavesNothingWhereThereIsNothingToSubmit) {
    const auto runs = fake_.runs({"fast", "fast"});
    for (const std::string run : {"fast_0", "fast_1"})
        fs::create_directories(fake_.sweep() / run / "checkpoints/step_000000100");
    for (const auto* file : {"fast_0/episodes.csv", "fast_1/episodes.csv", "fast_0/config.yaml"})
        fake_.write(std::string("runs/") + file, "");
    fake_.write("runs/fast_1/config.yaml", "agent: {mode: slow}");  // a run of other settings
    EXPECT_TRUE(submit(runs, fake_.sweep(), options()).empty());
    EXPECT_FALSE(fs::exists(fake_.sweep() / "slurm"));
    EXPECT_FALSE(fs::exists(fake_.sweep() / "slurm.json"));
}

TEST_F(Slurm, PassesOnWhatItObjectsTo) {
    const auto runs = fake_.runs({"fast"});
    fake_.write_script("sbatch",
                       "#!/bin/bash\necho 'sbatch: error: invalid partition specified: gpu' >&2\nexit 1\n");
    EXPECT_THAT(test::error_of<std::runtime_error>([&] { submit(runs, fake_.sweep(), options()); }),
                HasSubstr("sbatch: error: invalid partition specified: gpu"));
    for (const auto* damaged : {"[{", "[1]", "[{\"job\": \"17\"}]"}) {
        fake_.write("runs/slurm.json", damaged);
        EXPECT_THAT(test::error_of<std::runtime_error>([&] { submit(runs, fake_.sweep(), options()); }),
                    HasSubstr("slurm.json is damaged"))
            << damaged;
    }
    ::setenv("PATH", "/nowhere", 1);
    EXPECT_THAT(test::error_of<ConfigError>([&] { submit(runs, fake_.sweep(), options()); }),
                HasSubstr("there is no sbatch on the PATH"));
}

}  // namespace
}  // namespace cale
