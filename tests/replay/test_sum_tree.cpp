// The sum tree against a cumulative sum from left to right.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "replay/sum_tree.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

std::int64_t naive_find(const std::vector<double>& values, double target) {
    double sum = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
        sum += values[i];
        if (target < sum) return static_cast<std::int64_t>(i);
    }
    return -1;
}

double sum_before(const std::vector<double>& values, std::int64_t index) {
    return std::accumulate(values.begin(), values.begin() + index, 0.0);
}

// Whole numbers: every sum is exact, so the answers are the same.
TEST(SumTree, IsACumulativeSum) {
    std::mt19937_64 random(1);
    for (std::int64_t capacity = 1; capacity <= 70; ++capacity) {
        SCOPED_TRACE(capacity);
        SumTree tree(capacity);
        std::vector<double> values(static_cast<std::size_t>(capacity), 0);
        for (int round = 0; round < 10; ++round) {
            for (int change = 0; change < 15; ++change) {
                const std::size_t index = random() % values.size();
                values[index] = std::max(static_cast<double>(random() % 12) - 4, 0.0);
                tree.set(static_cast<std::int64_t>(index), values[index]);
            }
            for (std::size_t i = 0; i < values.size(); ++i)
                ASSERT_EQ(tree.get(static_cast<std::int64_t>(i)), values[i]);
            ASSERT_EQ(tree.total(), sum_before(values, capacity));
            for (double target = 0; target < tree.total(); target += 0.5)
                ASSERT_EQ(tree.find(target), naive_find(values, target)) << target;
        }
    }
}

// Any numbers, many of them 0: up to rounding, but never a 0.
TEST(SumTree, NeverFindsAZero) {
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> uniform;
    for (int round = 0; round < 500; ++round) {
        const auto capacity = static_cast<std::int64_t>(1 + random() % 300);
        SumTree tree(capacity);
        std::vector<double> values(static_cast<std::size_t>(capacity), 0);
        for (std::int64_t i = 0; i < capacity; ++i)
            if (random() % 3 == 0)
                tree.set(i, values[static_cast<std::size_t>(i)] = std::exp(20 * uniform(random)));
        if (tree.total() == 0) continue;
        const double total = tree.total();
        std::vector<double> targets{0, total, std::nextafter(total, 0.0)};
        for (int i = 0; i < 50; ++i) targets.push_back(uniform(random) * total);
        for (const double target : targets) {
            const std::int64_t found = tree.find(target);
            ASSERT_GT(tree.get(found), 0) << target;
            ASSERT_LE(sum_before(values, found), target + 1e-12 * total);
            ASSERT_GE(sum_before(values, found + 1), target - 1e-12 * total);
        }
    }
}

TEST(SumTree, FindsTheLastValueAboveZeroAtItsTotal) {
    SumTree tree(6);
    tree.set(1, 1);
    tree.set(2, 2);
    EXPECT_EQ(tree.find(3), 2);
    EXPECT_EQ(tree.find(0), 1);
}

// A sum that is corrected by differences would drift.
TEST(SumTree, DependsOnItsValuesOnly) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform;
    SumTree used(100), fresh(100);
    for (int i = 0; i < 100'000; ++i)
        used.set(static_cast<std::int64_t>(random() % 100), std::exp(20 * uniform(random)));
    for (std::int64_t i = 0; i < 100; ++i) {
        const double value = uniform(random);
        used.set(i, value);
        fresh.set(i, value);
    }
    EXPECT_EQ(used.total(), fresh.total());
    for (double target = 0; target < fresh.total(); target += 0.01)
        ASSERT_EQ(used.find(target), fresh.find(target));
}

TEST(SumTree, IsRestoredFromItsValues) {
    SumTree tree(13), restored(13);
    for (std::int64_t i = 0; i < 13; ++i) tree.set(i, 0.1 * static_cast<double>(i));
    std::ranges::copy(tree.values(), restored.values().begin());
    restored.restore_sums();
    EXPECT_EQ(restored.total(), tree.total());
    for (double target = 0; target < tree.total(); target += 0.05)
        EXPECT_EQ(restored.find(target), tree.find(target));
}

TEST(SumTree, RefusesWhatIsNoWeight) {
    SumTree tree(5);
    tree.set(3, 2);
    EXPECT_THAT([&] { tree.set(3, -0.5); },
                ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr("value 3"), HasSubstr("-0.5"))));
    EXPECT_THAT([&] { tree.set(3, std::numeric_limits<double>::quiet_NaN()); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("nan")));
    EXPECT_THAT([&] { tree.set(3, std::numeric_limits<double>::infinity()); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("inf")));
    EXPECT_EQ(tree.total(), 2);
    EXPECT_THAT([&] { tree.set(5, 1); }, ThrowsMessage<std::out_of_range>(HasSubstr("value 5")));
    EXPECT_THROW(tree.set(-1, 1), std::out_of_range);
    EXPECT_THROW(tree.get(5), std::out_of_range);
    EXPECT_THROW(SumTree(0), std::invalid_argument);
}

TEST(SumTree, RefusesATargetBeyondItsSum) {
    SumTree tree(5);
    EXPECT_THROW(tree.find(0), std::out_of_range);
    tree.set(3, 2);
    EXPECT_EQ(tree.find(0), 3);
    EXPECT_THAT([&] { tree.find(2.5); },
                ThrowsMessage<std::out_of_range>(AllOf(HasSubstr("2.5"), HasSubstr("its sum is 2"))));
    EXPECT_THROW(tree.find(-0.1), std::out_of_range);
    EXPECT_THROW(tree.find(std::numeric_limits<double>::quiet_NaN()), std::out_of_range);
}

}  // namespace
}  // namespace cale
