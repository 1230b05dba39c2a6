#include "replay/random_shift.h"

#include <set>
#include <utility>

#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

namespace cale {
namespace {

torch::Tensor frames(std::int64_t batch, std::int64_t stack, std::int64_t height, std::int64_t width) {
    return torch::randint(0, 256, {batch, stack, height, width}, at::detail::createCPUGenerator(3),
                          torch::kUInt8);
}

TEST(RandomShift, MovesPixelsAndRepeatsTheBorder) {
    const auto image = torch::arange(12, torch::kUInt8).view({1, 1, 3, 4});
    const auto moved = shifted(image, torch::tensor({{1, -2}}));
    // Pixel (i, j) is pixel (i + 1, j - 2) of the image, the nearest one where there is none.
    const auto expected = torch::tensor({{4, 4, 4, 5}, {8, 8, 8, 9}, {8, 8, 8, 9}}).to(torch::kUInt8);
    EXPECT_TRUE(torch::equal(moved[0][0], expected));
    EXPECT_TRUE(torch::equal(shifted(image, torch::zeros({1, 2}, torch::kInt64)), image));
}

// DrQ: padding by replication, then a crop of the old size at a random place.
TEST(RandomShift, IsAPaddingByReplicationAndACrop) {
    constexpr std::int64_t kPad = 3;
    const auto images = frames(6, 2, 9, 7);
    const auto padded =
        torch::replication_pad2d(images.to(torch::kFloat32), {kPad, kPad, kPad, kPad}).to(torch::kUInt8);
    const auto shifts = torch::tensor({{-3, 3}, {0, 1}, {2, 2}, {3, -3}, {-1, 0}, {0, 0}});
    const auto moved = shifted(images, shifts);
    for (std::int64_t i = 0; i < 6; ++i) {
        const auto row = kPad + shifts[i][0].item<std::int64_t>(),
                   column = kPad + shifts[i][1].item<std::int64_t>();
        EXPECT_TRUE(torch::equal(moved[i], padded[i].slice(1, row, row + 9).slice(2, column, column + 7)))
            << i;
    }
    EXPECT_TRUE(torch::equal(shifted_by_index(images, shifts), moved)) << "as on a GPU";
}

TEST(RandomShift, EveryShiftComesAndEachObservationHasItsOwn) {
    constexpr std::int64_t kPad = 1, kCount = 500;
    // A gradient along both axes, so that an image shows its shift.
    const auto image = (16 * torch::arange(5).unsqueeze(1) + torch::arange(5)).to(torch::kUInt8);
    const auto images = image.view({1, 1, 5, 5}).repeat({kCount, 2, 1, 1});
    const auto moved = random_shift(images, kPad, at::detail::createCPUGenerator(7));
    std::set<std::pair<int, int>> seen;
    for (std::int64_t i = 0; i < kCount; ++i) {
        EXPECT_TRUE(torch::equal(moved[i][0], moved[i][1]));  // the frames of an observation move together
        const int centre = moved[i][0][2][2].item<int>();
        seen.emplace(centre / 16, centre % 16);
    }
    EXPECT_EQ(seen.size(), 9U);
    EXPECT_EQ(seen.begin()->first, 1);
    EXPECT_EQ(seen.rbegin()->second, 3);
    EXPECT_TRUE(torch::equal(random_shift(images, 0, at::detail::createCPUGenerator(7)), images));
}

TEST(RandomShift, ImagesOnly) {
    const auto random = at::detail::createCPUGenerator(1);
    EXPECT_THROW(random_shift(torch::zeros({2, 4, 128}, torch::kUInt8), 1, random), std::invalid_argument);
    EXPECT_THROW(random_shift(torch::zeros({2, 4, 8, 8}), 1, random), std::invalid_argument);
    EXPECT_THROW(random_shift(frames(2, 4, 8, 8), -1, random), std::invalid_argument);
}

TEST(RandomShift, EveryObservationNeedsItsShift) {
    const auto images = frames(2, 4, 8, 8);
    EXPECT_THROW(shifted(images, torch::zeros({1, 2}, torch::kInt64)), std::invalid_argument);
    EXPECT_THROW(shifted(images, torch::zeros({2, 1}, torch::kInt64)), std::invalid_argument);
    EXPECT_THROW(shifted(images, torch::zeros({2, 2})), std::invalid_argument);
}

}  // namespace
}  // namespace cale
