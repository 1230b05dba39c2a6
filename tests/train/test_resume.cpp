// Runs killed at any instant and resumed, against runs that were never interrupted: the real programs.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "storage/files.h"
#include "storage/manifest.h"
#include "support/temporary_folder.h"
#include "train/checkpoint.h"
#include "train/log.h"
#include "train/resume.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

struct Case {
    std::string name, program, settings;
};

std::ostream& operator<<(std::ostream& out, const Case& one) {
    return out << one.name;
}

constexpr const char* kReplay = "agent.min_replay=60 agent.replay_capacity=300 agent.batch_size=4 ";

std::vector<Case> cases() {
    const std::string small = "agent.encoder=data_efficient agent.hidden_units=16 ";
    return {
        {"Sac", "sac", small + kReplay + "agent.update_period=4 agent.update_horizon=3 env.num_envs=2"},
        {"Sacd", "sacd", small + kReplay + "agent.update_period=4 env.num_envs=1"},
        {"Dqn", "dqn", kReplay + std::string("agent.hidden_units=16 agent.update_period=4 env.num_envs=3")},
        {"Der", "der", kReplay + std::string("agent.hidden_units=16 agent.update_period=4 env.num_envs=1")},
        {"Ppo", "ppo", small + "agent.rollout_steps=64 agent.minibatch_size=16 env.num_envs=2"},
        {"PpoDopamine", "ppo",
         small + "agent.rollout_steps=64 agent.minibatch_size=16 agent.replay_terminal=dopamine "
                 "agent.stack_after_update=repeated env.num_envs=1"},
        {"PpoOverlap", "ppo",
         small + "agent.rollout_steps=64 agent.minibatch_size=16 env.num_envs=2 train.overlap=true"},
        {"MovingStick", "sac",
         small + kReplay +
             "agent.update_period=4 env.num_envs=2 env.stick_speed=0.2 env.stick_damping=0.6 "
             "env.button_frames=3 env.action_latency=0-8 env.observation_latency=0-4 "
             "env.actuation_noise=0.05"},
        {"Overlap", "sac", small + kReplay + "agent.update_period=4 env.num_envs=2 train.overlap=true"},
    };
}

/// Kills per run; more by hand: CALE_KILLS=30 test_train --gtest_filter='*ResumeSlow*'
int kills() {
    const char* wanted = std::getenv("CALE_KILLS");
    return wanted != nullptr ? std::atoi(wanted) : 2;
}

class ResumeSlow : public testing::TestWithParam<Case> {
  protected:
    std::string command(const fs::path& run) const {
        if (!list_checkpoints(run).empty())
            return fmt::format("{}/train_{} --resume --run-dir {} --no-progress >> {}.log 2>&1",
                               CALE_BINARY_DIR, GetParam().program, run.string(), run.string());
        fs::remove_all(run);
        return fmt::format(
            "{}/train_{} --run-dir {} --threads 1 --no-progress --seed 5 env.game=breakout "
            "env.sticky_probability=0.25 env.max_frames_per_episode=500 train.total_steps=420 "
            "train.checkpoint_every=30 train.keep_every=100 train.keep_best=true log.every=80 eval.every=150 "
            "eval.episodes=1 eval.video=false {} >> {}.log 2>&1",
            CALE_BINARY_DIR, GetParam().program, run.string(), GetParam().settings, run.string());
    }
};

/// progress.csv without what the clock says.
std::map<std::string, std::vector<std::string>> metrics_of(const fs::path& run) {
    std::map<std::string, std::vector<std::string>> metrics;
    for (const auto& [name, values] : read_progress(run / "progress.csv")) {
        if (name == "seconds" || name == "steps_per_second" || name.starts_with("time/")) continue;
        for (const double value : values) metrics[name].push_back(fmt::format("{}", value));
    }
    return metrics;
}

TEST_P(ResumeSlow, AKilledRunIsTheSameRun) {
    const test::TemporaryFolder folder;
    const auto whole = folder.path() / "whole", killed = folder.path() / "killed";
    const auto start = std::chrono::steady_clock::now();
    ASSERT_EQ(std::system(command(whole).c_str()), 0) << read_file(whole.string() + ".log");
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

    std::mt19937 random(std::random_device{}());
    std::uniform_real_distribution<double> instant(0.1, seconds);
    std::string instants;
    for (int kill = 0; kill < kills(); ++kill) {
        const double after = instant(random);
        instants += fmt::format(" {:.3f}", after);
        static_cast<void>(
            std::system(fmt::format("timeout -s KILL {:.3f} {}", after, command(killed)).c_str()));
        for (const auto& checkpoint : list_checkpoints(killed))
            EXPECT_NO_THROW(verify(checkpoint, read_manifest(checkpoint))) << "killed after" << instants;
    }
    if (list_checkpoints(killed).empty()) {  // killed before the first, each time
        static_cast<void>(
            std::system(fmt::format("{} & run=$!; until [ -e {}/checkpoints/step_000000030 ]; do "
                                    "kill -0 $run || break; sleep 0.02; done; kill -KILL $run",
                                    command(killed), killed.string())
                            .c_str()));
    }
    ASSERT_FALSE(list_checkpoints(killed).empty()) << "nothing would be resumed";
    ASSERT_EQ(std::system(command(killed).c_str()), 0) << read_file(killed.string() + ".log");

    const auto last = [](const fs::path& run) { return list_checkpoints(run).back(); };
    EXPECT_EQ(read_file(killed / "episodes.csv"), read_file(whole / "episodes.csv"))
        << "killed after" << instants;
    EXPECT_EQ(read_file(killed / "joystick_events.csv"), read_file(whole / "joystick_events.csv"))
        << instants;
    EXPECT_EQ(metrics_of(killed), metrics_of(whole)) << "killed after" << instants;
    const auto files_of = [](const fs::path& checkpoint) {
        std::map<std::string, std::string> files;
        for (const auto& entry : fs::directory_iterator(checkpoint))
            files[entry.path().filename()] = read_file(entry.path());
        files.erase("state.json");     // knows the clock
        files.erase("manifest.json");  // knows state.json
        return files;
    };
    const auto names = [](const fs::path& run) {
        std::vector<std::string> result;
        for (const auto& checkpoint : list_checkpoints(run)) result.push_back(checkpoint.filename());
        return result;
    };
    EXPECT_EQ(names(killed), names(whole)) << "killed after" << instants;
    EXPECT_GE(names(whole).size(), 5u) << "four of train.keep_every, and the last";
    EXPECT_EQ(fs::read_symlink(killed / "checkpoints/best"), fs::read_symlink(whole / "checkpoints/best"));
    const auto expected = files_of(last(whole)), found = files_of(last(killed));
    EXPECT_GE(expected.size(), 2u);
    EXPECT_EQ(found.size(), expected.size());
    for (const auto& [file, bytes] : expected)
        EXPECT_TRUE(found.contains(file) && found.at(file) == bytes) << file << ", killed after" << instants;
    for (const auto& entry : fs::directory_iterator(whole / "eval"))
        EXPECT_EQ(read_file(killed / "eval" / entry.path().filename()), read_file(entry.path())) << instants;
}

TEST(ResumeOptions, CanBeTyped) {
    EXPECT_EQ(resume_options("runs/my run"), "--resume --run-dir 'runs/my run'");
    EXPECT_EQ(resume_options("runs/1"), "--resume --run-dir runs/1");
}

INSTANTIATE_TEST_SUITE_P(Programs, ResumeSlow, testing::ValuesIn(cases()),
                         [](const auto& chosen) { return chosen.param.name; });

}  // namespace
}  // namespace cale
