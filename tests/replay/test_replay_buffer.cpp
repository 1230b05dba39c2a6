// The rings, sampling, memory, and what is refused.
#include <algorithm>
#include <deque>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "numbered_frames.h"
#include "replay/available_memory.h"
#include "replay/replay_memory.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

/// The definition of both rules, written without a thought for memory or speed: keeps
/// every episode and every transition for ever.
class NaiveReplay {
  public:
    explicit NaiveReplay(const ReplayConfig& config)
        : config_(config), episodes_(static_cast<std::size_t>(config.num_envs)) {}

    void add(const NumberedStep& step, std::int64_t env) {
        auto& episode = episodes_[static_cast<std::size_t>(env)];
        episode.push_back(step);
        if (config_.replay_terminal == ReplayTerminal::corrected)
            corrected(episode);
        else
            dopamine(episode);
        if (step.terminal || step.truncated) episode.clear();
    }

    const std::vector<NumberedTransition>& transitions() const { return transitions_; }

  private:
    using Episode = std::vector<NumberedStep>;

    std::vector<std::uint32_t> stack(const Episode& episode, std::size_t end) const {
        std::vector<std::uint32_t> frames(static_cast<std::size_t>(config_.observation.stack), 0);
        for (std::size_t i = 0; i < frames.size() && i < end; ++i)
            frames[frames.size() - 1 - i] = episode[end - 1 - i].frame;
        return frames;
    }

    double sum(const Episode& episode, std::size_t start, std::size_t end) const {
        double total = 0, weight = 1;
        for (std::size_t t = start; t < end; ++t, weight *= config_.gamma)
            total += weight * static_cast<double>(episode[t].reward);
        return total;
    }

    void store(const Episode& episode, std::size_t start, std::size_t rewards_end, std::size_t next_end,
               double discount) {
        transitions_.push_back({stack(episode, start + 1), episode[start].action,
                                static_cast<float>(sum(episode, start, rewards_end)),
                                static_cast<float>(discount), stack(episode, next_end)});
    }

    void corrected(Episode episode) {
        const auto horizon = static_cast<std::size_t>(config_.update_horizon);
        const std::size_t size = episode.size();
        const NumberedStep last = episode.back();
        if (last.truncated && !last.terminal) episode.push_back({.frame = last.final_frame});
        for (std::size_t start = 0; start < size; ++start) {
            const std::size_t end = std::min(start + horizon, size);
            const bool completed_now = start + horizon == size - 1;
            const bool flushed_now = (last.terminal || last.truncated) && start + horizon >= size;
            if (completed_now)
                store(episode, start, end, end + 1, std::pow(config_.gamma, horizon));
            else if (flushed_now && last.terminal)
                store(episode, start, end, size, 0);
            else if (flushed_now)
                store(episode, start, end, size + 1, std::pow(config_.gamma, end - start));
        }
    }

    void dopamine(const Episode& episode) {
        const auto horizon = static_cast<std::size_t>(config_.update_horizon);
        const auto window = static_cast<std::size_t>(config_.update_horizon + config_.observation.stack);
        const bool terminal = episode.back().terminal;
        Episode deque(episode.end() - static_cast<std::ptrdiff_t>(std::min(window, episode.size())),
                      episode.end());
        while (deque.size() > horizon || (terminal && deque.size() > 1)) {
            const std::size_t start = deque.size() > horizon ? deque.size() - 1 - horizon : 0;
            store(deque, start, std::min(start + horizon, deque.size()), deque.size(),
                  terminal ? 0 : std::pow(config_.gamma, horizon));
            if (!terminal) break;
            deque.erase(deque.begin());
        }
    }

    ReplayConfig config_;
    std::vector<Episode> episodes_;
    std::vector<NumberedTransition> transitions_;
};

// Environments in step: nothing is lost but the oldest.
TEST(ReplayBuffer, HoldsTheNewestTransitionsOfTheDefinition) {
    for (std::uint64_t seed = 0; seed < 300; ++seed) {
        SCOPED_TRACE(seed);
        Fuzz fuzz(seed);
        const ReplayConfig config = fuzz.config();
        const bool truncations = fuzz.below(2) == 0;
        const std::int64_t mean_length = 1 + fuzz.below(20);
        ReplayBuffer replay(config);
        NaiveReplay naive(config);
        for (int t = 0; t < 120; ++t) {
            for (std::int64_t env = 0; env < config.num_envs; ++env) {
                const NumberedStep step = fuzz.step(mean_length, truncations);
                add(replay, step, env);
                naive.add(step, env);
            }
            const auto& all = naive.transitions();
            const auto size = static_cast<std::size_t>(replay.size());
            ASSERT_LE(replay.size(), config.capacity);
            ASSERT_EQ(replay.add_count(), static_cast<std::int64_t>(all.size()));
            if (config.replay_terminal == ReplayTerminal::corrected && !truncations) {
                ASSERT_EQ(replay.size(), std::min(config.capacity, replay.add_count()));
            }
            ASSERT_LE(size, all.size());
            if (t % 7 != 0) continue;
            const std::vector<NumberedTransition> newest(all.end() - static_cast<std::ptrdiff_t>(size),
                                                         all.end());
            ASSERT_EQ(read_all(replay), newest);
        }
    }
}

