// Checkpoints on the disk: what they share, how a bad one is told, and what is left when the disk refuses.
#include "train/checkpoint.h"

#include <array>
#include <filesystem>
#include <new>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/fsuid.h>
#include <sys/stat.h>
#include <torch/types.h>
#include <nlohmann/json.hpp>

#include "replay/replay_buffer.h"
#include "storage/files.h"
#include "storage/step_name.h"
#include "support/full_disk.h"
#include "support/temporary_folder.h"
#include "train/agent_file.h"
#include "train/checkpoint_writer.h"
#include "train/safetensors.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

/// Remembers its steps; does nothing else.
class Rememberer : public Agent {
  public:
    torch::Tensor act(const torch::Tensor&, ActMode) override { return {}; }
    void observe(const StepBatch&) override {}
    bool update(const torch::Tensor&) override { return false; }
    std::map<std::string, double> metrics() override { return {}; }
    TensorMap state() override { return {{"steps", torch::tensor(steps)}}; }
    void load_state(const TensorMap& state) override {
        if (memory_is_full) throw std::bad_alloc();
        steps = state.at("steps").item<std::int64_t>();
    }
    ReplayBuffer* replay() override { return &replay_; }

    void step() {
        const std::array<std::uint8_t, 4> frame{1, 2, 3, static_cast<std::uint8_t>(steps)};
        replay_.add(0, {.frame = frame, .discrete_action = steps, .reward = 1});
        ++steps;
    }
    std::int64_t newest_action() const {
        const std::vector<std::int64_t> newest{replay_.size() - 1};
        return replay_.gather(newest).action.item<std::int64_t>();
    }

    std::int64_t steps = 0;
    bool memory_is_full = false;

  private:
    ReplayBuffer replay_{{.capacity = 64, .observation = {4, {2, 2}}, .action_size = 0}};
};

class Checkpoints : public testing::Test {
  protected:
    RunSnapshot snapshot() {
        RunSnapshot snapshot{.state = {.step = agent.steps, .recent_returns = {1, 2}},
                             .agent = agent.state(),
                             .games = {{"frames", torch::arange(10)}},
                             .config = "env: {game: pong}\n"};
        snapshot.replay.emplace(*agent.replay());
        return snapshot;
    }
    /// Steps on to `step`, and writes a checkpoint there.
    fs::path write_at(std::int64_t step) {
        while (agent.steps < step) agent.step();
        writer.start(snapshot());
        writer.finish();
        return list_checkpoints(run).back();
    }
    void write_by(CheckpointWriter& by, std::int64_t step, std::optional<Score> score = std::nullopt) {
        while (agent.steps < step) agent.step();
        auto taken = snapshot();
        taken.state.score = score;
        by.start(std::move(taken));
        by.finish();
    }
    std::vector<std::int64_t> steps_left() const {
        std::vector<std::int64_t> steps;
        for (const auto& folder : list_checkpoints(run)) steps.push_back(step_in(folder).value_or(-1));
        return steps;
    }
    Checkpoint load() {
        return load_newest_checkpoint(run, agent, [&](const TensorMap& games) {
            if (games_are_bad) throw std::runtime_error("these games cannot be");
            EXPECT_EQ(games.at("frames").numel(), 10);
        });
    }
    static std::string damage(const fs::path& file) {
        auto bytes = read_file(file);
        auto bad = bytes;
        bad[bad.size() / 2] = static_cast<char>(bad[bad.size() / 2] ^ 4);
        fs::remove(file);  // another file may have another name for it
        write_file_atomically(file, bad);
        return bytes;
    }
    static ino_t inode(const fs::path& file) {
        struct stat status {};
        EXPECT_EQ(::stat(file.c_str(), &status), 0);
        return status.st_ino;
    }

    test::TemporaryFolder run_folder;
    fs::path run = run_folder.path();
    Rememberer agent;
    Retention retention{.newest = 3};
    CheckpointWriter writer{run, retention, std::nullopt};
    bool games_are_bad = false;
};

TEST_F(Checkpoints, BringBackWhatWasWritten) {
    write_at(100);
    for (int i = 0; i < 30; ++i) agent.step();
    const auto checkpoint = load();
    EXPECT_EQ(checkpoint.state.step, 100);
    EXPECT_EQ(checkpoint.state.recent_returns, (std::vector<double>{1, 2}));
    EXPECT_EQ(agent.steps, 100);
    EXPECT_EQ(agent.newest_action(), 98);  // what follows the last step is not known
    EXPECT_TRUE(checkpoint.passed_over.empty());
}

