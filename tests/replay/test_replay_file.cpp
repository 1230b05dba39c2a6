// Saving, loading, and every way in which a file can be bad.
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "numbered_frames.h"
#include "replay/replay_file.h"

namespace cale {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

class ReplayFile : public testing::Test {
  protected:
    void SetUp() override { fs::create_directories(folder_); }
    void TearDown() override { fs::remove_all(folder_); }

    std::string path(const std::string& name) const { return folder_ / name; }
    static std::string bytes(const std::string& file) {
        std::ifstream in(file, std::ios::binary);
        return {std::istreambuf_iterator<char>(in), {}};
    }
    static void write(const std::string& file, const std::string& content) {
        std::ofstream(file, std::ios::binary) << content;
    }
    std::string saved(const ReplayBuffer& replay) const {
        replay.save(path("scratch"));
        return bytes(path("scratch"));
    }

    fs::path folder_ = fs::temp_directory_path() / ("cale_replay_" + std::to_string(::getpid()));
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

void expect_goes_on_alike(const ReplayConfig& config, int steps, const std::string& path,
                          const std::function<std::string(const ReplayBuffer&)>& saved) {
    ReplayBuffer replay(config), loaded(config);
    play(replay, 0, steps);
    play(loaded, 0, 9);  // is to be forgotten
    if (config.prioritised) give(replay, {0, 3, 7, 11}, {0.25, 4, 0, 1.0 / 3});
    if (config.prioritised) give(loaded, {0, 1, 2, 3}, {100, 100, 100, 100});
    replay.save(path);
    loaded.load(path);
    EXPECT_FALSE(fs::exists(path + ".tmp"));

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
                expect_goes_on_alike(config, steps, path("replay"),
                                     [this](const ReplayBuffer& replay) { return saved(replay); });
            }
}

// A file with a good checksum: one transition, as DamagedReplayFile makes it below, and then
// the largest priority and that of each of the 12 slots.
TEST_F(ReplayFile, RefusesPrioritiesThatCannotBe) {
    ReplayConfig config = small_config();
    config.prioritised = true;
    const auto refusal = [&](double largest, double of_the_transition, double of_an_empty_slot) {
        ReplayFileWriter file(path("made"), "CALE-RPL", 2);
        const std::vector<double> entries{12, 2, 3, 1, 4, 0, 3, 0.5, 0, 1};
        const std::vector<std::int64_t> contents{1, 0, 1, 0, 0, -1, -1, 0, -1, -1, 0, 0, 0};
        std::vector<double> priorities(13, 0);
        priorities[0] = largest;
        priorities[1] = of_the_transition;
        priorities[12] = of_an_empty_slot;
        file.write(entries.data(), entries.size() * sizeof(double));
        file.write(contents.data(), contents.size() * sizeof(std::int64_t));
        file.write("abcd", 4);
        file.write(priorities.data(), priorities.size() * sizeof(double));
        file.commit();
        ReplayBuffer replay(config);
        try {
            replay.load(path("made"));
        } catch (const std::runtime_error& error) {
            return std::string(error.what());
        }
        EXPECT_EQ(probabilities(replay), std::vector<float>{1});
        return std::string("accepted");
    };
    constexpr double infinity = std::numeric_limits<double>::infinity();
    constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(refusal(3, 2, 0), "accepted");
    EXPECT_THAT(refusal(3, 4, 0), AllOf(HasSubstr(path("made")), HasSubstr("priorities")));
    EXPECT_THAT(refusal(3, -1, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(3, not_a_number, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(3, 2, 1), HasSubstr("priorities"));
    EXPECT_THAT(refusal(0.5, 0.5, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(infinity, 2, 0), HasSubstr("priorities"));
    EXPECT_THAT(refusal(not_a_number, 2, 0), HasSubstr("priorities"));
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
    replay.save(path("replay"));
    loaded.load(path("replay"));
    const std::vector<std::int64_t> positions{0, 1, 2, 3};
    EXPECT_TRUE(loaded.gather(positions).action.equal(replay.gather(positions).action));
}

class DamagedReplayFile : public ReplayFile {
  protected:
    void SetUp() override {
        ReplayFile::SetUp();
        ReplayBuffer replay(small_config());
        play(replay, 0, 60);
        replay.save(path("good"));
        good_ = bytes(path("good"));
        keep();
        before_ = read_all(kept_);
    }

    void keep() {
        kept_ = ReplayBuffer(small_config());
        play(kept_, 0, 9);
    }

    // The sentence with which this file is refused; the buffer must not have changed.
    std::string refusal(const std::string& content) {
        write(path("bad"), content);
        try {
            kept_.load(path("bad"));
        } catch (const std::runtime_error& error) {
            EXPECT_EQ(read_all(kept_), before_);
            EXPECT_THAT(error.what(), HasSubstr(path("bad")));
            return error.what();
        }
        return "accepted";
    }

    std::string good_;
    ReplayBuffer kept_{small_config()};
    std::vector<NumberedTransition> before_;
};

TEST_F(DamagedReplayFile, IsRefusedWhereverItIsCut) {
    for (std::size_t size = 0; size < good_.size(); ++size)
        ASSERT_THAT(refusal(good_.substr(0, size)), HasSubstr("it is truncated")) << size;
}

// A few bits of zstd's own tables mean nothing: then nothing but the right content may come out.
TEST_F(DamagedReplayFile, IsRefusedWhicheverBitIsFlipped) {
    std::size_t flips = 0, accepted = 0;
    for (std::size_t bit = 0; bit < 8 * good_.size(); bit += bit < 400 ? 1 : 11, ++flips) {
        std::string bad = good_;
        bad[bit / 8] = static_cast<char>(bad[bit / 8] ^ (1 << bit % 8));
        if (refusal(bad) != "accepted") continue;
        ++accepted;
        ASSERT_EQ(saved(kept_), good_) << bit;
        keep();
    }
    EXPECT_LT(accepted, flips / 20);
}

TEST_F(DamagedReplayFile, IsRefusedWithMoreBehindIt) {
    EXPECT_THAT(refusal(good_ + "x"), HasSubstr("more"));
    EXPECT_THAT(refusal(good_ + good_), HasSubstr("more"));
}

TEST_F(DamagedReplayFile, IsRefusedWhenItIsSomethingElse) {
    EXPECT_THAT(refusal("a letter to a friend"), HasSubstr("not a replay file"));
    std::string newer = good_;
    newer[8] = 77;
    EXPECT_THAT(refusal(newer), AllOf(HasSubstr("version 77"), HasSubstr("version 2")));
    EXPECT_THAT([&] { kept_.load(path("absent")); },
                ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("absent"), HasSubstr("No such file"))));
    EXPECT_THROW(kept_.load(folder_), std::runtime_error);
}

TEST_F(DamagedReplayFile, IsRefusedUnderAnotherConfiguration) {
    const auto refused = [&](auto change, const std::string& key, const std::string& there,
                             const std::string& here) {
        ReplayConfig config = small_config();
        change(config);
        ReplayBuffer other(config);
        EXPECT_THAT([&] { other.load(path("good")); },
                    ThrowsMessage<std::runtime_error>(AllOf(
                        HasSubstr(path("good")), HasSubstr(key + " = " + there), HasSubstr("has " + here))));
    };
    refused([](auto& c) { c.capacity = 13; }, "agent.replay_capacity", "12", "13");
    refused([](auto& c) { c.num_envs = 1; }, "env.num_envs", "2", "1");
    refused([](auto& c) { c.stack = 4; }, "stack", "3", "4");
    refused([](auto& c) { c.frame_height = 2; }, "frame_height", "1", "2");
    refused([](auto& c) { c.frame_width = 5; }, "frame_width", "4", "5");
    refused([](auto& c) { c.action_size = 3; }, "action_size", "0", "3");
    refused([](auto& c) { c.update_horizon = 1; }, "agent.update_horizon", "3", "1");
    refused([](auto& c) { c.gamma = 0.25; }, "agent.gamma", "0.5", "0.25");
    refused([](auto& c) { c.replay_terminal = ReplayTerminal::dopamine; }, "agent.replay_terminal",
            "corrected", "dopamine");
    refused([](auto& c) { c.prioritised = true; }, "agent.prioritised", "false", "true");
}

// Files with a good checksum and absurd content: nothing is allocated for what they claim.
TEST_F(DamagedReplayFile, IsRefusedWhenItsContentIsAbsurd) {
    struct Content {
        std::int64_t frames_end = 0, transitions_begin = 0, transitions_end = 0;
        std::vector<std::int64_t> rest;
    };
    const auto made = [&](const Content& content) {
        ReplayFileWriter file(path("made"), "CALE-RPL", 2);
        const std::vector<double> config{12, 2, 3, 1, 4, 0, 3, 0.5, 0, 0};
        file.write(config.data(), config.size() * sizeof(double));
        file.write(&content.frames_end, 3 * sizeof(std::int64_t));
        file.write(content.rest.data(), content.rest.size() * sizeof(std::int64_t));
        file.commit();
        return bytes(path("made"));
    };
    constexpr std::int64_t huge = std::int64_t{1} << 62;
    EXPECT_EQ(refusal(made({0, 0, 0, {0, 0}})), "accepted");  // an empty replay: the layout above is right
    keep();
    EXPECT_THAT(refusal(made({-1, 0, 0, {0, 0}})), HasSubstr("counters"));
    EXPECT_THAT(refusal(made({0, 0, huge, {0, 0}})), HasSubstr("counters"));
    EXPECT_THAT(refusal(made({0, -huge, huge, {0, 0}})), HasSubstr("counters"));
    EXPECT_THAT(refusal(made({0, 5, 4, {0, 0}})), HasSubstr("counters"));
    EXPECT_THAT(refusal(made({0, 0, 0, {huge, 0}})), HasSubstr("window"));
    EXPECT_THAT(refusal(made({0, 0, 0, {-1, 0}})), HasSubstr("window"));
    EXPECT_THAT(refusal(made({0, 0, 0, {1, 0, 0, 0}})), HasSubstr("frame"));  // frame 0 of none
    // One transition, return and discount 0, and one frame of 4 bytes after its action.
    const auto with_frame = [&](std::int64_t newest, std::int64_t other) {
        std::string content = made({1, 0, 1, {0, 0, -1, other, newest, -1, -1, 0, 0, 0}});
        ReplayFileWriter file(path("made"), "CALE-RPL", 2);
        const std::vector<double> config{12, 2, 3, 1, 4, 0, 3, 0.5, 0, 0};
        file.write(config.data(), config.size() * sizeof(double));
        const std::vector<std::int64_t> rest{1, 0, 1, 0, 0, -1, other, newest, -1, -1, 0, 0, 0};
        file.write(rest.data(), rest.size() * sizeof(std::int64_t));
        file.write("abcd", 4);
        file.commit();
        return bytes(path("made"));
    };
    EXPECT_EQ(refusal(with_frame(0, 0)), "accepted");
    keep();
    EXPECT_THAT(refusal(with_frame(1, 0)), HasSubstr("frame"));
    EXPECT_THAT(refusal(with_frame(0, huge)), HasSubstr("frame"));
    EXPECT_THAT(refusal(with_frame(0, -2)), HasSubstr("frame"));
    EXPECT_THAT(refusal(with_frame(-1, 0)), HasSubstr("frame"));
}

TEST_F(DamagedReplayFile, StaysTheOldOneWhenSavingFails) {
    EXPECT_THAT([&] { kept_.save(path("no/such/folder/replay")); },
                ThrowsMessage<std::runtime_error>(HasSubstr(path("no/such/folder/replay"))));
    {
        ReplayFileWriter interrupted(path("good"), "CALE-RPL", 2);
        interrupted.write("abc", 3);
    }
    EXPECT_EQ(bytes(path("good")), good_);
    EXPECT_FALSE(fs::exists(path("good.tmp")));
    if (fs::exists("/dev/full")) {
        fs::create_symlink("/dev/full", path("full.tmp"));
        EXPECT_THAT([&] { kept_.save(path("full")); },
                    ThrowsMessage<std::runtime_error>(HasSubstr("No space")));
        EXPECT_FALSE(fs::exists(path("full")));
    }
}

}  // namespace
}  // namespace cale
