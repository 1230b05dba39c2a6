// Prioritised sampling: what is drawn how often, and which priority each transition has.
#include <algorithm>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "numbered_frames.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::FloatEq;
using testing::Gt;
using testing::HasSubstr;
using testing::Lt;
using testing::Pointwise;
using testing::ThrowsMessage;

ReplayBuffer prioritised(std::int64_t capacity, std::int64_t steps) {
    return filled(capacity, steps, true);
}

TEST(PrioritisedReplay, DrawsInProportionToPriority) {
    ReplayBuffer replay = prioritised(20, 50);  // the ring has wrapped
    std::vector<std::int64_t> index;
    std::vector<double> priority;
    for (std::int64_t slot = 0; slot < 20; ++slot) {
        index.push_back(slot);
        priority.push_back(static_cast<double>(slot % 5));
    }
    give(replay, index, priority);
    std::mt19937_64 random(7);
    constexpr int draws = 40'000;
    const Batch batch = replay.sample(draws, random);
    std::vector<double> counts(20, 0);
    for (int i = 0; i < draws; ++i)
        ++counts.at(static_cast<std::size_t>(batch.index.const_data_ptr<std::int64_t>()[i]));
    double chi_square = 0;
    for (std::size_t slot = 0; slot < 20; ++slot) {
        const double expected = draws * priority[slot] / 40;
        if (expected == 0)
            EXPECT_EQ(counts[slot], 0);
        else
            chi_square += (counts[slot] - expected) * (counts[slot] - expected) / expected;
    }
    EXPECT_LT(chi_square, 44.3);  // 15 degrees of freedom, p = 1e-4
    EXPECT_GT(chi_square, 2.4);   // p = 1 - 1e-4: strata would be more even than chance
}

TEST(PrioritisedReplay, DrawsIndicesAsDocumented) {
    ReplayBuffer replay = prioritised(100, 5);
    give(replay, {0, 1, 2, 3}, {1, 4, 0, 3});
    std::mt19937_64 random(5), same(5);
    const Batch batch = replay.sample(64, random);
    const auto found = read(batch);
    for (std::int64_t row = 0; row < 64; ++row) {
        const double target = static_cast<double>(same() >> 11) * 0x1p-53 * 8;
        const std::int64_t index = target < 1 ? 0 : target < 5 ? 1 : 3;
        EXPECT_EQ(batch.index[row].item<std::int64_t>(), index);
        EXPECT_EQ(found[static_cast<std::size_t>(row)].action, index + 1);
        EXPECT_EQ(batch.probability[row].item<float>(), index == 0 ? 0.125f : index == 1 ? 0.5f : 0.375f);
    }
    EXPECT_EQ(random, same);
}

TEST(PrioritisedReplay, NewTransitionsEnterWithTheLargestPriorityEverGiven) {
    ReplayBuffer replay = prioritised(10, 3);
    EXPECT_THAT(probabilities(replay), ElementsAre(0.5f, 0.5f));
    give(replay, {0, 1}, {0.5, 0.25});  // less than the 1 that it starts with
    add(replay, {.frame = 4});
    EXPECT_THAT(probabilities(replay), Pointwise(FloatEq(), {0.5 / 1.75, 0.25 / 1.75, 1 / 1.75}));
    give(replay, {1}, {6});
    give(replay, {1}, {0.5});  // what was once given stays the largest
    add(replay, {.frame = 5});
    EXPECT_THAT(probabilities(replay), Pointwise(FloatEq(), {0.5 / 8, 0.5 / 8, 1. / 8, 6. / 8}));
}

TEST(PrioritisedReplay, TheFirstOfEqualIndicesCounts) {
    ReplayBuffer replay = prioritised(10, 4);
    give(replay, {1, 0, 1, 2, 1}, {2, 1, 9, 5, 0.125});
    EXPECT_THAT(probabilities(replay), ElementsAre(1.0f / 8, 2.0f / 8, 5.0f / 8));
    add(replay, {.frame = 5});  // but the largest of them is remembered
    EXPECT_FLOAT_EQ(probabilities(replay).back(), 9.0f / 17);
}

