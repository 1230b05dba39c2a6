// train_ppo in two real processes that meet over Gloo, against one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <thread>

#include <sys/types.h>

#include <fmt/format.h>
#include <torch/types.h>

#include "report/csv.h"
#include "storage/files.h"
#include "support/free_port.h"
#include "support/temporary_folder.h"
#include "train/agent_file.h"
#include "train/checkpoint.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr const char* kSettings =
    "--threads 1 --no-progress --seed 3 env.game=breakout env.num_envs=4 env.env_threads=1 "
    "env.max_frames_per_episode=100 agent.encoder=data_efficient agent.hidden_units=16 "
    "agent.rollout_steps=32 agent.minibatch_size=8 agent.epochs=2 agent.anneal_steps=56 log.every=48 "
    "train.checkpoint_every=80 eval.episodes=0";

struct Ended {
    int code;           // of the first process
    std::string first;  // what the processes said
    std::string other;
};

class DistributedEmulator : public testing::Test {
  protected:
    void SetUp() override {
#ifdef __SANITIZE_THREAD__
        GTEST_SKIP() << "LibTorch's Gloo is not compiled for ThreadSanitizer, which sees no order between "
                        "its threads";
#endif
    }

    fs::path run(const std::string& name) const {
        return folder_.path() / name;
    }

    static std::string command(const std::string& arguments) {
        return fmt::format("{}/train_ppo {}", CALE_BINARY_DIR, arguments);
    }

    /// A command line that starts train_ppo as two processes; the shell's exit code is that of the first.
    /// The other's process id is put into the file `pid`.
    std::string two(const std::string& arguments, const std::string& of_the_other) const {
        return fmt::format(
            "export WORLD_SIZE=2 MASTER_ADDR=127.0.0.1 MASTER_PORT={}; RANK=1 {} > {} 2>&1 & echo $! > {}; "
            "RANK=0 timeout -s KILL 300 {} > {} 2>&1; code=$?; wait; exit $code",
            test::free_port(), command(of_the_other), run("other.log").string(), run("pid").string(),
            command(arguments), run("first.log").string());
    }

    Ended start_two(const std::string& arguments, const std::string& of_the_other) const {
        const int status = std::system(two(arguments, of_the_other).c_str());
        return {WEXITSTATUS(status), read_file(run("first.log")), read_file(run("other.log"))};
    }
    Ended start_two(const std::string& arguments) const {
        return start_two(arguments, arguments);
    }

    Ended start_one(const std::string& arguments) const {
        const int status =
            std::system(fmt::format("{} > {} 2>&1", command(arguments), run("first.log").string()).c_str());
        return {WEXITSTATUS(status), read_file(run("first.log")), ""};
    }

    /// Everything but what is computed in floating point, to the bit; that within 1e-4.
    static void expect_same_run(const fs::path& found, const fs::path& expected) {
        for (const auto* name : {"episodes.csv", "joystick_events.csv"})
            EXPECT_EQ(read_file(found / name), read_file(expected / name)) << name;
        const auto checkpoint = list_checkpoints(expected).back().filename();
        EXPECT_TRUE(read_file(found / "checkpoints" / checkpoint / "games.safetensors") ==
                    read_file(expected / "checkpoints" / checkpoint / "games.safetensors"));
        const auto agent = load_agent(found / "checkpoints" / checkpoint);
        double largest = 0;
        for (const auto& [name, value] : load_agent(expected / "checkpoints" / checkpoint)) {
            ASSERT_TRUE(agent.contains(name)) << name;
            const auto difference = (agent.at(name).to(torch::kFloat64) - value.to(torch::kFloat64)).abs();
            if (difference.numel() == 0) continue;
            const double most = difference.max().item<double>();
            EXPECT_LE(most, value.is_floating_point() ? 1e-4 : 0) << name;
            largest = std::max(largest, most);
        }
        RecordProperty("largest_difference", std::to_string(largest));
    }

  private:
    test::TemporaryFolder folder_;
};

TEST_F(DistributedEmulator, TwoProcessesAreOneRun) {
    const auto arguments = [&](const char* name, int steps) {
        return fmt::format("{} --run-dir {} train.total_steps={}", kSettings, run(name).string(), steps);
    };
    const auto resumed = [&](const char* name, int steps) {
        return fmt::format("--resume --no-progress --run-dir {} train.total_steps={}", run(name).string(),
                           steps);
    };
    const auto one = start_one(arguments("one", 240));
    ASSERT_EQ(one.code, 0) << one.first;
    const auto together = start_two(arguments("two", 240));
    ASSERT_EQ(together.code, 0) << together.first << together.other;
    EXPECT_EQ(together.other, "");
    expect_same_run(run("two"), run("one"));

    const auto half = start_two(arguments("parted", 160));
    ASSERT_EQ(half.code, 0) << half.first << half.other;
    const auto rest = start_two(resumed("parted", 240));
    ASSERT_EQ(rest.code, 0) << rest.first << rest.other;
    expect_same_run(run("parted"), run("one"));
}

