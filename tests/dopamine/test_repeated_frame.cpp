// The frame that the reference's PPO sees twice.
#include "dopamine/repeated_frame.h"

#include <array>
#include <vector>

#include <gtest/gtest.h>
#include <torch/types.h>

namespace cale {
namespace {

/// What is seen of frames of one pixel when `newest` is the newest: the last four.
std::vector<int> seen(RepeatedFrame& repeated, int newest) {
    const auto stack = torch::arange(newest - 3, newest + 1).to(torch::kUInt8).view({1, 4, 1, 1});
    const auto shown = repeated.next(stack).flatten().to(torch::kInt32);
    return {shown.data_ptr<int>(), shown.data_ptr<int>() + 4};
}

void step(RepeatedFrame& repeated, int frame, bool terminal = false) {
    const std::array<std::uint8_t, 1> pixel{static_cast<std::uint8_t>(frame)};
    StepResult result;
    result.terminal = terminal;
    repeated.remember(pixel, result);
}

using Frames = std::vector<int>;

TEST(RepeatedFrame, StaysUntilFourNewerOnesCame) {
    RepeatedFrame repeated;
    EXPECT_EQ(seen(repeated, 9), (Frames{6, 7, 8, 9})) << "before the first update";
    step(repeated, 9);
    repeated.push();
    EXPECT_EQ(seen(repeated, 10), (Frames{8, 9, 10, 9}));
    step(repeated, 10);
    EXPECT_EQ(seen(repeated, 11), (Frames{9, 10, 9, 11}));
    step(repeated, 11);
    EXPECT_EQ(seen(repeated, 12), (Frames{10, 9, 11, 12}));
    step(repeated, 12);
    EXPECT_EQ(seen(repeated, 13), (Frames{9, 11, 12, 13}));
    step(repeated, 13);
    EXPECT_EQ(seen(repeated, 14), (Frames{11, 12, 13, 14}));
}

TEST(RepeatedFrame, ANewEpisodeForgetsIt) {
    RepeatedFrame repeated;
    step(repeated, 9);
    repeated.push();
    EXPECT_EQ(seen(repeated, 10), (Frames{8, 9, 10, 9}));
    step(repeated, 10, /*terminal=*/true);
    EXPECT_EQ(seen(repeated, 11), (Frames{8, 9, 10, 11}));
}

TEST(RepeatedFrame, AnEpisodeThatIsCutOffForgetsItToo) {
    RepeatedFrame repeated;
    step(repeated, 9);
    repeated.push();
    const std::array<std::uint8_t, 1> pixel{10};
    repeated.remember(pixel, {.truncated = true});
    EXPECT_EQ(seen(repeated, 11), (Frames{8, 9, 10, 11}));
}

TEST(RepeatedFrame, RefusesAStateOfAnotherKindAndStaysAsItIs) {
    RepeatedFrame repeated;
    step(repeated, 9);
    repeated.push();
    const auto good = repeated.state();
    for (const auto& [name, bad] : {std::pair("previous", torch::zeros({4}, torch::kFloat32)),
                                    {"repeated", torch::zeros({7}, torch::kUInt8)},
                                    {"newer", torch::zeros({2}, torch::kInt64)}}) {
        auto state = good;
        state.at(name) = bad;
        EXPECT_THROW(repeated.restore(state), std::runtime_error) << name;
        state.erase(name);
        EXPECT_THROW(repeated.restore(state), std::runtime_error) << "without " << name;
    }
    EXPECT_EQ(seen(repeated, 10), (Frames{8, 9, 10, 9}));
}

TEST(RepeatedFrame, AnUpdateAtTheStartOfAnEpisodeRepeatsTheFrameBeforeTheOneThatItEndedOn) {
    RepeatedFrame repeated;
    step(repeated, 9);
    step(repeated, 10);
    step(repeated, 11, /*terminal=*/true);
    repeated.push();
    EXPECT_EQ(seen(repeated, 30), (Frames{28, 29, 30, 10}));
}

}  // namespace
}  // namespace cale