TEST(PrioritisedReplay, TakesSinglePrecision) {
    ReplayBuffer replay = prioritised(10, 3);
    replay.set_priorities(torch::tensor({1, 0}, torch::kInt64), torch::tensor({3.0f, 1.0f}));
    EXPECT_THAT(probabilities(replay), ElementsAre(0.25f, 0.75f));
    replay.set_priorities(torch::empty({0}, torch::kInt64), torch::empty({0}));
    EXPECT_THAT(probabilities(replay), ElementsAre(0.25f, 0.75f));
}

TEST(PrioritisedReplay, IgnoresAnIndexWithoutATransition) {
    ReplayBuffer replay = prioritised(10, 3);
    give(replay, {2, 9, 0}, {100, 100, 3});
    EXPECT_THAT(probabilities(replay), ElementsAre(0.75f, 0.25f));
    add(replay, {.frame = 4});  // not with 100
    EXPECT_THAT(probabilities(replay), Pointwise(FloatEq(), {3. / 7, 1. / 7, 3. / 7}));
    std::mt19937_64 random(1);
    EXPECT_LT(replay.sample(100, random).index.max().item<std::int64_t>(), 3);
}

TEST(PrioritisedReplay, DrawsUniformlyWhereEveryPriorityIsZero) {
    ReplayBuffer replay = prioritised(10, 3);
    give(replay, {0, 1}, {0, 0});
    EXPECT_THAT(probabilities(replay), ElementsAre(0.5f, 0.5f));
    std::mt19937_64 random(1);
    const auto batch = replay.sample(100, random);
    EXPECT_THAT(batch.index.sum().item<std::int64_t>(), AllOf(Gt(25), Lt(75)));
    EXPECT_TRUE((batch.probability == 0.5).all().item<bool>());
}

TEST(PrioritisedReplay, CannotDrawFromNothing) {
    std::mt19937_64 random(1);
    EXPECT_THAT([&] { prioritised(10, 1).sample(1, random); },
                ThrowsMessage<std::runtime_error>(HasSubstr("no transition")));
}

/// The priorities of all transitions that ever were; the newest `size` of them are left.
class NaivePriorities {
  public:
    explicit NaivePriorities(std::int64_t capacity) : capacity_(capacity) {}

    void follow(const ReplayBuffer& replay) {
        priorities_.resize(static_cast<std::size_t>(replay.add_count()), largest_);
        size_ = replay.size();
    }

    // Where this index lies, 0 being the oldest; -1: nowhere.
    std::int64_t position(std::int64_t index) const {
        for (std::int64_t position = 0; position < size_; ++position)
            if ((begin() + position) % capacity_ == index) return position;
        return -1;
    }

    void give(const std::vector<std::int64_t>& index, const std::vector<double>& priority) {
        for (std::size_t i = 0; i < index.size(); ++i) {
            const std::int64_t where = position(index[i]);
            if (where < 0) continue;
            largest_ = std::max(largest_, priority[i]);
            if (std::find(index.begin(), index.end(), index[i]) - index.begin() ==
                static_cast<std::ptrdiff_t>(i))
                priorities_[static_cast<std::size_t>(begin() + where)] = priority[i];
        }
    }

    // Oldest first.
    std::vector<double> left() const { return {priorities_.end() - size_, priorities_.end()}; }

  private:
    std::int64_t begin() const { return static_cast<std::int64_t>(priorities_.size()) - size_; }

    std::int64_t capacity_, size_ = 0;
    double largest_ = 1;
    std::vector<double> priorities_;
};

