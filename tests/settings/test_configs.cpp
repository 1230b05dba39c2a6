// Every shipped configuration, run by the program it is for.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "storage/files.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> shipped_configurations() {
    std::vector<fs::path> found;
    for (const auto& entry : fs::recursive_directory_iterator(CALE_SOURCE_DIR "/configs"))
        if (entry.path().extension() == ".yaml") found.push_back(entry.path());
    std::sort(found.begin(), found.end());
    return found;
}

std::string agent_of(const fs::path& configuration) {
    return configuration.parent_path().filename();
}

class ConfigurationsSlow : public testing::TestWithParam<fs::path> {};

/// Little memory, and updates before the 200th step: 200 steps see every part at work.
TEST_P(ConfigurationsSlow, RunsTwoHundredSteps) {
    const test::TemporaryFolder folder;
    const auto run = folder.path() / "run";
    auto agent = agent_of(GetParam());
    auto configuration = GetParam().string();
    if (agent == "env") {  // an agent's file is extended with it
        agent = "sac";
        configuration =
            folder.write("extended.yaml", "extends: [" CALE_SOURCE_DIR "/configs/sac/atari100k.yaml, " +
                                              configuration + "]\n");
    }
    std::string command = CALE_BINARY_DIR "/train_" + agent + " --config " + configuration + " --run-dir " +
                          run.string() + " --threads 1 --no-progress --seed 3";
    const std::string of_agent = agent == "ppo"
                                     ? "agent.rollout_steps=64 agent.minibatch_size=16 agent.epochs=1"
                                     : "agent.min_replay=180 agent.replay_capacity=1000 agent.batch_size=4";
    command += " train.total_steps=200 eval.episodes=1 eval.video=false env.max_frames_per_episode=400 " +
               of_agent + " log.every=50 > " + (folder.path() / "output").string() + " 2>&1";
    EXPECT_EQ(std::system(command.c_str()), 0) << command << "\n" << read_file(folder.path() / "output");
    EXPECT_TRUE(fs::exists(run / "checkpoints" / "step_000000200"));
    const auto progress = read_file(run / "progress.csv");
    const std::string loss = agent == "ppo" ? "losses/policy_loss" : "losses/q";
    EXPECT_NE(progress.find(loss), std::string::npos) << "it never learned:\n" << progress;
}

INSTANTIATE_TEST_SUITE_P(Files, ConfigurationsSlow, testing::ValuesIn(shipped_configurations()),
                         [](const auto& chosen) {
                             return agent_of(chosen.param) + "_" + chosen.param.stem().string();
                         });

}  // namespace
}  // namespace cale
