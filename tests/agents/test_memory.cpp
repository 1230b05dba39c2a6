// What an agent takes is known before it is made.
#include <cstdint>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/off_policy_memory.h"
#include "agents/on_policy_memory.h"
#include "agents/ppo.h"
#include "agents/sac.h"
#include "agents/sacd.h"
#include "networks/layers.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

constexpr std::int64_t kGigabyte = 1'000'000'000;

AgentSpec world(std::int64_t num_actions) {
    AgentSpec spec;
    if (num_actions > 0) spec.action_space = Discrete{num_actions};
    return spec;
}

template <class Config>
std::string refusal(const Config& config, std::int64_t available) {
    const auto spec = world(Config::kDiscrete ? 18 : 0);
    return test::error_of<std::runtime_error>([&] { check_memory(config, spec, available); });
}

template <class Config>
class AgentMemory : public testing::Test {};
using Configs = testing::Types<SacConfig, SacdConfig, PpoConfig, DqnConfig, DerConfig>;
TYPED_TEST_SUITE(AgentMemory, Configs);

TYPED_TEST(AgentMemory, OfTheDefaultsIsTheReplaysAndALittle) {
    const TypeParam config;
    EXPECT_EQ(refusal(config, 12 * kGigabyte), "no error");
    EXPECT_THAT(refusal(config, 1'000'000),
                StartsWith("the network, with its gradients, Adam's moments and"));
    if constexpr (requires { config.replay; })  // of a million transitions
        EXPECT_THAT(refusal(config, 5 * kGigabyte), HasSubstr("lower agent.replay_capacity"));
    else
        EXPECT_EQ(refusal(config, 5 * kGigabyte), "no error");
}

TYPED_TEST(AgentMemory, OfALargeNetworkIsRefusedWithTheSettingsToLower) {
    TypeParam config;
    if constexpr (requires { config.network; }) {
        config.network.hidden_units = 65'536;
        config.network.hidden_layers = 16;
    } else {
        config.hidden_units = 65'536;
    }
    const auto sentence = refusal(config, 8 * kGigabyte);
    EXPECT_THAT(sentence, HasSubstr(" and 8 GB are available: lower agent.hidden_units"));
}

TEST(MemoryBesideNetworks, CountsGradientsMomentsTargetsAndCopies) {
    const AgentSpec spec;
    EXPECT_EQ(memory_beside({.parameters = 10, .target = true, .settings = ""}, spec, 100), 100 - 90);
    EXPECT_EQ(memory_beside({.parameters = 10, .target = false, .settings = ""}, spec, 100), 100 - 70);
    AgentSpec elsewhere;
    elsewhere.device = torch::Device(torch::kCUDA, 0);
    EXPECT_EQ(memory_beside({.parameters = 10, .target = true, .settings = ""}, elsewhere, 100), 100 - 40);
}

TYPED_TEST(AgentMemory, OfALargeBatchIsRefusedWithTheSettingToLower) {
    TypeParam config;
    if constexpr (requires { config.replay.batch_size; }) {
        config.replay.batch_size = 65'536;
    } else {
        config.minibatch_size = 65'536;
    }
    EXPECT_THAT(refusal(config, 11 * kGigabyte),
                testing::MatchesRegex("a batch of 65536 needs .* GB of memory and 1.*batch_size"));
}

TEST(MemoryBesideBatches, CountsFramesNumbersAndGradients) {
    AgentSpec spec;
    spec.observation = {.stack = 2, .shape = {5}};
    const NetworkSpec network{
        .observation = {2, 5},
        .layers = {Layer::of(Layer::Kind::flatten), Layer::dense("fc", 3), Layer::of(Layer::Kind::relu)},
        .head = {}};
    const Dense fc(10, 3, zeros(), no_values());
    const auto beside = [&] {
        return memory_beside_batch({*fc, network}, 4, spec, 1'000, "agent.batch_size");
    };
    EXPECT_EQ(beside(), 1'000 - 4 * (2 * 10 + 4 * (10 + 2 * 3)));
    spec.precision = Precision::bf16;
    EXPECT_EQ(beside(), 1'000 - 4 * (2 * 10 + 2 * (10 + 2 * 3)));
    spec.device = torch::Device(torch::kCUDA, 0);
    EXPECT_EQ(beside(), 1'000 - 4 * 2 * 10);
}

TEST(AgentMemoryOnTheCpu, HoldsTheProjectionOfABatch) {
    DerConfig der;
    der.replay.replay_capacity = 1'000;
    EXPECT_EQ(projection_bytes(der), 4 * 32 * 51 * 51);
    der.num_atoms = 10'000;
    EXPECT_THAT(refusal(der, 10 * kGigabyte),
                AllOf(StartsWith("C51's projection of a batch needs 12.8 GB of memory"),
                      HasSubstr("lower agent.batch_size or agent.num_atoms")));
    EXPECT_EQ(refusal(der, 40 * kGigabyte), "no error");
    der.distributional = false;
    EXPECT_EQ(projection_bytes(der), 0);

    SacConfig sac;
    EXPECT_EQ(projection_bytes(sac), 0);
    sac.critic.atoms = 51;
    EXPECT_EQ(projection_bytes(sac), 4 * 32 * 51 * 51);
    EXPECT_EQ(projection_bytes(DqnConfig()), 0);
}

TEST(AgentMemoryOnTheCpu, HoldsEveryFrameTwiceWhereTheReplayIsOnTheDevice) {
    DqnConfig config;
    EXPECT_EQ(refusal(config, 12 * kGigabyte), "no error");
    config.replay.replay_on_device = true;
    EXPECT_THAT(refusal(config, 12 * kGigabyte), StartsWith("the replay needs 14.2 GB of memory"));
}

TEST(AgentMemoryOfPpo, HoldsASecondNetworkWithOverlap) {
    const auto gigabytes = [](bool overlap) {
        auto spec = world(0);
        spec.overlap = overlap;
        const auto sentence =
            test::error_of<std::runtime_error>([&] { check_memory(PpoConfig(), spec, /*available=*/0); });
        return std::stod(sentence.substr(sentence.find("needs ") + 6));
    };
    EXPECT_NEAR(gigabytes(true) / gigabytes(false), 9.0 / 7, 0.02);
}

TEST(AgentMemoryOfPpo, HoldsTheRollout) {
    PpoConfig config;
    config.rollout_steps = 1'000'000;
    EXPECT_THAT(refusal(config, 8 * kGigabyte), StartsWith("the rollout needs 56.4 GB of memory and 7."));
}

}  // namespace
}  // namespace cale
