// A replay that is written by one thread while another goes on filling it.
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "numbered_frames.h"
#include "replay/replay_snapshot.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::Not;

ReplayConfig config_of(std::int64_t capacity, bool prioritised = false) {
    ReplayConfig config = numbered_config();
    config.capacity = capacity;
    config.update_horizon = 2;
    config.prioritised = prioritised;
    return config;
}

void play(ReplayBuffer& replay, std::uint32_t begin, std::uint32_t end) {
    for (std::uint32_t t = begin; t < end; ++t)
        add(replay,
            {.frame = t + 1, .reward = static_cast<float>(t % 3), .terminal = t % 7 == 6, .action = t});
}

fs::path made(const fs::path& folder) {
    fs::create_directories(folder);
    return folder;
}

TEST(ReplaySnapshot, IsOfTheMomentItWasTakenAt) {
    const test::TemporaryFolder folder;
    for (const bool prioritised : {false, true}) {
        const auto config = config_of(64, prioritised);
        ReplayBuffer replay(config), loaded(config);
        play(replay, 0, 100);  // both rings are full: the next frame overwrites the oldest
        const auto before = read_all(replay);
        const auto before_probabilities = probabilities(replay);

        ReplaySnapshot snapshot(replay);
        std::jthread training([&] { play(replay, 100, 400); });
        snapshot.save(made(folder.path() / "saved"));
        training.join();

        load_replay(loaded, folder.path() / "saved");
        EXPECT_EQ(read_all(loaded), before);
        EXPECT_EQ(probabilities(loaded), before_probabilities);
        play(loaded, 100, 400);
        EXPECT_EQ(read_all(loaded), read_all(replay)) << "the wait changes nothing";
    }
}

TEST(ReplaySnapshot, LetsGoOfTheReplayWhenItIsDropped) {
    ReplayBuffer replay(config_of(20));
    play(replay, 0, 50);
    {
        const ReplaySnapshot snapshot(replay);
        EXPECT_THROW(ReplaySnapshot{replay}, std::logic_error);
        EXPECT_THROW(load_replay(replay, "anywhere"), std::logic_error);
    }
    play(replay, 50, 60);
    const test::TemporaryFolder folder;
    EXPECT_THROW(save_replay(replay, folder.path() / "absent"), std::runtime_error);
    play(replay, 60, 100);
    EXPECT_NO_THROW(save_replay(replay, folder.path()));
}

TEST(ReplaySnapshot, LetsGoOfTheReplayWhenItIsWritten) {
    const test::TemporaryFolder folder;
    ReplayBuffer replay(config_of(20));
    play(replay, 0, 50);
    {
        std::optional<ReplaySnapshot> written(replay);
        written->save(folder.path());
        const ReplaySnapshot next(replay);
        written.reset();
        EXPECT_THROW(ReplaySnapshot{replay}, std::logic_error) << "the next one's hold is its own";
    }
    ReplaySnapshot last(replay);
    last.save(folder.path());
    const auto before = read_all(replay);
    load_replay(replay, folder.path());
    EXPECT_EQ(read_all(replay), before);
}

TEST(ReplaySnapshot, LetsGoOfTheReplayOnceItIsReadAlsoWhereItsLastFileFails) {
    const test::TemporaryFolder folder;
    fs::create_directories(folder.path() / "replay.zst/in the way");
    ReplayBuffer replay(config_of(20));
    play(replay, 0, 50);
    std::optional<ReplaySnapshot> failed(replay);
    EXPECT_THROW(failed->save(folder.path()), std::runtime_error);
    const ReplaySnapshot next(replay);
    failed.reset();
    EXPECT_THROW(ReplaySnapshot{replay}, std::logic_error) << "the next one's hold is its own";
}

TEST(ReplaySnapshot, DoesNotWriteFullChunksAgain) {
    const test::TemporaryFolder folder;
    const auto config = config_of(64);
    ReplayBuffer replay(config), loaded(config);
    play(replay, 0, 70);
    const auto first = made(folder.path() / "first");
    save_replay(replay, first);

    // After a few steps, and after so many that the oldest chunk has lost some of its frames.
    std::uint32_t steps = 70;
    for (const std::uint32_t more : {3, 7, 20}) {
        play(replay, steps, steps + more);
        steps += more;
        const auto second = made(folder.path() / ("after " + std::to_string(more)));
        std::vector<std::string> taken, refused;
        ReplaySnapshot(replay).save(second, [&](const std::string& file) {
            if (!fs::exists(first / file)) {
                refused.push_back(file);
                return false;
            }
            fs::copy_file(first / file, second / file);
            taken.push_back(file);
            return true;
        });
        EXPECT_GE(taken.size(), 10u);
        EXPECT_LE(refused.size(), 2 + (steps - 70) / 2) << "chunks of four frames, and of four transitions";
        EXPECT_THAT(taken, Not(Contains("replay.zst")));
        load_replay(loaded, second);
        EXPECT_EQ(read_all(loaded), read_all(replay));
    }
}

}  // namespace
}  // namespace cale
