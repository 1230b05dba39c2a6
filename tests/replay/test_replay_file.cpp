// Saving, loading, and every way in which a file can be bad.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "numbered_frames.h"
#include "replay/replay_file.h"
#include "replay/replay_snapshot.h"
#include "support/temporary_folder.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

using Files = std::map<std::string, std::string>;  // name -> content

class ReplayFile : public testing::Test {
  protected:
    fs::path path(const std::string& name) const { return folder_ / name; }
    static Files files(const fs::path& folder) {
        Files files;
        for (const auto& entry : fs::directory_iterator(folder)) {
            std::ifstream in(entry.path(), std::ios::binary);
            files[entry.path().filename()] = {std::istreambuf_iterator<char>(in), {}};
        }
        return files;
    }
    static void write(const fs::path& file, const std::string& content) {
        std::ofstream(file, std::ios::binary) << content;
    }
    static fs::path emptied(const fs::path& folder) {
        fs::remove_all(folder);
        fs::create_directory(folder);
        return folder;
    }
    Files saved(ReplayBuffer& replay) const {
        save_replay(replay, emptied(path("scratch")));
        return files(path("scratch"));
    }

    const test::TemporaryFolder temporary_;
    const fs::path& folder_ = temporary_.path();
};

ReplayConfig small_config() {
    ReplayConfig config = numbered_config();
    config.capacity = 12;
    config.num_envs = 2;
    config.update_horizon = 3;
    return config;
}

// Goes on from step `begin`: both environments, terminals, truncations, both rings wrap.
void play(ReplayBuffer& replay, int begin, int end) {
    for (int t = begin; t < end; ++t)
        for (int env = 0; env < 2; ++env) {
            const auto number = static_cast<std::uint32_t>(1 + 4 * t + 2 * env);
            NumberedStep step{.frame = number, .reward = static_cast<float>(t % 5), .action = t};
            step.terminal = (t + 3 * env) % 7 == 6;
            step.truncated = (t + 3 * env) % 11 == 10;
            if (step.truncated) step.final_frame = number + 1;
            add(replay, step, env);
        }
}

void expect_goes_on_alike(const ReplayConfig& config, int steps, const fs::path& folder,
                          const std::function<Files(ReplayBuffer&)>& saved) {
    ReplayBuffer replay(config), loaded(config);
    play(replay, 0, steps);
    play(loaded, 0, 9);  // is to be forgotten
    if (config.prioritised) give(replay, {0, 3, 7, 11}, {0.25, 4, 0, 1.0 / 3});
    if (config.prioritised) give(loaded, {0, 1, 2, 3}, {100, 100, 100, 100});
    save_replay(replay, folder);
    load_replay(loaded, folder);

    EXPECT_EQ(loaded.size(), replay.size());
    EXPECT_EQ(loaded.add_count(), replay.add_count());
    for (const int later : {steps, steps + 1, steps + 8, steps + 40}) {
        if (later > steps) {
            play(replay, steps, later);
            play(loaded, steps, later);
        }
        ASSERT_EQ(read_all(loaded), read_all(replay));
        ASSERT_EQ(probabilities(loaded), probabilities(replay));
        ASSERT_EQ(saved(loaded), saved(replay));
        if (replay.size() == 0) continue;
        std::mt19937_64 random(11), same(11);
        const Batch expected = replay.sample(16, random), found = loaded.sample(16, same);
        EXPECT_EQ(read(found), read(expected));
        EXPECT_TRUE(found.index.equal(expected.index));
        EXPECT_TRUE(found.probability.equal(expected.probability));
    }
}

TEST_F(ReplayFile, LoadsWhatWasSavedAndGoesOnAlike) {
    for (const bool prioritised : {false, true})
        for (const auto rule : {ReplayTerminal::corrected, ReplayTerminal::dopamine})
            for (const int steps : {0, 1, 5, 16, 60}) {
                SCOPED_TRACE(steps);
                ReplayConfig config = small_config();
                config.replay_terminal = rule;
                config.prioritised = prioritised;
                expect_goes_on_alike(config, steps, emptied(path("replay")),
                                     [this](ReplayBuffer& replay) { return saved(replay); });
            }
}