// Both rings wrap, environments pause, windows are cut off: a transition that is dropped takes
// its priority with it, and all that is left has the priority it was given.
TEST(PrioritisedReplay, NeverDrawsWhatWasDropped) {
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
        SCOPED_TRACE(seed);
        Fuzz fuzz(2000 + seed);
        ReplayConfig config = fuzz.config();
        config.prioritised = true;
        ReplayBuffer replay(config);
        NaivePriorities naive(config.capacity);
        std::mt19937_64 random(seed);
        for (int t = 0; t < 200; ++t) {
            const std::int64_t env = t / 50 % 2 == 0 ? fuzz.below(config.num_envs) : 0;
            add(replay, fuzz.step(10, true), env);
            naive.follow(replay);
            if (fuzz.below(3) == 0) {
                std::vector<std::int64_t> index;
                std::vector<double> priority;
                for (int i = 0; i < 8; ++i) {
                    index.push_back(fuzz.below(config.capacity));
                    priority.push_back(static_cast<double>(fuzz.below(6)) / 2);
                }
                give(replay, index, priority);
                naive.give(index, priority);
            }
            const auto left = naive.left();
            const double total = std::accumulate(left.begin(), left.end(), 0.0);
            if (total == 0) continue;
            const auto found = probabilities(replay);
            for (std::size_t i = 0; i < left.size(); ++i)
                ASSERT_FLOAT_EQ(found[i], static_cast<float>(left[i] / total)) << "position " << i;
            if (t % 5 != 0) continue;
            const auto stored = read_all(replay);
            const Batch batch = replay.sample(16, random);
            const auto drawn = read(batch);
            for (std::size_t row = 0; row < drawn.size(); ++row) {
                const auto position = naive.position(
                    batch.index.const_data_ptr<std::int64_t>()[static_cast<std::ptrdiff_t>(row)]);
                ASSERT_GE(position, 0) << drawn[row] << " was dropped";
                ASSERT_EQ(drawn[row], stored[static_cast<std::size_t>(position)]);
                ASSERT_GT(left[static_cast<std::size_t>(position)], 0);
            }
        }
    }
}

TEST(PrioritisedReplay, RefusesOtherPrioritiesAndChangesNothing) {
    ReplayBuffer replay = prioritised(10, 3);
    const auto index = torch::tensor({0, 1}, torch::kInt64);
    const auto message_of = [&](const torch::Tensor& indices, const torch::Tensor& priority) {
        try {
            replay.set_priorities(indices, priority);
        } catch (const std::invalid_argument& error) {
            return std::string(error.what());
        }
        return std::string("accepted");
    };
    const auto two = torch::tensor({5.0f, 5.0f});
    EXPECT_THAT(message_of(index, torch::tensor({5.0f, 5.0f, 5.0f})),
                AllOf(HasSubstr("priority"), HasSubstr("[2]"), HasSubstr("[3]")));
    EXPECT_THAT(message_of(index, torch::tensor({5, 5}, torch::kInt64)),
                AllOf(HasSubstr("priority"), HasSubstr("Float"), HasSubstr("Long")));
    EXPECT_THAT(message_of(index, {}), HasSubstr("priority"));
    EXPECT_THAT(message_of(index.to(torch::kInt32), two), HasSubstr("index"));
    EXPECT_THAT(message_of(index.reshape({1, 2}), two), HasSubstr("index"));
    EXPECT_THAT(message_of({}, two), HasSubstr("index"));
    EXPECT_THAT(message_of(index, torch::tensor({5.0, -0.5})),
                AllOf(HasSubstr("index 1"), HasSubstr("-0.5")));
    EXPECT_THAT(message_of(index, torch::tensor({5.0, std::numeric_limits<double>::quiet_NaN()})),
                HasSubstr("nan"));
    EXPECT_THAT(message_of(index, torch::tensor({5.0, std::numeric_limits<double>::infinity()})),
                HasSubstr("inf"));
    EXPECT_THAT(message_of(index, torch::tensor({5.0, 1e39}, torch::kFloat64)), HasSubstr("1e+39"));
    EXPECT_THAT(
        [&] {
            give(replay, {0, 10}, {5, 5});
        },
        ThrowsMessage<std::out_of_range>(HasSubstr("index 10")));
    EXPECT_THROW(give(replay, {0, -1}, {5, 5}), std::out_of_range);
    EXPECT_THAT(probabilities(replay), ElementsAre(0.5f, 0.5f));
    add(replay, {.frame = 4});
    EXPECT_FLOAT_EQ(probabilities(replay).back(), 1.0f / 3);

    ReplayBuffer uniform = filled(10, 3);
    EXPECT_THAT([&] { give(uniform, {0}, {1}); },
                ThrowsMessage<std::logic_error>(HasSubstr("samples uniformly")));
}

}  // namespace
}  // namespace cale