// Environments out of step: what was overwritten is missing, what is there is true.
TEST(ReplayBuffer, NeverShowsAnOverwrittenFrame) {
    for (std::uint64_t seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        Fuzz fuzz(1000 + seed);
        ReplayConfig config = fuzz.config();
        config.num_envs = 3;
        ReplayBuffer replay(config);
        NaiveReplay naive(config);
        for (int t = 0; t < 400; ++t) {
            const std::int64_t env = t / 100 % 2 == 0 ? fuzz.below(3) : 0;  // two pause while one goes on
            const NumberedStep step = fuzz.step(15, true);
            add(replay, step, env);
            naive.add(step, env);
            if (t % 13 != 0) continue;
            auto next = naive.transitions().begin();
            for (const NumberedTransition& found : read_all(replay)) {
                next = std::find(next, naive.transitions().end(), found);
                ASSERT_NE(next, naive.transitions().end()) << found << " is not there, or not in its place";
                ++next;
            }
        }
        EXPECT_GT(replay.size(), 0);
    }
}

TEST(ReplayBuffer, SamplesUniformly) {
    const ReplayBuffer replay = filled(90, 250);  // the ring has wrapped
    std::vector<double> counts(90, 0);
    std::mt19937_64 random(7);
    constexpr int draws = 90'000;
    const Batch batch = replay.sample(draws, random);
    const auto* index = batch.index.const_data_ptr<std::int64_t>();
    for (int i = 0; i < draws; ++i) ++counts.at(static_cast<std::size_t>(index[i]));
    double chi_square = 0;
    for (const double count : counts) chi_square += (count - 1000) * (count - 1000) / 1000;
    EXPECT_LT(chi_square, 146);  // 89 degrees of freedom, p = 1e-4
    EXPECT_GT(chi_square, 47);   // p = 1 - 1e-4
}

TEST(ReplayBuffer, DrawsPositionsAsDocumented) {
    const ReplayBuffer replay = filled(100, 91);
    ASSERT_EQ(replay.size(), 90);
    std::mt19937_64 random(5), same(5);
    const auto found = read(replay.sample(32, random));
    for (const auto& transition : found) {
        const auto position = static_cast<std::int64_t>(same() % 90);
        EXPECT_EQ(transition.action, position + 1);
    }
    EXPECT_EQ(random, same);
}

TEST(ReplayBuffer, TellsTheProbabilityOfAUniformDraw) {
    const ReplayBuffer replay = filled(30, 100);
    std::mt19937_64 random(5);
    EXPECT_THAT(probabilities(replay), testing::Each(1.0f / 30));
    EXPECT_TRUE(replay.sample(4, random).probability.equal(torch::full({4}, 1.0f / 30)));
    EXPECT_THAT(probabilities(filled(30, 8)), testing::Each(1.0f / 7));
}

TEST(ReplayBuffer, IndexNamesAStorageSlotThatStays) {
    ReplayBuffer replay = filled(10, 14);  // holds steps 4 to 13, in slots 3, ..., 9, 0, 1, 2
    const std::vector<std::int64_t> positions{0, 6, 7, 9};
    const Batch batch = replay.gather(positions);
    EXPECT_TRUE(batch.index.equal(torch::tensor({3, 9, 0, 2}, torch::kInt64))) << batch.index;
    EXPECT_TRUE(batch.action.equal(torch::tensor({4, 10, 11, 13}, torch::kInt64))) << batch.action;
    add(replay, {.frame = 15});  // the oldest goes; the second is now the first, where it was
    EXPECT_EQ(replay.gather(std::vector<std::int64_t>{0}).index.item<std::int64_t>(), 4);
}

TEST(ReplayBuffer, FillsTensorsOfTheCaller) {
    const ReplayBuffer replay = filled(50, 60);
    Batch batch = replay.empty_batch(8);
    const void* observation = batch.observation.data_ptr();
    std::mt19937_64 random(3), same(3);
    replay.sample_into(batch, random);
    EXPECT_EQ(batch.observation.data_ptr(), observation);
    EXPECT_EQ(read(batch), read(replay.sample(8, same)));

    batch.next_observation = batch.next_observation.to(torch::kFloat32);
    EXPECT_THAT([&] { replay.sample_into(batch, random); },
                ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr("batch.next_observation"),
                                                           HasSubstr("[8, 3, 1, 4]"), HasSubstr("Float"))));
    batch = replay.empty_batch(8);
    batch.discount = torch::empty({8, 1});
    EXPECT_THROW(replay.sample_into(batch, random), std::invalid_argument);
    batch = replay.empty_batch(8);
    batch.probability = torch::empty({7});
    EXPECT_THAT([&] { replay.sample_into(batch, random); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("batch.probability")));
    batch = {};
    EXPECT_THROW(replay.sample_into(batch, random), std::invalid_argument);
}