TEST_F(Checkpoints, FullChunksAreWrittenTwiceAndThenShared) {
    const auto first = write_at(100), second = write_at(110), third = write_at(120);
    const auto chunk = "frames-000020.zst";  // of four frames: 80 to 83
    EXPECT_NE(inode(first / chunk), inode(second / chunk)) << "one damaged file must cost one checkpoint";
    EXPECT_NE(inode(second / chunk), inode(third / chunk));
    EXPECT_EQ(inode(first / chunk), inode(third / chunk));
    EXPECT_NE(inode(first / "replay.zst"), inode(third / "replay.zst"));
    EXPECT_EQ(load().state.step, 120);
    EXPECT_EQ(agent.newest_action(), 118);
}

TEST_F(Checkpoints, WhateverFileIsDamagedTheOneBeforeIsTaken) {
    write_at(100);
    const auto newest = write_at(110);
    std::vector<std::string> files;
    for (const auto& entry : fs::directory_iterator(newest)) files.push_back(entry.path().filename());
    EXPECT_GE(files.size(), 30u);
    for (const auto& file : files) {
        const auto good = damage(newest / file);
        const auto checkpoint = load();
        ASSERT_EQ(checkpoint.state.step, 100) << file;
        EXPECT_EQ(agent.newest_action(), 98);
        EXPECT_THAT(checkpoint.passed_over,
                    testing::ElementsAre(AllOf(HasSubstr(newest.string()), HasSubstr(file))));
        fs::resize_file(newest / file, good.size() / 2);
        ASSERT_EQ(load().state.step, 100) << file;
        fs::remove(newest / file);
        ASSERT_EQ(load().state.step, 100) << file;
        write_file_atomically(newest / file, good);
    }
    EXPECT_EQ(load().state.step, 110);
}

TEST_F(Checkpoints, ADamagedOneThatWasPassedOverCountsForNothing) {
    retention = {.newest = 2};
    CheckpointWriter begun{run, retention, std::nullopt};
    write_by(begun, 100);
    write_by(begun, 110);
    damage(run / "checkpoints/step_000000110/games.safetensors");
    EXPECT_EQ(newest_whole_checkpoint(run).value().folder.filename(), "step_000000100");

    const auto checkpoint = load();
    set_aside_damaged(run, checkpoint.stored.folder);
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{100}));
    EXPECT_TRUE(fs::exists(run / "checkpoints/step_000000110.damaged/games.safetensors")) << "for now";
    CheckpointWriter resumed{run, retention, checkpoint.stored};
    write_by(resumed, 120);
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{100, 120})) << "it takes nobody's place";
    EXPECT_FALSE(fs::exists(run / "checkpoints/step_000000110.damaged"));

    for (const auto& folder : list_checkpoints(run)) damage(folder / "games.safetensors");
    EXPECT_FALSE(newest_whole_checkpoint(run));
}

TEST_F(Checkpoints, ADamagedChunkIsNotCarriedOn) {
    const auto first = write_at(100), second = write_at(110);
    damage(first / "frames-000020.zst");
    damage(second / "frames-000021.zst");
    damage(first / "frames-000022.zst");
    damage(second / "frames-000022.zst");
    write_at(120);
    EXPECT_EQ(load().state.step, 120);
    EXPECT_TRUE(load().passed_over.empty());
}

TEST_F(Checkpoints, GamesThatCannotBePlayedAgainAreNoGoodEither) {
    write_at(100);
    games_are_bad = true;
    EXPECT_THAT([&] { load(); }, ThrowsMessage<ResumeError>(HasSubstr("these games cannot be")));
}

TEST_F(Checkpoints, TheNewestIsNotPassedOverForLackOfMemory) {
    write_at(100);
    write_at(110);
    agent.memory_is_full = true;
    EXPECT_THAT([&] { load(); },
                ThrowsMessage<UnreadableNow>(
                    AllOf(HasSubstr("step_000000110 cannot be read now"), HasSubstr("not enough memory"))));
    agent.memory_is_full = false;
    EXPECT_EQ(load().state.step, 110);
}