TEST_F(ReplayFile, KeepsContinuousActions) {
    ReplayConfig config = numbered_config();
    config.action_size = 2;
    ReplayBuffer replay(config), loaded(config);
    const Pixels frame = pixels_of(1);
    for (int t = 0; t < 5; ++t) {
        const std::array<float, 2> action{static_cast<float>(t), 0.5f};
        replay.add(0, {.frame = frame, .action = action});
    }
    save_replay(replay, folder_);
    load_replay(loaded, folder_);
    const std::vector<std::int64_t> positions{0, 1, 2, 3};
    EXPECT_TRUE(loaded.gather(positions).action.equal(replay.gather(positions).action));
}

// Files with a good checksum, of a replay that holds one transition.
struct MadeReplay {
    std::int64_t frames_end = 1, transitions_begin = 0, transitions_end = 1;
    std::vector<std::int64_t> windows{0, 0};  // of two environments
    std::vector<double> priorities{};         // the largest, and of each of the 12 slots
    std::int64_t newest_frame = 0, other_frame = 0;
    std::int64_t first_frame = 0, last_frame = 0;  // in the frames' file

    void write(const fs::path& folder) const {
        {
            ReplayFileWriter file(folder / "replay.zst", "CALE-RPL", 3);
            const std::vector<double> config{12, 2, 3,   1, 4,
                                             0,  3, 0.5, 0, static_cast<double>(!priorities.empty())};
            file.write(config.data(), config.size() * sizeof(double));
            file.write(&frames_end, 3 * sizeof(std::int64_t));
            file.write(windows.data(), windows.size() * sizeof(std::int64_t));
            file.write(priorities.data(), priorities.size() * sizeof(double));
            file.commit();
        }
        {
            ReplayFileWriter file(folder / "transitions-open.zst", "CALE-TRN", 3);
            // Numbers [0, 1); the stacks; return and discount 0.
            const std::vector<std::int64_t> content{0, 1, -1, other_frame, newest_frame, -1, -1, 0, 0};
            file.write(content.data(), content.size() * sizeof(std::int64_t));
            file.commit();
        }
        {
            ReplayFileWriter file(folder / "frames-open.zst", "CALE-FRM", 3);
            const std::vector<std::int64_t> content{first_frame, last_frame + 1, 7};
            file.write(content.data(), content.size() * sizeof(std::int64_t));
            file.write("abcd", 4);
            file.commit();
        }
    }
};

