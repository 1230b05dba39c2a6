#include "policy/policy_lite.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <new>
#include <numbers>
#include <thread>

#include "policy/sample_policies.h"
#include "support/temporary_folder.h"

namespace {

std::atomic<std::int64_t> allocations = 0;

}  // namespace

// Every allocation of this program is counted. Not inline: GCC would take malloc's memory for a mistake.
[[gnu::noinline]] void* operator new(std::size_t size) {
    ++allocations;
    if (void* memory = std::malloc(size > 0 ? size : 1)) return memory;
    throw std::bad_alloc();
}
[[gnu::noinline]] void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
    ++allocations;
    return std::malloc(size > 0 ? size : 1);
}
[[gnu::noinline]] void* operator new(std::size_t size, std::align_val_t alignment) {
    ++allocations;
    const auto line = static_cast<std::size_t>(alignment);
    if (void* memory = std::aligned_alloc(line, (size + line - 1) / line * line)) return memory;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
    std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
    std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::align_val_t) noexcept {
    std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t, std::align_val_t) noexcept {
    std::free(memory);
}

namespace cale {
namespace {

using test::random_pixels;
using test::sample_policy;
using ::testing::HasSubstr;

lite::Policy policy_of(const PolicyFile& file) {
    return lite::Policy::parse(policy_file_contents(file));
}

/// The sample network of this name, with a policy of its own.
PolicyFile named(const std::string& name) {
    for (const auto& sample : test::sample_networks())
        if (sample.name == name) return sample_policy(sample.network);
    throw std::out_of_range(name);
}

TEST(LitePolicy, GreedyIsTheMeanTheLikeliestOrTheMostValuable) {
    for (const auto* name : {"sac", "ppo", "sacd", "der"}) {
        const auto policy = policy_of(named(name));
        auto workspace = policy.workspace();
        const auto pixels = random_pixels(policy.info().observation_size(), 3);
        const auto output = policy.output(pixels, workspace);
        const std::vector<float> numbers(output.begin(), output.end());
        const auto decision = policy.act(pixels, workspace);
        if (policy.info().actions.empty()) {
            ASSERT_EQ(numbers.size(), 6u);
            EXPECT_EQ(decision.action, -1);
            EXPECT_FLOAT_EQ(decision.stick.radius, 0.5f + 0.5f * std::tanh(numbers[0]));
            EXPECT_FLOAT_EQ(decision.stick.theta, 3.14159265f * std::tanh(numbers[1]));
            EXPECT_FLOAT_EQ(decision.stick.fire, 0.5f + 0.5f * std::tanh(numbers[2]));
            EXPECT_EQ(decision.event, joystick_event(decision.stick, 0.5f));
        } else {
            ASSERT_EQ(numbers.size(), 5u);
            const auto best = std::max_element(numbers.begin(), numbers.end()) - numbers.begin();
            EXPECT_EQ(decision.action, best);
            EXPECT_EQ(decision.event, policy.info().actions[static_cast<std::size_t>(best)]);
        }
    }
}

TEST(LitePolicy, SampledFollowsTheDistribution) {
    constexpr int kDraws = 6'000;
    std::mt19937_64 random(1);
    const auto policy = policy_of(named("sacd"));
    auto workspace = policy.workspace();
    const auto pixels = random_pixels(policy.info().observation_size(), 3);
    std::vector<double> frequencies(5);
    for (int i = 0; i < kDraws; ++i) {
        const auto action = policy.act(pixels, workspace, Choice::sampled, random).action;
        frequencies.at(static_cast<std::size_t>(action)) += 1.0 / kDraws;
    }
    const auto log_probabilities = policy.output(pixels, workspace);
    for (std::size_t i = 0; i < frequencies.size(); ++i)
        EXPECT_NEAR(frequencies[i], std::exp(log_probabilities[i]), 0.03);

    const auto gaussian = policy_of(named("ppo"));
    auto memory = gaussian.workspace();
    double mean = 0, square = 0;
    for (int i = 0; i < kDraws; ++i) {
        const auto radius = gaussian.act(pixels, memory, Choice::sampled, random).stick.radius;
        const double u = std::atanh(std::clamp(2 * static_cast<double>(radius) - 1, -0.9999999, 0.9999999));
        mean += u / kDraws;
        square += u * u / kDraws;
    }
    const auto numbers = gaussian.output(pixels, memory);
    EXPECT_NEAR(mean, numbers[0], 0.05);
    EXPECT_NEAR(std::sqrt(square - mean * mean), std::exp(numbers[3]), 0.05);
}

/// Four bytes, and a noisy head on them.
PolicyFile noisy_head(bool dueling) {
    auto network = test::noisy(test::with_observation({1, 4}, test::action_values(flat(), dueling)));
    network.layers = flat();
    return sample_policy(network);
}

TEST(LitePolicy, SampledActionValuesHaveTheNoiseOfTheirLayers) {
    // One layer, y = (mu + sigma f(q) f(p)^T) x + b + s f(q), of which E f^2 = sqrt(2 / pi).
    const auto file = noisy_head(false);
    const lite::InferencePlan plan(file);
    const std::vector<std::uint8_t> bytes{0, 51, 102, 255};
    const std::vector<double> x{0, 0.2, 0.4, 1};
    lite::Floats memory(plan.memory_size);
    plan.run(bytes, 1, memory);
    const auto output = plan.output(memory, 0);
    const std::vector<double> mean(output.begin(), output.end());
    const auto actions = mean.size();
    constexpr int kDraws = 40'000;
    std::mt19937_64 random(1);
    std::vector<double> sum(actions), squares(actions);
    for (int draw = 0; draw < kDraws; ++draw) {
        plan.run(bytes, 1, memory, &random);
        for (std::size_t a = 0; a < actions; ++a) {
            const double difference = static_cast<double>(plan.output(memory, 0)[a]) - mean[a];
            sum[a] += difference;
            squares[a] += difference * difference;
        }
    }
    const double f_squared = std::sqrt(2 / std::numbers::pi);
    for (std::size_t a = 0; a < actions; ++a) {
        double variance = std::pow(file.weights.at("head.out.bias_sigma")[a], 2);
        for (std::size_t i = 0; i < x.size(); ++i)
            variance +=
                f_squared * std::pow(x[i] * file.weights.at("head.out.weight_sigma")[a * x.size() + i], 2);
        variance *= f_squared;
        EXPECT_NEAR(sum[a] / kDraws, 0, 5 * std::sqrt(variance / kDraws));
        EXPECT_NEAR(squares[a] / kDraws / variance, 1, 0.06);
    }
}

/// What the last layers of this policy read, in the order of their weights.
std::vector<float> features_of(PolicyFile file, const std::vector<std::uint8_t>& pixels) {
    const auto count = file.weights.at("head.fc1.weight").size() / file.weights.at("head.fc1.bias").size();
    auto& layers = file.network.layers;
    layers.erase(std::ranges::find(layers, "head.fc1", &Layer::name), layers.end());
    file.network.head = {.kind = Head::Kind::values, .num_actions = static_cast<std::int64_t>(count)};
    auto& identity = file.weights["head.out.weight"];
    identity.assign(count * count, 0);
    for (std::size_t i = 0; i < count; ++i) identity[i * count + i] = 1;
    file.weights["head.out.bias"].assign(count, 0);
    const lite::InferencePlan plan(file);
    lite::Floats memory(plan.memory_size);
    plan.run(pixels, 1, memory);
    const auto output = plan.output(memory, 0);
    return {output.begin(), output.end()};
}

TEST(LitePolicy, NoiseBelongsToAnInput) {
    // A dense layer reads an image in another order than its weights are stored in. With sigma on inputs that
    // are 0, and on no others, noise changes nothing.
    auto file = sample_policy(test::noisy(test::action_values(phi_dqn())));
    const auto pixels = random_pixels(file.info.observation_size(), 3);
    const auto features = features_of(file, pixels);
    const auto zeros = static_cast<std::size_t>(std::ranges::count(features, 0.0f));
    ASSERT_GT(zeros, features.size() / 10);
    ASSERT_LT(zeros, features.size() - features.size() / 10);
    for (auto& [name, numbers] : file.weights)
        if (name.ends_with("_sigma")) std::ranges::fill(numbers, 0.0f);
    auto& sigma = file.weights.at("head.fc1.weight_sigma");
    std::mt19937_64 random(1);
    for (const bool on_zeros : {true, false}) {
        for (std::size_t i = 0; i < sigma.size(); ++i)
            sigma[i] = (features[i % features.size()] == 0) == on_zeros ? 1.0f : 0.0f;
        const lite::InferencePlan plan(file);
        lite::Floats memory(plan.memory_size);
        plan.run(pixels, 1, memory);
        const auto output = plan.output(memory, 0);
        const std::vector<float> without(output.begin(), output.end());
        plan.run(pixels, 1, memory, &random);
        EXPECT_EQ(std::ranges::equal(plan.output(memory, 0), without), on_zeros);
    }
}

TEST(LitePolicy, TheLayersOfADuelingHeadShareTheNoiseOfTheirInput) {
    // Four inputs of 1 and a sigma of 1: the mean of the action values is s f(q), and an action is s (f(q') -
    // mean f(q')) above it, with the sum s of four f(p). E f^2 = m = sqrt(2 / pi) and E f^4 = 1.
    auto file = noisy_head(true);
    for (auto& [name, numbers] : file.weights)
        std::ranges::fill(numbers, name.ends_with("weight_sigma") ? 1.0f : 0.0f);
    const lite::InferencePlan plan(file);
    lite::Floats memory(plan.memory_size);
    const std::vector<std::uint8_t> bytes(4, 255);
    std::mt19937_64 random(1);
    constexpr int kDraws = 100'000;
    double product = 0;
    for (int draw = 0; draw < kDraws; ++draw) {
        plan.run(bytes, 1, memory, &random);
        const auto values = plan.output(memory, 0);
        double mean = 0;
        for (const float value : values) mean += static_cast<double>(value) / test::kSmallActions;
        product += std::pow(mean * (static_cast<double>(values[0]) - mean), 2) / kDraws;
    }
    const double m = std::sqrt(2 / std::numbers::pi);
    const double fourth_moment =
        4 + 3 * 12 * m * m;  // of s; with two sums it would be (4 m)^2, 2.6 times less
    EXPECT_NEAR(product / (fourth_moment * m * m * (1 - 1.0 / test::kSmallActions)), 1, 0.2);
}

TEST(LitePolicy, AsEvaluatedIsUniformWithProbabilityEpsilon) {
    auto file = named("dqn");  // epsilon 0.25
    const auto policy = policy_of(file);
    auto workspace = policy.workspace();
    std::mt19937_64 random(1);
    const auto pixels = random_pixels(policy.info().observation_size(), 3);
    const auto best = policy.act(pixels, workspace).action;
    int others = 0;
    for (int i = 0; i < 4'000; ++i) {
        others += policy.act(pixels, workspace, Choice::as_evaluated, random).action != best;
        ASSERT_EQ(policy.act(pixels, workspace, Choice::sampled, random).action, best);
    }
    EXPECT_NEAR(others / 4'000.0, 0.25 * 4 / 5, 0.03);
}

TEST(LitePolicy, ABatchIsItsObservations) {
    for (const auto& [name, network] : test::sample_networks()) {
        const auto policy = policy_of(sample_policy(network));
        const auto size = policy.info().observation_size();
        const std::size_t count = 19;
        const auto pixels = random_pixels(count * size, 3);
        const auto alone = [&] {
            auto workspace = policy.workspace();
            std::mt19937_64 random(1);
            std::vector<Decision> decisions;
            for (std::size_t i = 0; i < count; ++i)
                decisions.push_back(policy.act(std::span(pixels).subspan(i * size, size), workspace,
                                               Choice::as_evaluated, random));
            return decisions;
        }();
        for (const std::size_t room : {1, 2, 3, 8, 16}) {
            auto workspace = policy.workspace(room);
            std::mt19937_64 random(1);
            std::vector<Decision> decisions(count);
            const auto before = allocations.load();
            // Twice: nothing of the first time is left in the memory.
            for (int time = 0; time < 2; ++time) {
                random.seed(1);
                policy.act(pixels, decisions, workspace, Choice::as_evaluated, random);
            }
            EXPECT_EQ(allocations.load(), before) << name;
            for (std::size_t i = 0; i < count; ++i) {
                EXPECT_EQ(decisions[i].action, alone[i].action) << name << ", room for " << room;
                EXPECT_EQ(decisions[i].stick.theta, alone[i].stick.theta) << name << ", room for " << room;
            }
        }
    }
}

TEST(LitePolicy, RefusesBatchesThatAreNone) {
    const auto policy = policy_of(named("sac"));
    auto workspace = policy.workspace(2);
    std::vector<Decision> decisions(3);
    const auto pixels = random_pixels(policy.info().observation_size(), 3);
    EXPECT_THAT(test::message_of([&] { policy.act(pixels, decisions, workspace); }),
                HasSubstr("3 observations have"));
    EXPECT_EQ(test::message_of([&] { policy.workspace(0); }),
              "a workspace has room for at least one observation");
    EXPECT_THROW(policy.workspace(std::size_t{1} << 60), std::length_error);
}

TEST(LitePolicy, ActingAllocatesNothing) {
    for (const auto& [name, network] : test::sample_networks()) {
        const auto policy = policy_of(sample_policy(network));
        auto workspace = policy.workspace();
        std::mt19937_64 random(1);
        const auto pixels = random_pixels(policy.info().observation_size(), 3);
        const auto before = allocations.load();
        for (const auto choice : {Choice::greedy, Choice::sampled, Choice::as_evaluated})
            policy.act(pixels, workspace, choice, random);
        EXPECT_EQ(allocations.load(), before) << name;
    }
}

TEST(LitePolicy, ThreadsShareAPolicy) {
    const auto policy = policy_of(named("sac_impala"));
    const auto size = policy.info().observation_size();
    std::vector<float> alone;
    auto workspace = policy.workspace();
    for (std::uint32_t i = 0; i < 20; ++i)
        alone.push_back(policy.act(random_pixels(size, i), workspace).stick.theta);
    std::vector<std::thread> threads;
    std::atomic<int> different = 0;
    for (int t = 0; t < 4; ++t) {
        threads.emplace_back([&] {
            auto own = policy.workspace();
            for (std::uint32_t i = 0; i < 20; ++i)
                different += policy.act(random_pixels(size, i), own).stick.theta != alone[i];
        });
    }
    for (auto& thread : threads) thread.join();
    EXPECT_EQ(different, 0);
}

TEST(LitePolicy, TheNewestOutputIsThatOfTheDecision) {
    for (const auto* name : {"sac", "der"}) {
        const auto policy = policy_of(named(name));
        auto workspace = policy.workspace(), other = policy.workspace();
        std::mt19937_64 random(1);
        for (const int seed : {3, 4}) {
            const auto pixels = random_pixels(policy.info().observation_size(), seed);
            const auto decision = policy.act(pixels, workspace, Choice::greedy, random);
            const auto expected = policy.output(pixels, other);
            const auto newest = policy.newest_output(workspace);
            EXPECT_TRUE(std::ranges::equal(newest, expected)) << name;
            if (!policy.info().actions.empty()) continue;
            const auto mean = lite::squashed_decision(policy.info(), newest.first(newest.size() / 2));
            EXPECT_EQ(mean.stick.radius, decision.stick.radius);
            EXPECT_EQ(mean.stick.theta, decision.stick.theta);
            EXPECT_EQ(mean.event, decision.event);
        }
    }
}

TEST(LitePolicy, RefusesWhatIsNotItsOwn) {
    const auto policy = policy_of(named("sac")), other = policy_of(named("ppo"));
    auto workspace = policy.workspace();
    const auto pixels = random_pixels(policy.info().observation_size(), 3);
    EXPECT_THAT(test::message_of([&] { other.act(pixels, workspace); }), HasSubstr("made by another policy"));
    EXPECT_THAT(test::message_of([&] { other.newest_output(workspace); }),
                HasSubstr("made by another policy"));
    EXPECT_EQ(test::message_of([&] { policy.act(std::span(pixels).first(5), workspace); }),
              "an observation has 5 bytes: it must have 756");
}

/// The message of a decision on white pixels. All that a black observation gives is 0, however large the
/// weights.
std::string decision_on_white(PolicyFile file, Choice choice) {
    std::ranges::fill(file.golden.observation, std::uint8_t{0});
    std::ranges::fill(file.golden.output, 0.0F);
    const auto policy = policy_of(file);
    auto workspace = policy.workspace();
    std::mt19937_64 random(1);
    const std::vector<std::uint8_t> pixels(policy.info().observation_size(), 255);
    return test::message_of([&] { policy.act(pixels, workspace, choice, random); });
}

TEST(LitePolicy, NumbersThatAreNotFiniteDecideNothing) {
    auto file = sample_policy(test::action_values(flat()));
    for (auto& [name, weights] : file.weights)
        std::ranges::fill(weights, name.ends_with(".weight") ? 3e38F : 0.0F);
    for (const auto choice : {Choice::greedy, Choice::sampled})
        EXPECT_EQ(decision_on_white(file, choice),
                  "the policy's network gives a number that is not finite for this observation");
}

/// The first layer gives infinities, and the second their differences: no ReLU and no pooling may take what
/// is not a number for a small one.
TEST(LitePolicy, NumbersThatAreNotFiniteStaySoInEveryLayer) {
    for (const auto* name : {"sac", "sac_dqn", "sac_impala", "sac_mlp", "dqn", "der_data_efficient"}) {
        auto file = named(name);
        for (auto& [parameter, weights] : file.weights)
            for (std::size_t i = 0; i < weights.size(); ++i)
                weights[i] = !parameter.ends_with(".weight") ? 0.0F : i % 2 == 0 ? 3e38F : -3e38F;
        std::ranges::fill(file.weights.at(parameter_shapes(file.network).front().name), 3e38F);
        EXPECT_EQ(decision_on_white(file, Choice::greedy),
                  "the policy's network gives a number that is not finite for this observation")
            << name;
    }
}

TEST(LitePolicy, WhatCannotBeAPolicyIsNotReadToItsEnd) {
    EXPECT_EQ(test::message_of([] { lite::Policy::load("/dev/zero"); }),
              "'/dev/zero' cannot be used: its header is not valid JSON");
    const ::test::TemporaryFolder folder;
    const auto large = folder.write("large", "0123456789");
    std::filesystem::resize_file(large, 1'000'000'000'000);
    EXPECT_THAT(test::message_of([&] { lite::Policy::load(large); }),
                HasSubstr("bytes does not fit; it is cut off or"));
}

TEST(LitePolicy, AWorkspaceIsNoOtherPolicysAfterItsOwnIsGone) {
    const auto file = named("sac");
    for (int i = 0; i < 8; ++i) {
        auto workspace = policy_of(file).workspace();
        const auto other = policy_of(file);  // might be where the first one was
        const auto pixels = random_pixels(other.info().observation_size(), 3);
        EXPECT_THAT(test::message_of([&] { other.act(pixels, workspace); }),
                    HasSubstr("made by another policy"));
    }
}

TEST(LitePolicy, APolicyThatIsMovedFromIsStillOne) {
    auto policy = policy_of(named("sac"));
    const auto other = std::move(policy);
    auto workspace = policy.workspace();  // NOLINT(bugprone-use-after-move)
    const auto pixels = random_pixels(policy.info().observation_size(), 1);
    EXPECT_EQ(policy.act(pixels, workspace).stick.theta, other.act(pixels, workspace).stick.theta);
}

TEST(LitePolicy, ADrawHasANumberForEachCoordinate) {
    PolicyInfo info;  // polar: three
    EXPECT_EQ(lite::squashed_decision(info, std::array{0.0f, 0.0f, 0.0f}).event, Event::noop);
    for (const std::size_t size : {0u, 2u, 4u, 5u})
        EXPECT_THROW(lite::squashed_decision(info, std::vector<float>(size)), std::invalid_argument);
}

TEST(LitePolicy, FilesThatCannotBeRead) {
    EXPECT_EQ(test::message_of([] { lite::Policy::load("/no/such.safetensors"); }),
              "cannot read '/no/such.safetensors': No such file or directory");
    EXPECT_EQ(test::message_of([] { lite::Policy::load("/tmp"); }), "cannot read '/tmp': Is a directory");
    EXPECT_THAT(test::message_of([] { lite::Policy::load("/dev/null"); }), HasSubstr("it has 0 bytes"));
}

TEST(DecisionTest, OfJoysticksAndOfNumbers) {
    PolicyInfo info;
    info.radius_is_strength = true;
    const auto stick = decision(info, ContinuousAction{0.75f, 0, 1});
    EXPECT_EQ(stick.event, Event::right_fire);
    EXPECT_EQ(stick.strength, 0.75f);
    EXPECT_FALSE(stick.paddle);
    info.joystick = Joystick::paddle;
    const auto paddle = decision(info, cale::stick(Joystick::paddle, std::array{0.25f, 1.0f}));
    EXPECT_EQ(paddle.paddle, 0.25f);
    EXPECT_EQ(paddle.event, Event::fire);
    info.joystick = Joystick::polar;
    info.actions = {Event::noop, Event::up};
    EXPECT_EQ(decision(info, std::int64_t{1}).event, Event::up);
    EXPECT_EQ(decision(info, std::int64_t{1}).strength, 1);
    EXPECT_THROW(decision(info, std::int64_t{2}), std::out_of_range);
    EXPECT_THROW(decision(info, std::int64_t{-1}), std::out_of_range);
}

TEST(LitePolicy, AsEvaluatedIsDrawnWhereTheRunsEvaluationsDrew) {
    for (const auto* name : {"ppo", "sacd"}) {
        auto file = named(name);
        file.info.epsilon = 0;
        file.info.evaluation_samples = true;
        const auto policy = policy_of(file);
        auto workspace = policy.workspace();
        const auto pixels = random_pixels(policy.info().observation_size(), 3);
        const auto greedy = policy.act(pixels, workspace);
        std::mt19937_64 random(1), same(1);
        int different = 0;
        for (int i = 0; i < 50; ++i) {
            const auto evaluated = policy.act(pixels, workspace, Choice::as_evaluated, random);
            const auto drawn = policy.act(pixels, workspace, Choice::sampled, same);
            EXPECT_EQ(evaluated.action, drawn.action) << name;
            EXPECT_EQ(evaluated.stick.theta, drawn.stick.theta) << name;
            different += evaluated.action != greedy.action || evaluated.stick.theta != greedy.stick.theta;
        }
        EXPECT_GT(different, 0) << name;
    }
}

TEST(LitePolicy, ARandomActionIsUniformInTheBoxOfItsJoystick) {
    auto file = named("sac");
    file.info.epsilon = 1;
    const auto policy = policy_of(file);
    auto workspace = policy.workspace();
    const auto pixels = random_pixels(policy.info().observation_size(), 3);
    std::mt19937_64 random(1);
    std::array<int, 3> quarters{};
    for (int i = 0; i < 2'000; ++i) {
        const auto stick = policy.act(pixels, workspace, Choice::as_evaluated, random).stick;
        quarters[0] += stick.radius < 0.25F;
        quarters[1] += stick.theta < -std::numbers::pi_v<float> / 2;
        quarters[2] += stick.fire > 0.75F;
    }
    for (const int count : quarters) EXPECT_NEAR(count, 500, 80) << "four standard deviations";
}

}  // namespace
}  // namespace cale
