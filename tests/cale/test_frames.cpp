#include <algorithm>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "cale/emulator.h"
#include "cale/env.h"
#include "cale/frames.h"
#include "message_of.h"
#include "reference_frames.h"
#include "support/golden.h"

namespace {

using cale::FramePipeline;
using cale::FrameStack;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;

using Bytes = std::vector<std::uint8_t>;

// All heights that the sixty games have.
constexpr int kHeights[] = {210, 214, 220, 230, 250};

std::array<std::uint8_t, 256> gray_palette(std::uint64_t seed) {
    std::array<std::uint8_t, 256> gray{};
    for (std::size_t i = 1; i < gray.size(); ++i) gray[i] = static_cast<std::uint8_t>(golden::bits(seed, i));
    return gray;
}

// Noise, or blocks of few colours as games have them, over the image before.
void scribble(Bytes& screen, std::uint64_t seed) {
    const auto random = [seed](std::uint64_t i) { return golden::bits(seed, i); };
    if (random(0) % 4 == 0) {
        for (std::size_t i = 0; i < screen.size(); ++i) screen[i] = static_cast<std::uint8_t>(random(i + 1));
        return;
    }
    const std::size_t height = screen.size() / cale::kScreenWidth;
    for (std::uint64_t block = 0; block < 12; ++block) {
        const auto edge = [&](std::uint64_t i, std::size_t size) {
            return random(8 * block + i) % (size + 1);
        };
        const auto [top, bottom] = std::minmax({edge(1, height), edge(2, height)});
        const auto [left, right] = std::minmax({edge(3, cale::kScreenWidth), edge(4, cale::kScreenWidth)});
        for (std::size_t row = top; row < bottom; ++row) {
            const auto begin = screen.begin() + static_cast<std::ptrdiff_t>(row * cale::kScreenWidth);
            std::fill(begin + static_cast<std::ptrdiff_t>(left), begin + static_cast<std::ptrdiff_t>(right),
                      static_cast<std::uint8_t>(random(8 * block + 5)));
        }
    }
}

TEST(Frames, AreOpenCVsOnAnyScreens) {
    for (const int height : kHeights) {
        const auto gray = gray_palette(static_cast<std::uint64_t>(height));
        FramePipeline frames(height, gray);
        ReferenceFrames reference(height, gray);
        Bytes screen(static_cast<std::size_t>(height) * cale::kScreenWidth);
        Bytes frame(cale::kFrameSize);
        for (std::uint64_t i = 0; i < 300; ++i) {
            scribble(screen, 1000 * i + static_cast<std::uint64_t>(height));
            // Every order in which a step may end, early ends and new games included.
            switch (golden::bits(7, i) % 6) {
                case 0:
                    frames.start(screen);
                    reference.start(screen);
                    break;
                case 1:
                    break;
                case 2:
                    frames.set_first(screen);
                    reference.set_first(screen);
                    break;
                default:
                    frames.set_first(screen);
                    reference.set_first(screen);
                    scribble(screen, 1000 * i + 500);
                    frames.set_second(screen);
                    reference.set_second(screen);
            }
            frames.write(frame);
            ASSERT_EQ(frame, reference.observe()) << height << " rows, image " << i;
        }
    }
}

TEST(Frames, CellsShareOutEveryPixel) {
    for (const int source : {84, 100, 160, 168, 210, 250}) {
        const auto cells = cale::area_cells(source, 84);
        ASSERT_EQ(cells.size(), 84u);
        std::vector<float> shares(static_cast<std::size_t>(source));
        for (const auto& cell : cells) {
            EXPECT_NEAR(std::accumulate(cell.weights.begin(), cell.weights.end(), 0.0f), 1, 1e-6);
            for (std::size_t i = 0; i < cell.weights.size(); ++i) {
                shares.at(static_cast<std::size_t>(cell.first) + i) += cell.weights[i];
            }
        }
        for (const float share : shares) EXPECT_NEAR(share, 84.0f / static_cast<float>(source), 1e-6);
    }
}

TEST(Frames, WrongSizesAreRefused) {
    auto gray = gray_palette(1);
    FramePipeline frames(210, gray);
    Bytes screen(210 * 160);
    Bytes frame(cale::kFrameSize - 1);
    EXPECT_THAT(message_of<std::invalid_argument>([&] { frames.write(frame); }), HasSubstr("7055 bytes"));
    screen.pop_back();
    EXPECT_THAT(message_of<std::invalid_argument>([&] { frames.set_first(screen); }),
                HasSubstr("33599 bytes"));
    EXPECT_THROW(FramePipeline(83, gray), std::invalid_argument);
    EXPECT_THROW(FramePipeline(1025, gray), std::invalid_argument);
    gray[0] = 1;
    EXPECT_THROW(FramePipeline(210, gray), std::invalid_argument);
}

TEST(FrameStack, KeepsTheNewestLast) {
    FrameStack stack(2, 3, 2);
    stack.push(1, Bytes{1, 2});
    stack.push(1, Bytes{3, 4});
    EXPECT_THAT(stack.data(), ElementsAre(0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4));
    stack.push(0, Bytes{9, 9});
    stack.push(1, Bytes{5, 6});
    stack.push(1, Bytes{7, 8});
    EXPECT_THAT(stack.data(), ElementsAre(0, 0, 0, 0, 9, 9, 3, 4, 5, 6, 7, 8));
    stack.clear(1);
    EXPECT_THAT(stack.data(), ElementsAre(0, 0, 0, 0, 9, 9, 0, 0, 0, 0, 0, 0));
}

TEST(FrameStack, IsClearedBehindATerminalAndBehindATruncation) {
    for (const bool terminal : {false, true}) {
        for (const bool truncated : {false, true}) {
            FrameStack stack(1, 3, 1);
            stack.push(0, Bytes{1});
            stack.push(0, Bytes{2});
            stack.follow(0, {.terminal = terminal, .truncated = truncated}, Bytes{9});
            if (terminal || truncated)
                EXPECT_THAT(stack.data(), ElementsAre(0, 0, 9));
            else
                EXPECT_THAT(stack.data(), ElementsAre(1, 2, 9));
        }
    }
}

TEST(FrameStack, RefusesWhatDoesNotFit) {
    FrameStack stack(2, 4);
    EXPECT_EQ(stack.data().size(), 2 * 4 * cale::kFrameSize);
    EXPECT_THAT(stack.data(), Each(0));
    EXPECT_THROW(stack.push(2, Bytes(cale::kFrameSize)), std::out_of_range);
    EXPECT_THROW(stack.clear(2), std::out_of_range);
    EXPECT_THROW(stack.push(0, Bytes(cale::kFrameSize + 1)), std::invalid_argument);
    EXPECT_THROW(FrameStack(0, 4), std::invalid_argument);
}

}  // namespace