TEST_F(ReplayFile, RefusesPrioritiesThatCannotBe) {
    ReplayConfig config = small_config();
    config.prioritised = true;
    const auto refusal = [&](double largest, double of_the_transition, double of_an_empty_slot) {
        MadeReplay made;
        made.priorities.assign(13, 0);
        made.priorities[0] = largest;
        made.priorities[1] = of_the_transition;
        made.priorities[12] = of_an_empty_slot;
        made.write(folder_);
        ReplayBuffer replay(config);
        try {
            load_replay(replay, folder_);
        } catch (const std::runtime_error& error) {
            return std::string(error.what());
        }
        EXPECT_EQ(probabilities(replay), std::vector<float>{1});
        return std::string("accepted");
    };
    constexpr double infinity = std::numeric_limits<double>::infinity();
    constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(refusal(3, 2, 0), "accepted");
    EXPECT_THAT(refusal(3, 4, 0), AllOf(HasSubstr(path("replay.zst")), HasSubstr("priorities")));
    EXPECT_THAT(refusal(3, -1, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(3, not_a_number, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(3, 2, 1), HasSubstr("priorities"));
    EXPECT_THAT(refusal(0.5, 0.5, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(infinity, 2, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(not_a_number, 2, 0), HasSubstr("priorities"));
}

class DamagedReplayFile : public ReplayFile {
  protected:
    void SetUp() override {
        ReplayFile::SetUp();
        ReplayBuffer replay(small_config());
        play(replay, 0, 60);
        save_replay(replay, emptied(path("good")));
        good_ = files(path("good"));
        keep();
        before_ = read_all(kept_);
    }

    void keep() {
        kept_ = ReplayBuffer(small_config());
        play(kept_, 0, 9);
    }

    // The sentence with which what is in the folder is refused; the buffer must not have changed.
    std::string refusal() {
        try {
            load_replay(kept_, path("good"));
        } catch (const std::runtime_error& error) {
            EXPECT_EQ(read_all(kept_), before_);
            EXPECT_THAT(error.what(), HasSubstr(path("good")));
            return error.what();
        }
        return "accepted";
    }
    // The same where this file has another content.
    std::string refusal(const std::string& file, const std::string& content) {
        write(path("good") / file, content);
        const auto sentence = refusal();
        write(path("good") / file, good_.at(file));
        return sentence;
    }

    Files good_;
    ReplayBuffer kept_{small_config()};
    std::vector<NumberedTransition> before_;
};

TEST_F(DamagedReplayFile, IsRefusedWhereverItIsCut) {
    ASSERT_GE(good_.size(), 10u);
    for (const auto& [name, content] : good_)
        for (std::size_t size = 0; size < content.size(); ++size)
            ASSERT_THAT(refusal(name, content.substr(0, size)),
                        AllOf(HasSubstr(name), HasSubstr("it is truncated")))
                << size;
}

// A few bits of zstd's own tables mean nothing: then nothing but the right content may come out.
TEST_F(DamagedReplayFile, IsRefusedWhicheverBitIsFlipped) {
    std::size_t flips = 0, accepted = 0;
    for (const auto& [name, content] : good_) {
        for (std::size_t bit = 0; bit < 8 * content.size(); bit += 13, ++flips) {
            std::string bad = content;
            bad[bit / 8] = static_cast<char>(bad[bit / 8] ^ (1 << bit % 8));
            if (refusal(name, bad) != "accepted") continue;
            ++accepted;
            ASSERT_EQ(saved(kept_), good_) << name << ' ' << bit;
            keep();
        }
    }
    EXPECT_LT(accepted, flips / 20);
}

TEST_F(DamagedReplayFile, IsRefusedWithoutOneOfItsFilesAndWithOnesThatAreExchanged) {
    for (const auto& [name, content] : good_) {
        fs::remove(path("good") / name);
        EXPECT_THAT(refusal(), AllOf(HasSubstr(name), HasSubstr("No such file")));
        write(path("good") / name, content);
    }
    const auto frames =
        std::ranges::find_if(good_, [](const auto& file) { return file.first.starts_with("frames"); });
    EXPECT_THAT(refusal(frames->first, std::next(frames)->second), HasSubstr("other frames"));
}

TEST_F(DamagedReplayFile, IsRefusedWithMoreBehindIt) {
    for (const auto& [name, content] : good_) {
        EXPECT_THAT(refusal(name, content + "x"), HasSubstr("more"));
        EXPECT_THAT(refusal(name, content + content), HasSubstr("more"));
    }
}

TEST_F(DamagedReplayFile, IsRefusedWhenItIsSomethingElse) {
    EXPECT_THAT(refusal("replay.zst", "a letter to a friend"), HasSubstr("not a replay file"));
    std::string newer = good_.at("replay.zst");
    newer[8] = 77;
    EXPECT_THAT(refusal("replay.zst", newer), AllOf(HasSubstr("version 77"), HasSubstr("version 3")));
    EXPECT_THAT([&] { load_replay(kept_, path("absent")); },
                ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("absent"), HasSubstr("No such file"))));
    fs::create_directories(path("folders") / "replay.zst");
    EXPECT_THROW(load_replay(kept_, path("folders")), std::runtime_error);
}

TEST_F(DamagedReplayFile, IsRefusedUnderAnotherConfiguration) {
    const auto refused = [&](auto change, const std::string& key, const std::string& there,
                             const std::string& here) {
        ReplayConfig config = small_config();
        change(config);
        ReplayBuffer other(config);
        EXPECT_THAT([&] { load_replay(other, path("good")); },
                    ThrowsMessage<std::runtime_error>(AllOf(
                        HasSubstr(path("good")), HasSubstr(key + " = " + there), HasSubstr("has " + here))));
    };
    refused([](auto& c) { c.capacity = 13; }, "agent.replay_capacity", "12", "13");
    refused([](auto& c) { c.num_envs = 1; }, "env.num_envs", "2", "1");
    refused([](auto& c) { c.observation.stack = 4; }, "stack", "3", "4");
    refused([](auto& c) { c.observation.shape[0] = 2; }, "frame_height", "1", "2");
    refused([](auto& c) { c.observation.shape[1] = 5; }, "frame_width", "4", "5");
    refused([](auto& c) { c.action_size = 3; }, "action_size", "0", "3");
    refused([](auto& c) { c.update_horizon = 1; }, "agent.update_horizon", "3", "1");
    refused([](auto& c) { c.gamma = 0.25; }, "agent.gamma", "0.5", "0.25");
    refused([](auto& c) { c.replay_terminal = ReplayTerminal::dopamine; }, "agent.replay_terminal",
            "corrected", "dopamine");
    refused([](auto& c) { c.prioritised = true; }, "agent.prioritised", "false", "true");
}

// Nothing is allocated for what a file claims.
TEST_F(DamagedReplayFile, IsRefusedWhenItsContentIsAbsurd) {
    const auto made = [&](auto change) {
        MadeReplay content;
        change(content);
        content.write(emptied(path("good")));
        return refusal();
    };
    constexpr std::int64_t huge = std::int64_t{1} << 62;
    EXPECT_EQ(made([](auto&) {}), "accepted");
    keep();
    EXPECT_THAT(made([](auto& c) { c.frames_end = -1; }), HasSubstr("counters"));
    EXPECT_THAT(made([](auto& c) { c.frames_end = huge; }), HasSubstr("counters"));
    EXPECT_THAT(made([](auto& c) { c.transitions_end = huge; }), HasSubstr("counters"));
    EXPECT_THAT(made([](auto& c) { c.transitions_begin = -huge; }), HasSubstr("counters"));
    EXPECT_THAT(made([](auto& c) { c.transitions_begin = 2; }), HasSubstr("counters"));
    EXPECT_THAT(made([](auto& c) { c.windows = {huge, 0}; }), HasSubstr("window"));
    EXPECT_THAT(made([](auto& c) { c.windows = {-1, 0}; }), HasSubstr("window"));
    EXPECT_THAT(made([](auto& c) { c.windows = {1, 1, 0, 0}; }), HasSubstr("window"));  // frame 1 of one
    EXPECT_THAT(made([](auto& c) { c.newest_frame = 1; }), HasSubstr("frame"));
    EXPECT_THAT(made([](auto& c) { c.newest_frame = -1; }), HasSubstr("frame"));
    EXPECT_THAT(made([](auto& c) { c.other_frame = huge; }), HasSubstr("frame"));
    EXPECT_THAT(made([](auto& c) { c.other_frame = -2; }), HasSubstr("frame"));
    EXPECT_THAT(made([](auto& c) { c.first_frame = -huge; }), HasSubstr("other frames"));
    EXPECT_THAT(made([](auto& c) { c.last_frame = 1; }), HasSubstr("other frames"));
}

TEST_F(DamagedReplayFile, StaysTheOldOneWhenSavingFails) {
    EXPECT_THAT([&] { save_replay(kept_, path("no/such/folder")); },
                ThrowsMessage<std::runtime_error>(HasSubstr(path("no/such/folder"))));
    {
        ReplayFileWriter interrupted(path("good") / "replay.zst", "CALE-RPL", 3);
        interrupted.write("abc", 3);
    }
    EXPECT_EQ(files(path("good")), good_) << "and no temporary file";
    if (fs::exists("/dev/full")) {
        emptied(path("full"));
        fs::create_symlink("/dev/full", path("full/replay.zst.tmp"));
        EXPECT_THAT([&] { save_replay(kept_, path("full")); },
                    ThrowsMessage<std::runtime_error>(HasSubstr("No space")));
        EXPECT_FALSE(fs::exists(path("full/replay.zst")));
    }
}

}  // namespace
}  // namespace cale