TEST(ReplayBuffer, KeepsContinuousActions) {
    ReplayConfig config = numbered_config();
    config.action_size = 3;
    ReplayBuffer replay(config);
    const Pixels frame = pixels_of(1);
    for (int t = 0; t < 3; ++t) {
        const std::array<float, 3> action{0.25f * static_cast<float>(t), -1, 1};
        replay.add(0, {.frame = frame, .action = action});
    }
    const std::vector<std::int64_t> positions{1, 0};
    const Batch batch = replay.gather(positions);
    EXPECT_TRUE(batch.action.equal(torch::tensor({{0.25f, -1.0f, 1.0f}, {0.0f, -1.0f, 1.0f}})))
        << batch.action;
}

TEST(ReplayBuffer, RefusesWhatDoesNotFit) {
    ReplayConfig config = numbered_config();
    config.action_size = 3;
    config.num_envs = 2;
    ReplayBuffer replay(config);
    const Pixels frame = pixels_of(1);
    const std::array<float, 3> action{};
    const auto message_of = [&](std::int64_t env, const Experience& experience) {
        try {
            replay.add(env, experience);
        } catch (const std::logic_error& error) {
            return std::string(error.what());
        }
        return std::string("accepted");
    };
    EXPECT_EQ(message_of(1, {.frame = frame, .action = action}), "accepted");
    EXPECT_THAT(message_of(2, {.frame = frame, .action = action}), HasSubstr("environment 2"));
    EXPECT_THAT(message_of(-1, {.frame = frame, .action = action}), HasSubstr("environment -1"));
    EXPECT_THAT(message_of(0, {.frame = std::span(frame).first(3), .action = action}),
                AllOf(HasSubstr("frame"), HasSubstr("3"), HasSubstr("4")));
    EXPECT_THAT(message_of(0, {.frame = frame}), AllOf(HasSubstr("action"), HasSubstr("0"), HasSubstr("3")));
    EXPECT_THAT(message_of(0, {.frame = frame, .action = action, .truncated = true}),
                HasSubstr("final_frame"));

    std::mt19937_64 random(1);
    EXPECT_THAT([&] { replay.sample(1, random); },
                ThrowsMessage<std::runtime_error>(HasSubstr("no transition")));
    EXPECT_THAT([&] { replay.gather(std::vector<std::int64_t>{0}); },
                ThrowsMessage<std::out_of_range>(HasSubstr("transition 0")));
}

TEST(ReplayBuffer, RefusesAnImpossibleConfiguration) {
    ReplayConfig config;
    config.capacity = 0;
    EXPECT_THAT([&] { ReplayBuffer{config}; }, ThrowsMessage<std::invalid_argument>(AllOf(
                                                   HasSubstr("agent.replay_capacity"), HasSubstr("0"))));
    config = {};
    config.gamma = 1.5;
    EXPECT_THAT([&] { ReplayBuffer{config}; },
                ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr("agent.gamma"), HasSubstr("1.5"))));
}

