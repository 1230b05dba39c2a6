// Processes that train together, as threads of this one: each has its own connections over Gloo.
#include "parallel/process_group.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <future>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include "agent_worlds.h"
#include "agents/env_share.h"
#include "support/free_port.h"
#include "test_device.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

/// Runs `work` as each of the processes of a group. Throws what the first of them threw.
void in_a_group_of(int size, const std::function<void(const ProcessGroup&)>& work) {
    // c10d's log of operations is one per process and not made for several ranks in one: off.
    ::setenv("TORCH_FR_BUFFER_SIZE", "0", 0);
    const auto port = test::free_port();
    std::vector<std::future<void>> processes;
    for (int rank = 0; rank < size; ++rank) {
        processes.push_back(std::async(std::launch::async, [=] {
            work(
                ProcessGroup({.rank = rank, .size = size, .master_address = "127.0.0.1", .master_port = port},
                             torch::kCPU, std::chrono::seconds(60)));
        }));
    }
    for (auto& process : processes) process.wait();
    for (auto& process : processes) process.get();
}

TEST(ProcessGroup, AloneItChangesNothing) {
    const ProcessGroup alone;
    EXPECT_TRUE(alone.single());
    EXPECT_TRUE(alone.first());
    auto numbers = torch::arange(3.0);
    alone.sum({numbers});
    EXPECT_TRUE(torch::equal(numbers, torch::arange(3.0)));
    EXPECT_TRUE(alone.any(true));
    EXPECT_FALSE(alone.any(false));
    EXPECT_EQ(alone.gather({{"a", numbers}}).size(), 1U);
}

TEST(ProcessGroup, SumsListsOfTensorsInPlace) {
    in_a_group_of(3, [](const ProcessGroup& processes) {
        const auto rank = static_cast<float>(processes.rank());
        auto matrix = torch::full({2, 3}, rank + 1);
        auto channels_last = torch::arange(16.0f).view({1, 2, 2, 4}) * (rank + 1);
        channels_last = channels_last.contiguous(at::MemoryFormat::ChannelsLast);
        processes.sum({matrix, channels_last, torch::empty({0})});
        EXPECT_TRUE(torch::equal(matrix, torch::full({2, 3}, 6.0f)));
        EXPECT_TRUE(torch::equal(channels_last, torch::arange(16.0f).view({1, 2, 2, 4}) * 6));
    });
}

TEST(ProcessGroup, GathersForTheFirst) {
    in_a_group_of(2, [](const ProcessGroup& processes) {
        const auto rank = processes.rank();
        const auto all = processes.gather({{"same name", torch::arange(4 + 100 * rank)},
                                           {"of " + std::to_string(rank), torch::ones({2, 2})}});
        ASSERT_EQ(all.size(), processes.first() ? 2U : 0U);
        if (!processes.first()) return;
        for (std::int64_t i = 0; i < 2; ++i) {
            const auto& one = all[static_cast<std::size_t>(i)];
            EXPECT_EQ(one.size(), 2U);
            EXPECT_TRUE(torch::equal(one.at("same name"), torch::arange(4 + 100 * i)));
            EXPECT_TRUE(torch::equal(one.at("of " + std::to_string(i)), torch::ones({2, 2})));
        }
    });
}

TEST(ProcessGroup, OneThatWantsToStopStopsAll) {
    in_a_group_of(3, [](const ProcessGroup& processes) {
        EXPECT_TRUE(processes.any(processes.rank() == 1));
        EXPECT_FALSE(processes.any(false));
    });
}

TEST(ProcessGroup, SettingsThatDifferAreRefusedByAll) {
    in_a_group_of(3, [](const ProcessGroup& processes) {
        EXPECT_NO_THROW(processes.require_same("a", "complaint"));
        const auto text = processes.rank() == 2 ? "b" : "a";
        EXPECT_THAT([&] { processes.require_same(text, "complaint"); },
                    ThrowsMessage<std::runtime_error>("complaint"));
    });
}

TEST(ProcessGroup, AProcessWhosePeerIsGoneSaysSo) {
    in_a_group_of(2, [](const ProcessGroup& processes) {
        EXPECT_FALSE(processes.any(false));
        if (!processes.first()) return;
        EXPECT_THAT([&] { processes.any(false); },
                    ThrowsMessage<std::runtime_error>(
                        AllOf(HasSubstr("process 0 of 2: another process of this run has ended"),
                              HasSubstr("--resume"), testing::Not(HasSubstr("\n")))));
    });
}

TEST(ProcessGroup, MomentsAreThoseOfAllParts) {
    const auto whole = torch::randn({50}) * 3 + 100;
    const auto alone = moments(whole, {});
    in_a_group_of(2, [&](const ProcessGroup& processes) {
        const auto part = processes.first() ? whole.slice(0, 0, 11) : whole.slice(0, 11);
        const auto found = moments(part, processes);
        EXPECT_EQ(found.count, 50);
        EXPECT_NEAR(found.mean.item<double>(), alone.mean.item<double>(), 1e-4);
        EXPECT_NEAR(found.deviation.item<double>(), alone.deviation.item<double>(), 1e-4);
        EXPECT_EQ(found.mean.scalar_type(), torch::kFloat32);
    });
}

