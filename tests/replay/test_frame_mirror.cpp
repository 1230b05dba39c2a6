// A replay whose frames are on a device too, against one that has them on the host only. Here the device is
// the CPU: what it does there, a GPU does.
#include <gtest/gtest.h>

#include <filesystem>

#include <torch/types.h>

#include "numbered_frames.h"
#include "replay/replay_snapshot.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

void expect_same(const Batch& found, const Batch& expected) {
    for (const auto part : {&Batch::observation, &Batch::action, &Batch::n_step_return, &Batch::discount,
                            &Batch::next_observation, &Batch::index, &Batch::probability})
        EXPECT_TRUE(torch::equal(found.*part, expected.*part));
}

/// The same draw from both.
void expect_same_samples(const ReplayBuffer& found, const ReplayBuffer& expected, std::uint64_t seed) {
    std::mt19937_64 first(seed), second(seed);
    expect_same(found.sample(5, first), expected.sample(5, second));
    EXPECT_EQ(first, second);
}

TEST(FrameMirror, FuzzedReplaysAreSampledAlike) {
    for (std::uint64_t trial = 0; trial < 60; ++trial) {
        Fuzz fuzz(trial);
        auto config = fuzz.config();
        config.prioritised = fuzz.below(2) == 0;
        ReplayBuffer plain(config), mirrored(config, torch::kCPU);
        auto batch = mirrored.empty_batch(5);
        // Long enough for rings of up to 40 transitions to come round more than once between two samples.
        for (std::uint64_t round = 0; round < 12; ++round) {
            const auto steps = fuzz.below(round == 6 ? 300 : 30);
            for (std::int64_t i = 0; i < steps; ++i) {
                const auto env = fuzz.below(config.num_envs);
                const auto step = fuzz.step(10, config.replay_terminal == ReplayTerminal::corrected);
                add(plain, step, env);
                add(mirrored, step, env);
            }
            if (plain.size() == 0) continue;
            expect_same(gather_all(mirrored), gather_all(plain));
            expect_same_samples(mirrored, plain, trial);
            std::mt19937_64 first(round), second(round);
            mirrored.sample_into(batch, first);
            expect_same(batch, plain.sample(5, second));
        }
    }
}

TEST(FrameMirror, FollowsALoadedReplay) {
    const test::TemporaryFolder folder;
    auto other = filled(20, 55);
    save_replay(other, folder.path());
    ReplayConfig config = numbered_config();
    config.capacity = 20;
    ReplayBuffer mirrored(config, torch::kCPU);
    for (std::uint32_t frame = 1000; frame < 1060; ++frame) add(mirrored, {.frame = frame});
    gather_all(mirrored);
    load_replay(mirrored, folder.path());
    expect_same(gather_all(mirrored), gather_all(other));
    add(mirrored, {.frame = 56});
    add(other, {.frame = 56});
    expect_same_samples(mirrored, other, 1);
}

}  // namespace
}  // namespace cale