TEST_F(Checkpoints, TheNewestIsNotPassedOverWhereItDoesNotFit) {
    write_at(100);
    const auto newest = write_at(110);
    games_are_bad = true;
    EXPECT_THAT([&] { load(); },
                ThrowsMessage<ResumeError>(AllOf(HasSubstr("step_000000110 is not damaged, but does not fit"),
                                                 HasSubstr("these games cannot be"))));
    games_are_bad = false;
    write_file_atomically(newest / "manifest.json", R"({"format_version": 6, "files": {}})");
    EXPECT_THAT([&] { load(); },
                ThrowsMessage<ResumeError>(AllOf(HasSubstr("step_000000110 is not damaged"),
                                                 HasSubstr("version 6, this program reads version 5"))));
}

TEST_F(Checkpoints, OfAnOlderFormatAreNamedAsSuch) {
    const auto folder = write_at(100);
    fs::remove(folder / "manifest.json");
    EXPECT_THAT([&] { load(); }, ThrowsMessage<ResumeError>(HasSubstr("written by an older cale")));
    write_file_atomically(folder / "manifest.json", R"({"format_version": 6, "files": {}})");
    EXPECT_THAT([&] { load(); },
                ThrowsMessage<ResumeError>(HasSubstr("version 6, this program reads version 5")));
    for (const auto* manifest :
         {"", "[]", R"({"format_version": 5, "files": {"../x": {"bytes": 1, "crc32c": "00"}}})",
          R"({"format_version": 5, "files": {"a": {"bytes": -1, "crc32c": "0g"}}})"}) {
        write_file_atomically(folder / "manifest.json", manifest);
        EXPECT_THAT([&] { load(); }, ThrowsMessage<ResumeError>(HasSubstr("manifest.json is damaged")))
            << manifest;
    }
    write_file_atomically(folder / "manifest.json", R"({"format_version": 5, "files": {}})");
    EXPECT_THAT([&] { load(); },
                ThrowsMessage<ResumeError>(HasSubstr("its manifest.json lacks agent.safetensors.zst")));
}

TEST_F(Checkpoints, OnlyTheNewestStay) {
    for (const int step : {10, 20, 30}) write_at(step);
    const auto checkpoints = run / "checkpoints";
    fs::create_directories(checkpoints / "step_000000035.partial");  // of a killed run
    fs::create_directories(checkpoints / "step_000000900");          // of another end that this run came to
    fs::create_directories(checkpoints / "step_000000030_good");     // a copy of the user's
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{10, 20, 30, 900}));
    while (agent.steps < 40) agent.step();
    writer.start(snapshot());
    writer.finish();
    std::vector<std::string> left;
    for (const auto& folder : fs::directory_iterator(checkpoints)) left.push_back(folder.path().filename());
    EXPECT_THAT(left, testing::UnorderedElementsAre("step_000000020", "step_000000030", "step_000000030_good",
                                                    "step_000000040"));
}

TEST_F(Checkpoints, AtMultiplesStayForGood) {
    retention = {.newest = 2, .every = 100, .step_size = 4};
    CheckpointWriter begun{run, retention, std::nullopt};
    for (const int step : {0, 60, 100, 160, 204, 240, 300, 308}) write_by(begun, step);
    // Four environments make four steps at once, so that 204 is not the first one at or after 200.
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{100, 300, 308}));
    // What stays does not depend on which process writes.
    CheckpointWriter resumed{run, retention, load().stored};
    for (const int step : {360, 400, 460, 520}) write_by(resumed, step);
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{100, 300, 400, 460, 520}));
    EXPECT_EQ(load().state.step, 520);
}

TEST_F(Checkpoints, TheBestStays) {
    retention = {.newest = 2, .best = true};
    CheckpointWriter begun{run, retention, std::nullopt};
    const auto best = run / "checkpoints" / "best";
    write_by(begun, 0);
    EXPECT_FALSE(fs::is_symlink(best)) << "nothing is known of it";
    write_by(begun, 10, Score{.mean_return = 5});
    EXPECT_EQ(fs::read_symlink(best), "step_000000010");
    write_by(begun, 20, Score{.mean_return = 7});
    write_by(begun, 30, Score{.mean_return = 7});
    write_by(begun, 40);  // at a signal
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{20, 30, 40}));
    EXPECT_EQ(fs::read_symlink(best), "step_000000020") << "of equal ones the first";

    CheckpointWriter resumed{run, retention, load().stored};
    write_by(resumed, 50, Score{.mean_return = 6});
    write_by(resumed, 60, Score{.mean_return = -1});
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{20, 50, 60})) << "as if one process had written all";
    write_by(resumed, 70, Score{.evaluated = true, .mean_return = 1});
    write_by(resumed, 80, Score{.mean_return = 100});
    write_by(resumed, 90, Score{.mean_return = 100});
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{70, 80, 90})) << "evaluations decide";
    EXPECT_EQ(fs::read_symlink(best), "step_000000070");

    CheckpointWriter without{run, {.newest = 2}, load().stored};
    write_by(without, 100);
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{90, 100}));
    EXPECT_FALSE(fs::is_symlink(best));
}

