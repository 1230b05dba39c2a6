#include "policy/observer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>

#include "policy/sample_policies.h"

namespace cale {
namespace {

using ::testing::HasSubstr;

constexpr std::size_t kPixels = std::size_t{210} * 160;

PolicyInfo two_frames(std::int64_t frame_skip = 4) {
    PolicyInfo info;
    info.stack = 2;
    info.frame_skip = frame_skip;
    return info;
}

std::vector<std::uint8_t> gray(std::uint8_t value) {
    return std::vector<std::uint8_t>(kPixels, value);
}

/// The first pixel of each frame of the stack.
std::vector<int> seen(const Observer& observer) {
    const auto observation = observer.observation();
    return {observation[0], observation[kFrameSize]};
}

TEST(ObserverTest, ADecisionIsDueAtTheStartAndAfterEveryStep) {
    Observer observer(two_frames());
    observer.start(gray(10));
    EXPECT_TRUE(observer.due());
    EXPECT_EQ(seen(observer), (std::vector{0, 10}));
    for (const int value : {90, 80, 70}) {
        observer.see(gray(static_cast<std::uint8_t>(value)));
        EXPECT_FALSE(observer.due());
    }
    observer.see(gray(60));
    EXPECT_TRUE(observer.due());
    EXPECT_EQ(seen(observer), (std::vector{10, 70})) << "the brighter of the last two screens";
    for (const int value : {0, 0, 20, 30}) observer.see(gray(static_cast<std::uint8_t>(value)));
    EXPECT_EQ(seen(observer), (std::vector{70, 30}));
    observer.start(gray(5));
    EXPECT_EQ(seen(observer), (std::vector{0, 5}));
}

TEST(ObserverTest, EveryFrameCountsWithoutFrameSkip) {
    Observer observer(two_frames(1));
    observer.start(gray(1));
    observer.see(gray(50));
    EXPECT_TRUE(observer.due());
    observer.see(gray(40));
    EXPECT_EQ(seen(observer), (std::vector{50, 40}));
}

TEST(ObserverTest, ALostLifeStartsTheStackAnewWhereThatEndsAnEpisode) {
    auto info = two_frames();
    for (const bool ends : {false, true}) {
        info.life_loss_ends_episode = ends;
        Observer observer(info);
        observer.start(gray(10));
        for (int i = 0; i < 4; ++i) observer.see(gray(20));
        for (int i = 0; i < 3; ++i) observer.see(gray(30));
        observer.lose_life();
        EXPECT_EQ(observer.due(), ends);
        // The screen of the step before is still the second.
        EXPECT_EQ(seen(observer), (ends ? std::vector{0, 30} : std::vector{10, 20}));
    }
}

TEST(ObserverTest, ColourIsSeenAsItsLuminance) {
    EXPECT_EQ(luminance(0, 0, 0), 0);
    EXPECT_EQ(luminance(255, 255, 255), 255);
    EXPECT_EQ(luminance(255, 0, 0), 76);
    EXPECT_EQ(luminance(0, 36, 12), 22) << "22.5, or a little less in ALE's arithmetic";
    Observer in_colour(two_frames()), in_gray(two_frames());
    const auto rgb = test::random_pixels(3 * kPixels, 1);
    std::vector<std::uint8_t> luminances;
    for (std::size_t i = 0; i < rgb.size(); i += 3)
        luminances.push_back(luminance(rgb[i], rgb[i + 1], rgb[i + 2]));
    in_colour.start(rgb);
    in_gray.start(luminances);
    EXPECT_TRUE(std::ranges::equal(in_colour.observation(), in_gray.observation()));
}

TEST(ObserverTest, MemoryIsSeenAsItIsAfterEveryStep) {
    auto info = two_frames(2);
    info.frame_height = 1;
    info.frame_width = 3;
    info.life_loss_ends_episode = true;
    Observer observer(info);
    EXPECT_TRUE(observer.reads_memory());
    const auto observation = [&] {
        return std::vector<int>(observer.observation().begin(), observer.observation().end());
    };
    using Bytes = std::vector<std::uint8_t>;
    observer.start(Bytes{1, 2, 3});
    EXPECT_EQ(observation(), (std::vector{0, 0, 0, 1, 2, 3}));
    observer.see(Bytes{9, 9, 9});
    EXPECT_FALSE(observer.due());
    observer.see(Bytes{4, 5, 6});
    EXPECT_TRUE(observer.due());
    EXPECT_EQ(observation(), (std::vector{1, 2, 3, 4, 5, 6}));
    observer.see(Bytes{7, 8, 9});
    observer.lose_life();
    EXPECT_EQ(observation(), (std::vector{0, 0, 0, 7, 8, 9}));
    EXPECT_THAT(test::message_of([&] { observer.see(Bytes(4)); }),
                HasSubstr("reads the console's memory: give it 3 bytes, not 4"));
    EXPECT_FALSE(Observer(two_frames()).reads_memory());
}

TEST(ObserverTest, RefusesOtherSizes) {
    Observer observer(two_frames());
    EXPECT_THAT(test::message_of([&] { observer.start(std::vector<std::uint8_t>(100)); }),
                HasSubstr("a screen has 100 bytes: it must have 33600 (gray) or 100800 (RGB)"));
    EXPECT_THAT(test::message_of([&] { observer.see(std::vector<std::uint8_t>(100)); }),
                HasSubstr("100 bytes"));
    EXPECT_THROW(Observer(two_frames(), 50), std::invalid_argument);
    auto small = two_frames();
    small.frame_width = 12;
    EXPECT_THAT(test::message_of([&] { Observer observer_of_small(small); }), HasSubstr("frames of 84x12"));
}

}  // namespace
}  // namespace cale