/// Variables of the environment that are as they were when it ends.
class Environment : public testing::Test {
  protected:
    void SetUp() override {
        for (const auto* name : kNames) unsetenv(name);
    }
    void TearDown() override { SetUp(); }
    void set(const char* name, const char* value) { setenv(name, value, 1); }

  private:
    static constexpr std::array kNames{"WORLD_SIZE",  "RANK",       "MASTER_ADDR",
                                       "MASTER_PORT", "LOCAL_RANK", "LOCAL_WORLD_SIZE"};
};

TEST_F(Environment, SaysWhereAProcessIs) {
    EXPECT_FALSE(rank_from_environment());
    set("WORLD_SIZE", "1");
    EXPECT_FALSE(rank_from_environment());
    set("WORLD_SIZE", "4");
    set("RANK", "3");
    set("MASTER_ADDR", "node1");
    set("MASTER_PORT", "1234");
    set("LOCAL_RANK", "1");
    set("LOCAL_WORLD_SIZE", "2");
    const auto place = rank_from_environment();
    ASSERT_TRUE(place);
    EXPECT_EQ(place->size, 4);
    EXPECT_EQ(place->rank, 3);
    EXPECT_EQ(place->local_rank, 1);
    EXPECT_EQ(place->local_size, 2);
    EXPECT_EQ(place->master_address, "node1");
    EXPECT_EQ(place->master_port, 1234);
}

TEST_F(Environment, MistakesNameTheVariable) {
    const auto said = [](const std::string& text) {
        return ThrowsMessage<std::invalid_argument>(HasSubstr(text));
    };
    set("WORLD_SIZE", "many");
    EXPECT_THAT(rank_from_environment, said("WORLD_SIZE=many: must be a whole number"));
    set("WORLD_SIZE", "2");
    EXPECT_THAT(rank_from_environment, said("WORLD_SIZE=2 asks for several processes, but RANK is not set"));
    set("RANK", "2");
    EXPECT_THAT(rank_from_environment, said("RANK=2: must be a whole number from 0 to 1"));
    set("RANK", "1");
    EXPECT_THAT(rank_from_environment, said("MASTER_ADDR is not set"));
    set("MASTER_ADDR", "localhost");
    set("MASTER_PORT", "0");
    EXPECT_THAT(rank_from_environment, said("MASTER_PORT=0"));
}

// PPO -----------------------------------------------------------------------------------

/// A share of a noise step, as one of the processes lives through it.
void live(Agent& agent, const AgentSpec& whole, std::int64_t first, std::int64_t count, std::int64_t step) {
    const NoiseStep all(whole, step);
    const auto own = [&](const torch::Tensor& tensor) {
        return tensor.slice(0, first, first + count).contiguous();
    };
    const auto observations = own(all.observations), frames = own(all.frames),
               final_frames = own(all.final_frames);
    agent.update(observations);
    const auto actions = agent.act(observations, ActMode::train);
    const auto bytes = [](const torch::Tensor& tensor) {
        return std::span(tensor.const_data_ptr<std::uint8_t>(), static_cast<std::size_t>(tensor.numel()));
    };
    agent.observe(
        {.frames = bytes(frames),
         .actions = actions,
         .results =
             std::span(all.results).subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(count)),
         .final_frames = bytes(final_frames)});
}

struct World {
    std::string name;
    AgentSpec spec;
    PpoConfig config;
};

std::ostream& operator<<(std::ostream& out, const World& world) {
    return out << world.name;
}

std::vector<World> worlds() {
    const auto with = [](auto change) {
        auto config = small_ppo();
        config.rollout_steps = 32;
        config.minibatch_size = 8;
        change(config);
        return config;
    };
    return {
        {"Joystick", joystick_world(4), with([](auto&) {})},
        // Not clipped: on the clip's edge a ratio may fall on either side, and its gradient with it. With
        // Adam's own epsilon a unit that rounding turns on or off became a whole step of its weights, on
        // AVX-512.
        {"Discrete", discrete_world(4), with([](auto& config) {
             config.clip = 10;
             config.adam_epsilon = 1e-3;
         })},
        {"Contiguous", joystick_world(4),
         with([](auto& config) { config.minibatches = Minibatches::contiguous; })},
        {"EpsilonGreedy", discrete_world(4),
         with([](auto& config) { config.exploration = Exploration::epsilon_greedy; })},
        // Now and then a process has no row of a minibatch.
        {"SmallMinibatches", joystick_world(4), with([](auto& config) {
             config.minibatch_size = 4;
             config.epochs = 1;
         })},
    };
}

class PpoInProcesses : public testing::TestWithParam<World> {
  protected:
    void SetUp() override {
        if (!test_device().is_cpu())
            GTEST_SKIP() << "these processes are threads, and NCCL wants a GPU for each";
    }