TEST_F(Checkpoints, ADamagedScoreCountsForNothing) {
    retention = {.newest = 1, .best = true};
    CheckpointWriter begun{run, retention, std::nullopt};
    write_by(begun, 10, Score{.mean_return = 9});
    damage(run / "checkpoints" / "step_000000010" / "state.json");
    write_by(begun, 20, Score{.mean_return = 1});
    EXPECT_EQ(steps_left(), (std::vector<std::int64_t>{20}));
    EXPECT_EQ(fs::read_symlink(run / "checkpoints" / "best"), "step_000000020");
}

TEST_F(Checkpoints, TakeThePlaceOfOneOfTheSameStep) {
    write_at(100);
    const auto folder = write_at(110);
    damage(folder / "state.json");
    EXPECT_EQ(load().state.step, 100);
    write_at(110);
    EXPECT_EQ(load().state.step, 110);
    EXPECT_EQ(list_checkpoints(run).size(), 2u);
}

TEST_F(Checkpoints, ShareNoFileWithTheOneBeforeAlsoWhereThatWasWrittenTwice) {
    write_at(100);
    const auto twice = write_at(110);
    write_at(110);
    const auto next = write_at(120);
    for (const auto& entry : fs::directory_iterator(twice)) {
        const auto other = next / entry.path().filename();
        EXPECT_TRUE(!fs::exists(other) || inode(entry.path()) != inode(other)) << other;
    }
}

TEST_F(Checkpoints, AFullDiskIsReportedAndLeavesTheOthersAsTheyAre) {
    write_at(100);
    while (agent.steps < 110) agent.step();
    writer.start(snapshot());
    writer.finish();
    for (int i = 0; i < 10; ++i) agent.step();
    {
        const test::FullDisk full(64);
        writer.start(snapshot());
        EXPECT_THAT([&] { writer.finish(); }, ThrowsMessage<std::runtime_error>(AllOf(
                                                  HasSubstr("step_000000120"), HasSubstr("File too large"))));
    }
    EXPECT_EQ(list_checkpoints(run).size(), 2u);
    EXPECT_EQ(load().state.step, 110);
    EXPECT_NO_THROW(write_at(130)) << "there is room again";
}

/// While it lives nothing can be added to the folder, by root neither: files are touched with nobody's
/// rights.
class ReadOnly {
  public:
    explicit ReadOnly(fs::path folder) : folder_(std::move(folder)) {
        ::chmod(folder_.c_str(), 0555);  // while its owner still may
        before_ = ::setfsuid(65534);
    }
    ~ReadOnly() {
        ::setfsuid(static_cast<uid_t>(before_));
        ::chmod(folder_.c_str(), 0755);
    }
    ReadOnly(const ReadOnly&) = delete;
    ReadOnly& operator=(const ReadOnly&) = delete;

  private:
    fs::path folder_;
    int before_ = 0;
};

TEST_F(Checkpoints, AReadOnlyFolderIsReportedAndTheOthersStay) {
    write_at(100);
    ::chmod(run.c_str(), 0755);  // so that nobody can look into it
    for (int i = 0; i < 10; ++i) agent.step();
    {
        const ReadOnly checkpoints(run / "checkpoints");
        writer.start(snapshot());
        EXPECT_THAT([&] { writer.finish(); },
                    ThrowsMessage<std::runtime_error>(
                        AllOf(HasSubstr("step_000000110"), HasSubstr("Permission denied"))));
    }
    EXPECT_EQ(load().state.step, 100);
    EXPECT_NO_THROW(write_at(120)) << "the folder can be written again";
}

TEST_F(Checkpoints, ADeletedFolderIsReported) {
    write_at(100);
    fs::remove_all(run / "checkpoints");
    EXPECT_EQ(write_at(110).filename(), "step_000000110") << "that of the checkpoints is made again";
    EXPECT_EQ(load().state.step, 110);
    fs::remove_all(run);
    writer.start(snapshot());
    EXPECT_THAT([&] { writer.finish(); },
                ThrowsMessage<std::runtime_error>(AllOf(HasSubstr(run.string()), HasSubstr("is gone"))));
    EXPECT_FALSE(fs::exists(run));
}

}  // namespace
}  // namespace cale