TEST(ReplayMemory, AMillionTransitionsFitIn7300Megabytes) {
    EXPECT_LE(memory_needed(ReplayConfig{}), 7'300'000'000);
    EXPECT_GE(memory_needed(ReplayConfig{}), 84 * 84 * 1'000'000LL);
}

TEST(ReplayMemory, PrioritiesTakeATreeOfDoubles) {
    ReplayConfig config, prioritised;
    prioritised.prioritised = true;
    EXPECT_EQ(memory_needed(prioritised) - memory_needed(config), 2 * (1 << 20) * 8);
}

TEST(ReplayMemory, TooLittleIsRefusedWithAWayOut) {
    const ReplayConfig config;
    const std::int64_t needed = memory_needed(config);
    EXPECT_NO_THROW(check_memory(config, needed));
    EXPECT_THAT([&] { check_memory(config, needed - 1); },
                ThrowsMessage<std::runtime_error>(
                    AllOf(HasSubstr("7.15 GB"), HasSubstr("agent.replay_capacity"), HasSubstr("1000000"))));

    // The capacity that the sentence offers does fit, and is no waste.
    try {
        check_memory(config, 2'000'000'000);
        FAIL();
    } catch (const std::runtime_error& error) {
        const std::string message = error.what();
        ReplayConfig smaller = config;
        smaller.capacity = std::stoll(message.substr(message.rfind(" to ") + 4));
        EXPECT_NO_THROW(check_memory(smaller, 2'000'000'000)) << message;
        EXPECT_GT(memory_needed(smaller), 1'900'000'000) << message;
    }
    EXPECT_THAT([&] { check_memory(config, 1000); },
                ThrowsMessage<std::runtime_error>(HasSubstr("1e-06 GB")));
}

std::int64_t resident_bytes() {
    std::ifstream file("/proc/self/statm");
    std::int64_t total = 0, resident = 0;
    file >> total >> resident;
    return resident * ::sysconf(_SC_PAGESIZE);
}

TEST(ReplayMemory, IsTakenAsTheBufferFillsAndNoMoreThanNeeded) {
#ifdef __SANITIZE_THREAD__
    GTEST_SKIP() << "ThreadSanitizer keeps four bytes of its own for each byte that is written";
#endif
    ReplayConfig config;
    config.capacity = 20'000;
    const std::int64_t before = resident_bytes();
    ReplayBuffer replay(config);
    EXPECT_LT(resident_bytes() - before, memory_needed(config) / 10);
    const std::vector<std::uint8_t> frame(84 * 84, 1);
    const std::array<float, 3> action{};
    for (int t = 0; t < 30'000; ++t) replay.add(0, {.frame = frame, .action = action});
    const auto taken = static_cast<double>(resident_bytes() - before);
    EXPECT_GT(taken, 0.9 * static_cast<double>(memory_needed(config)));
    EXPECT_LT(taken, 1.1 * static_cast<double>(memory_needed(config)));
    ASSERT_EQ(replay.size(), config.capacity);
}

class AvailableMemory : public testing::Test {
  protected:
    void write(const std::string& path, const std::string& text) const { folder_.write(path, text); }

    const test::TemporaryFolder folder_;
    const std::filesystem::path& root_ = folder_.path();
};

TEST_F(AvailableMemory, IsWhatTheKernelSays) {
    EXPECT_EQ(available_memory(root_), std::numeric_limits<std::int64_t>::max());
    write("proc/meminfo", "MemTotal:  9000 kB\nMemFree:  1 kB\nMemAvailable:    5000 kB\n");
    EXPECT_EQ(available_memory(root_), 5000 * 1024);
    EXPECT_GT(available_memory(), 0);
}

TEST_F(AvailableMemory, IsLimitedByTheAddressSpaceOfTheProcess) {
    write("proc/meminfo", "MemAvailable: 5000 kB\n");
    write("proc/self/status", "Name:\tcale\nVmPeak:\t 3000 kB\nVmSize:\t    2000 kB\n");
    const std::string lines =
        "Limit   Soft Limit  Hard Limit  Units\nMax data size  unlimited  unlimited  bytes\n";
    write("proc/self/limits",
          lines + "Max address space         unlimited            unlimited            bytes\n");
    EXPECT_EQ(available_memory(root_), 5000 * 1024);
    write("proc/self/limits",
          lines + "Max address space         3072000            unlimited            bytes\n");
    EXPECT_EQ(available_memory(root_), 1000 * 1024);
    write("proc/self/limits", lines + "Max address space         1000            1000            bytes\n");
    EXPECT_EQ(available_memory(root_), 0);
}

TEST_F(AvailableMemory, IsLimitedByAGroupOfVersion2OrOneAbove) {
    write("proc/meminfo", "MemAvailable: 5000 kB\n");
    write("proc/self/cgroup", "0::/job/step\n");
    write("sys/fs/cgroup/job/step/memory.max", "max\n");
    write("sys/fs/cgroup/job/step/memory.current", "50000\n");
    EXPECT_EQ(available_memory(root_), 5000 * 1024);
    write("sys/fs/cgroup/job/memory.max", "1000000\n");
    write("sys/fs/cgroup/job/memory.current", "400000\n");
    EXPECT_EQ(available_memory(root_), 600'000);
    write("sys/fs/cgroup/job/memory.stat", "anon 300000\ninactive_file 50000\nactive_file 20000\n");
    EXPECT_EQ(available_memory(root_), 670'000);
}

TEST_F(AvailableMemory, IsLimitedByAGroupOfVersion1) {
    write("proc/meminfo", "MemAvailable: 5000 kB\n");
    write("proc/self/cgroup", "5:cpu:/other\n4:memory:/of/the/host\n0::/\n");
    write("sys/fs/cgroup/memory/memory.limit_in_bytes", "2000000\n");
    write("sys/fs/cgroup/memory/memory.usage_in_bytes", "2500000\n");
    EXPECT_EQ(available_memory(root_), 0);
    write("sys/fs/cgroup/memory/memory.usage_in_bytes", "1500000\n");
    EXPECT_EQ(available_memory(root_), 500'000);
}

}  // namespace
}  // namespace cale