    static constexpr std::int64_t kSteps = 60;  // of four environments: 7 updates, and a rollout under way

    std::unique_ptr<Agent> alone() const { return make_ppo(GetParam().config, GetParam().spec); }

    AgentSpec share(const ProcessGroup& processes) const {
        auto spec = GetParam().spec;
        spec.num_envs /= processes.size();
        spec.processes = &processes;
        return spec;
    }

    void live(Agent& agent, const ProcessGroup& processes, std::int64_t from, std::int64_t to) const {
        const auto count = GetParam().spec.num_envs / processes.size();
        for (std::int64_t step = from; step < to; ++step)
            cale::live(agent, GetParam().spec, count * processes.rank(), count, step);
    }

    /// What is counted, drawn and seen is the same; what is computed differs by the order of sums, which Adam
    /// makes a part of a step where a gradient is close to zero. Steps are 2.5e-4 long.
    static void expect_close(const TensorMap& found, const TensorMap& expected) {
        ASSERT_EQ(found.size(), expected.size());
        for (const auto& [name, value] : expected) {
            ASSERT_EQ(found.at(name).sizes(), value.sizes()) << name;
            if (!value.is_floating_point()) {
                EXPECT_TRUE(torch::equal(found.at(name), value)) << name;
                continue;
            }
            EXPECT_TRUE(torch::allclose(found.at(name), value, 1e-4, 1e-4))
                << name << ": " << (found.at(name) - value).abs().max().item<double>();
        }
    }
};

TEST_P(PpoInProcesses, TwoLearnWhatOneLearns) {
    const auto one = alone();
    live(*one, {}, 0, kSteps);
    in_a_group_of(2, [&](const ProcessGroup& processes) {
        const auto agent = make_ppo(GetParam().config, share(processes));
        live(*agent, processes, 0, kSteps);
        const auto metrics = agent->metrics();
        for (const auto& [name, value] : one->metrics())
            EXPECT_NEAR(metrics.at(name), value, 1e-3 * std::max(1.0, std::abs(value))) << name;
        const auto state = agent->state();
        if (processes.first()) expect_close(state, one->state());
    });
}

TEST_P(PpoInProcesses, TwoGoOnWhereOneStopped) {
    const auto one = alone();
    live(*one, {}, 0, kSteps / 2);
    const auto half = one->state();
    live(*one, {}, kSteps / 2, kSteps);
    in_a_group_of(2, [&](const ProcessGroup& processes) {
        const auto agent = make_ppo(GetParam().config, share(processes));
        agent->load_state(half);
        live(*agent, processes, kSteps / 2, kSteps);
        const auto state = agent->state();
        if (processes.first()) expect_close(state, one->state());
    });
}

INSTANTIATE_TEST_SUITE_P(Worlds, PpoInProcesses, testing::ValuesIn(worlds()),
                         [](const auto& chosen) { return chosen.param.name; });

TEST(PpoProcesses, TheDopamineRuleIsForOne) {
    in_a_group_of(2, [](const ProcessGroup& processes) {
        auto spec = joystick_world(1);
        spec.processes = &processes;
        auto config = small_ppo();
        config.replay_terminal = ReplayTerminal::dopamine;
        EXPECT_FALSE(processes.any(false));  // all are there
        EXPECT_THAT([&] { make_ppo(config, spec); },
                    ThrowsMessage<std::invalid_argument>(HasSubstr("env.num_envs = 1, not 2")));
    });
}

TEST(RolloutShare, JoinsAndPartsWhatWasCutOff) {
    const auto share = [](std::int64_t cuts) {
        return TensorMap{{"observation", torch::randint(0, 255, {3, 2, 2, 4, 4}, torch::kUInt8)},
                         {"action", torch::randn({3, 2, 3})},
                         {"reward", torch::randn({3, 2})},
                         {"terminal", torch::zeros({3, 2})},
                         {"truncation_at", torch::ones({cuts, 2}, torch::kInt64)},
                         {"truncation_observation", torch::randint(0, 255, {cuts, 2, 4, 4}, torch::kUInt8)}};
    };
    const std::vector<TensorMap> shares{share(2), share(0), share(1)};
    const auto whole = joined_rollouts(shares);
    const auto share_of = [](std::int64_t rank, std::int64_t all) {
        EnvShare of(all);
        of.first = 2 * rank;
        of.count = 2;
        return of;
    };
    EXPECT_EQ(whole.at("observation").size(1), 6);
    EXPECT_EQ(whole.at("truncation_at")[2][1].item<std::int64_t>(), 5);
    for (std::int64_t i = 0; i < 3; ++i)
        expect_equal(share_of_rollout(whole, share_of(i, 6)), shares[static_cast<std::size_t>(i)]);
    EXPECT_THAT([&] { share_of_rollout(whole, share_of(0, 8)); },
                ThrowsMessage<std::runtime_error>(HasSubstr("of 6 environments, not of 8")));
}

}  // namespace
}  // namespace cale