TEST_F(DistributedEmulator, WhatAMovingStickReachesIsCountedByFrames) {
    const auto arguments = [&](const char* name) {
        return fmt::format("{} --run-dir {} train.total_steps=80 env.stick_speed=0.3", kSettings,
                           run(name).string());
    };
    const auto one = start_one(arguments("one"));
    ASSERT_EQ(one.code, 0) << one.first;
    const auto together = start_two(arguments("two"));
    ASSERT_EQ(together.code, 0) << together.first << together.other;
    // The commands that a moving stick was given, which games.safetensors has, are computed in floating
    // point.
    for (const auto* name : {"episodes.csv", "joystick_events.csv"})
        EXPECT_EQ(read_file(run("two") / name), read_file(run("one") / name)) << name;
    std::int64_t events = 0;
    for (const auto& row : read_whole_csv(run("two") / "joystick_events.csv").rows)
        events += std::stoll(row.at(1));
    EXPECT_GT(events, 2 * 80) << "four frames a step";
}

TEST_F(DistributedEmulator, AnEvaluationThatALongerRunWouldLackLeavesNoTrace) {
    const auto trained = [&](const char* name, int games) {
        auto arguments =
            fmt::format("{} --run-dir {} train.total_steps=80 train.keep_best=true eval.every=160", kSettings,
                        run(name).string());
        arguments.replace(arguments.find("eval.episodes=0"), 15, fmt::format("eval.episodes={}", games));
        return start_two(arguments);
    };
    const auto plain = trained("plain", 0);
    ASSERT_EQ(plain.code, 0) << plain.first << plain.other;
    const auto evaluated = trained("evaluated", 2);
    ASSERT_EQ(evaluated.code, 0) << evaluated.first << evaluated.other;
    EXPECT_TRUE(fs::exists(run("evaluated") / "eval"));
    expect_same_run(run("evaluated"), run("plain"));
}

TEST_F(DistributedEmulator, WhatCannotBeSharedIsRefused) {
    const auto dir = run("refused").string();
    const auto odd = start_two(fmt::format(
        "{} --run-dir {} env.num_envs=5 agent.rollout_steps=40 agent.minibatch_size=8", kSettings, dir));
    EXPECT_EQ(odd.code, 2);
    EXPECT_THAT(odd.first, HasSubstr("env.num_envs is 5, which WORLD_SIZE=2 processes cannot share equally"));

    const auto games =
        start_two(fmt::format("{} --run-dir {} env.game=pong,breakout env.num_envs=2", kSettings, dir));
    EXPECT_EQ(games.code, 2);
    EXPECT_THAT(games.first, HasSubstr("make it a multiple of 4"));
    EXPECT_FALSE(std::filesystem::exists(run("refused") / "config.yaml"));

    const auto differ = start_two(fmt::format("{} --run-dir {}", kSettings, dir),
                                  fmt::format("{} --run-dir {} agent.gamma=0.5", kSettings, dir));
    EXPECT_EQ(differ.code, 1);
    EXPECT_THAT(differ.first,
                HasSubstr("process 0 of 2: the processes of this run were started with different"));
    EXPECT_THAT(differ.other,
                HasSubstr("process 1 of 2: the processes of this run were started with different"));

    const auto parted = run("parted").string();
    const auto pauses = start_two(fmt::format("{} --run-dir {}", kSettings, parted),
                                  fmt::format("{} --run-dir {} --until 80", kSettings, parted));
    EXPECT_EQ(pauses.code, 1);
    for (const auto& said : {pauses.first, pauses.other})
        EXPECT_THAT(said, HasSubstr("do not have the same --until; give all of them the same command line"));

    const auto beside = start_two(fmt::format("{} --run-dir {} train.overlap=true", kSettings, dir));
    EXPECT_EQ(beside.code, 2);
    EXPECT_THAT(beside.first, HasSubstr("learns beside its environments in one process only"));

    const int sac = std::system(fmt::format("WORLD_SIZE=2 {}/train_sac --run-dir {} 2> {}", CALE_BINARY_DIR,
                                            dir, run("first.log").string())
                                    .c_str());
    EXPECT_EQ(WEXITSTATUS(sac), 2);
    EXPECT_FALSE(fs::exists(dir));
}

TEST_F(DistributedEmulator, AKilledProcessEndsTheOtherWhichCanBeResumed) {
    const auto arguments =
        fmt::format("{} --run-dir {} train.total_steps=1000000", kSettings, run("run").string());
    std::thread killer([&] {
        while (list_checkpoints(run("run")).empty() && !fs::exists(run("ended")))
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        if (!fs::exists(run("ended"))) ::kill(std::stoi(read_file(run("pid"))), SIGKILL);
    });
    const auto ended = start_two(arguments);
    write_file_atomically(run("ended"), "");
    killer.join();
    EXPECT_EQ(ended.code, 1) << "137: it did not end by itself";
    EXPECT_THAT(ended.first, HasSubstr("process 0 of 2: another process of this run has ended"));
    ASSERT_FALSE(list_checkpoints(run("run")).empty());
    const auto resumed = start_one(
        fmt::format("--resume --no-progress --run-dir {} train.total_steps=100", run("run").string()));
    EXPECT_EQ(resumed.code, 0) << resumed.first;
}

}  // namespace
}  // namespace cale
