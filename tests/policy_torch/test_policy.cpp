#include "policy/torch/policy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <thread>

#include <torch/cuda.h>
#include <torch/nn/module.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "networks/actor_critic.h"
#include "networks/policy_weights.h"
#include "networks/ppo_network.h"
#include "networks/q_network.h"
#include "networks/sacd_network.h"
#include "policy/policy_lite.h"
#include "policy/sample_policies.h"
#include "policy/torch/actor_network.h"

namespace cale {
namespace {

using test::sample_policy;
using ::testing::HasSubstr;

/// Noise, and some frames that are nearly empty, as games have them.
torch::Tensor observations(const NetworkSpec& network, std::int64_t count) {
    auto generator = at::make_generator<at::CPUGeneratorImpl>(5);
    auto shape = network.observation;
    shape.insert(shape.begin(), count);
    auto frames = torch::randint(0, 256, shape, generator, torch::kUInt8);
    frames.slice(0, 0, count / 2).slice(-1, 2).zero_();
    return frames;
}

std::span<const std::uint8_t> bytes_of(const torch::Tensor& observation) {
    return {observation.const_data_ptr<std::uint8_t>(), static_cast<std::size_t>(observation.numel())};
}

/// Largest difference, as a part of the largest number.
double relative_difference(const torch::Tensor& a, std::span<const float> b) {
    const auto other = torch::tensor(at::ArrayRef<float>(b.data(), b.size())).view_as(a);
    return (a - other).abs().max().item<double>() / std::max(1.0, a.abs().max().item<double>());
}

class PolicyOf : public testing::TestWithParam<test::SampleNetwork> {};

TEST_P(PolicyOf, LibTorchAndLiteAgree) {
    const auto& network = GetParam().network;
    const auto contents = policy_file_contents(sample_policy(network));
    const auto policy = Policy::parse(contents);
    const auto lite = lite::Policy::parse(contents);
    auto workspace = lite.workspace();
    const auto frames = observations(network, 32);
    const auto outputs = policy.output(frames);
    const auto actions = policy.act(frames);
    for (std::int64_t i = 0; i < frames.size(0); ++i) {
        const auto frame = frames[i].contiguous();
        EXPECT_LT(relative_difference(outputs[i], lite.output(bytes_of(frame), workspace)), 1e-5);
        const auto decision = lite.act(bytes_of(frame), workspace);
        if (network.head.continuous()) {
            const auto action = actions[i].contiguous();
            const auto joystick = stick(policy.info().joystick, {action.const_data_ptr<float>(),
                                                                 static_cast<std::size_t>(action.numel())});
            EXPECT_NEAR(decision.stick.radius, joystick.radius, 1e-5);
            EXPECT_NEAR(decision.stick.theta, joystick.theta, 1e-4);
            EXPECT_NEAR(decision.stick.fire, joystick.fire, 1e-5);
        } else {
            EXPECT_EQ(decision.action, actions[i].item<std::int64_t>());
        }
        const auto alone = policy.act(bytes_of(frame));
        EXPECT_EQ(alone.action, decision.action);
        EXPECT_NEAR(alone.stick.theta, decision.stick.theta, 1e-4);
    }
}

TEST_P(PolicyOf, ComputesOnACudaDeviceAsOnTheCpu) {
    if (!torch::cuda::is_available()) GTEST_SKIP() << "this machine has no CUDA device";
    const auto contents = policy_file_contents(sample_policy(GetParam().network));
    const auto on_cuda = Policy::parse(contents, "policy", torch::kCUDA), on_cpu = Policy::parse(contents);
    const auto frames = observations(GetParam().network, 32);
    const auto expected = on_cpu.output(frames).contiguous();
    // Its convolutions round to ten bits (TF32).
    EXPECT_LT(relative_difference(on_cuda.output(frames), {expected.const_data_ptr<float>(),
                                                           static_cast<std::size_t>(expected.numel())}),
              1e-2);
    EXPECT_TRUE(on_cuda.act(frames).is_cpu());
}

INSTANTIATE_TEST_SUITE_P(EveryKind, PolicyOf, testing::ValuesIn(test::sample_networks()),
                         [](const auto& sample) { return sample.param.name; });

/// The policy of a network of agents.
template <class Network>
Policy policy_of(const Network& module) {
    const auto& network = module->acting;
    PolicyFile file{.info = test::sample_info(network), .network = network, .weights = {}, .golden = {}};
    for (const auto& [name, tensor] : policy_weights(network, *module)) {
        file.weights[name].assign(tensor.template const_data_ptr<float>(),
                                  tensor.template const_data_ptr<float>() + tensor.numel());
    }
    set_golden_pair(file);
    return Policy::parse(policy_file_contents(file));
}

TEST(PolicyOfTorch, NumbersThatAreNotFiniteDecideNothing) {
    auto file = sample_policy(test::action_values(flat()));
    for (auto& [name, weights] : file.weights)
        std::ranges::fill(weights, name.ends_with(".weight") ? 3e38F : 0.0F);
    std::ranges::fill(file.golden.observation, std::uint8_t{0});
    std::ranges::fill(file.golden.output, 0.0F);
    const auto policy = Policy::parse(policy_file_contents(file));
    const auto frames = torch::full({1, 2, 21, 18}, 255, torch::kUInt8);
    for (const auto choice : {Choice::greedy, Choice::sampled}) {
        try {
            policy.act(frames, choice, at::make_generator<at::CPUGeneratorImpl>(1));
            ADD_FAILURE() << "it decided";
        } catch (const std::runtime_error& error) {
            EXPECT_STREQ(error.what(),
                         "the policy's network gives a number that is not finite for this observation");
        }
    }
}

/// The encoders that agents choose from.
std::vector<EncoderConfig> every_encoder() {
    using enum EncoderKind;
    return {{.encoder = phi_sac, .observation = test::kSmallFrames},
            {.encoder = phi_dqn, .observation = test::kSmallFrames},
            {.encoder = phi_dqn, .phi_dqn = PhiDqn::row1d, .observation = test::kSmallFrames},
            {.encoder = phi_dqn, .observation = {4, 84, 84}, .padding = Padding::valid},
            {.encoder = impala, .observation = test::kSmallFrames},
            {.encoder = mlp, .observation = test::kSmallFrames},
            {.encoder = mlp, .observation = {4, 128}},
            {.encoder = mlp, .observation = {4, 128}, .layer_norm = true},
            {.encoder = compact, .observation = {2, 40, 33}},
            {.encoder = data_efficient, .observation = {2, 40, 33}},
            {.encoder = phi_dqn_2013, .observation = {2, 40, 33}}};
}

at::Generator generator() {
    return at::make_generator<at::CPUGeneratorImpl>(3);
}

TEST(PolicyEqualsNetwork, Sac) {
    const torch::NoGradGuard no_grad;
    for (const auto& encoder : every_encoder()) {
        SacNetwork module(encoder, HeadConfig{1, test::kSmallUnits}, generator());
        const auto policy = policy_of(module);
        const auto frames = observations(module->acting, 8);
        const auto expected = module->policy(module->encoder->trunk(frames));
        EXPECT_TRUE(at::equal(policy.act(frames), mean_action(expected, module->box)));
        auto random = generator();
        const auto noise = torch::randn({8, 3}, random);
        EXPECT_TRUE(at::equal(policy.act(frames, Choice::sampled, generator()),
                              sample(expected, noise, module->box).action));
    }
}

TEST(PolicyEqualsNetwork, Sacd) {
    const torch::NoGradGuard no_grad;
    for (const auto& encoder : every_encoder()) {
        SacdNetwork module(encoder, HeadConfig{1, test::kSmallUnits}, 5, generator());
        const auto policy = policy_of(module);
        const auto frames = observations(module->acting, 8);
        const auto expected = module->log_policy(module->encoder->trunk(frames));
        EXPECT_TRUE(at::equal(policy.output(frames), expected));
        EXPECT_TRUE(at::equal(policy.act(frames), expected.argmax(1)));
        auto random = generator();
        EXPECT_TRUE(at::equal(policy.act(frames, Choice::sampled, generator()),
                              expected.exp().multinomial(1, true, random).squeeze(1)));
    }
}

void expect_equal_to_policy(PpoNetwork module, std::int64_t actions) {
    const auto policy = policy_of(module);
    const auto frames = observations(module->acting, 8);
    const auto expected = module(frames).policy;
    auto random = generator();
    if (actions == 0) {
        EXPECT_TRUE(at::equal(policy.act(frames), mean_action(*expected.gaussian, module->box)));
        const auto noise = torch::randn({8, 3}, random);
        EXPECT_TRUE(at::equal(policy.act(frames, Choice::sampled, generator()),
                              sample(*expected.gaussian, noise, module->box).action));
    } else {
        EXPECT_TRUE(at::equal(policy.act(frames, Choice::sampled, generator()),
                              expected.log_pi.exp().multinomial(1, true, random).squeeze(1)));
    }
}

TEST(PolicyEqualsNetwork, Ppo) {
    const torch::NoGradGuard no_grad;
    for (const auto torso : {Torso::two_branch, Torso::shared}) {
        for (const auto log_std : {LogStd::direct, LogStd::summed}) {
            for (const std::int64_t actions : {0, 5}) {
                const PpoNetworkConfig config{.encoder = {.observation = test::kSmallFrames},
                                              .torso = torso,
                                              .hidden_units = test::kSmallUnits,
                                              .log_std = log_std};
                expect_equal_to_policy(PpoNetwork(config, actions, generator()), actions);
            }
        }
    }
}

/// Action values of outputs [B, A, atoms] with a support from -10 to 10.
torch::Tensor values_of(const torch::Tensor& outputs) {
    const auto atoms = outputs.size(2);
    const auto support = torch::linspace(-10, 10, atoms, torch::kFloat32);
    return atoms == 1 ? outputs.squeeze(2) : (outputs.softmax(2) * support).sum(2);
}

TEST(PolicyEqualsNetwork, ActionValues) {
    const torch::NoGradGuard no_grad;
    for (const auto& [dueling, noisy, factored] :
         {std::array{false, false, false}, {true, true, false}, {false, true, true}, {true, false, true}}) {
        for (const std::int64_t atoms : {1, 51}) {
            for (const auto& encoder : every_encoder()) {
                QHeadConfig head{.num_actions = factored ? 18 : 5,
                                 .hidden_units = test::kSmallUnits,
                                 .num_atoms = atoms,
                                 .dueling = dueling,
                                 .noisy = noisy,
                                 .noisy_evaluation = noisy};
                if (factored) head.factors = {3, 3, 2};
                QNetwork module(encoder, head, generator());
                const auto policy = policy_of(module);
                const auto frames = observations(module->acting, 8);
                const auto expected = values_of(module(frames));
                EXPECT_TRUE(at::equal(policy.output(frames), expected));
                EXPECT_TRUE(at::equal(policy.act(frames), expected.argmax(1)));
                if (!noisy) continue;
                // The same draws, and as many.
                auto of_module = generator(), of_policy = generator();
                const auto noise = module->head->draw_noise(of_module, 8);
                EXPECT_TRUE(at::equal(policy.act(frames, Choice::sampled, of_policy),
                                      values_of(module(frames, &noise)).argmax(1)));
                EXPECT_TRUE(at::equal(torch::rand({1}, of_module), torch::rand({1}, of_policy)));
            }
        }
    }
}

TEST(PolicyTest, AsEvaluatedDrawsInTheOrderOfTheAgents) {
    const auto network = test::action_values(phi_sac());
    const auto policy = Policy::parse(policy_file_contents(sample_policy(network)));  // epsilon 0.25
    const auto frames = observations(network, 64);
    auto random = generator();
    const auto chosen = torch::rand({64}, random) <= 0.25;
    const auto uniform = torch::randint(0, 5, {64}, random, torch::kInt64);
    const auto actions = policy.act(frames, Choice::as_evaluated, generator());
    EXPECT_TRUE(at::equal(actions, torch::where(chosen, uniform, policy.act(frames))));
    EXPECT_FALSE(at::equal(actions, policy.act(frames)));
}

TEST(PolicyTest, DrawsTheNoiseOfItsLayersAsLiteDoes) {
    constexpr int kDraws = 4'000;
    for (const auto& [name, network] : test::sample_networks()) {
        if (!is_noisy(network)) continue;
        auto file = sample_policy(network);
        for (auto& [parameter, numbers] : file.weights)
            if (parameter.ends_with("_sigma"))
                for (auto& number : numbers) number *= 0.5f;
        const auto policy = Policy::parse(policy_file_contents(file));
        const auto lite = lite::Policy::parse(policy_file_contents(file));
        const auto frame = observations(network, 2)[1].contiguous();
        auto shape = frame.sizes().vec();
        shape.insert(shape.begin(), kDraws);
        const auto actions = policy.act(frame.unsqueeze(0).expand(shape), Choice::sampled, generator());
        auto workspace = lite.workspace();
        std::mt19937_64 random(1);
        std::vector<double> frequencies(policy.info().actions.size());
        for (int i = 0; i < kDraws; ++i)
            frequencies.at(static_cast<std::size_t>(
                lite.act(bytes_of(frame), workspace, Choice::sampled, random).action)) += 1.0 / kDraws;
        EXPECT_LT(*std::ranges::max_element(frequencies), 0.999) << name;
        for (std::size_t a = 0; a < frequencies.size(); ++a) {
            const auto count = (actions == static_cast<std::int64_t>(a)).sum().item<double>();
            EXPECT_NEAR(count / kDraws, frequencies[a], 0.05) << name << ", action " << a;
        }
        EXPECT_TRUE(at::equal(policy.act(frame.unsqueeze(0)),
                              torch::tensor({lite.act(bytes_of(frame), workspace).action}, torch::kInt64)));
    }
}

TEST(PolicyTest, ActsInTheCoordinatesOfItsJoystick) {
    auto file = sample_policy(test::sample_networks().front().network);
    file.info.joystick = Joystick::cartesian;
    const auto contents = policy_file_contents(file);
    const auto policy = Policy::parse(contents);
    const auto lite = lite::Policy::parse(contents);
    auto workspace = lite.workspace();
    const auto frames = observations(file.network, 8);
    const auto output = policy.output(frames), actions = policy.act(frames);
    for (std::int64_t i = 0; i < 8; ++i) {
        // (x, y, fire)
        const auto mean = output[i].slice(0, 0, 3).tanh();
        EXPECT_NEAR(actions[i][0].item<float>(), mean[0].item<float>(), 1e-5);
        EXPECT_NEAR(actions[i][1].item<float>(), mean[1].item<float>(), 1e-5);
        EXPECT_NEAR(actions[i][2].item<float>(), 0.5F + 0.5F * mean[2].item<float>(), 1e-5);
        const auto frame = frames[i].contiguous();
        const auto decision = lite.act(bytes_of(frame), workspace), same = policy.act(bytes_of(frame));
        const float xy[] = {actions[i][0].item<float>(), actions[i][1].item<float>(), 0};
        const auto expected = stick(Joystick::cartesian, xy);
        EXPECT_NEAR(decision.stick.radius, expected.radius, 1e-5);
        EXPECT_NEAR(decision.stick.theta, expected.theta, 1e-4);
        EXPECT_NEAR(same.stick.theta, expected.theta, 1e-4);
        EXPECT_EQ(decision.event, joystick_event(decision.stick, 0.5F));
    }
}

TEST(PolicyTest, ThreadsShareAPolicy) {
    const auto network = test::sample_networks().front().network;
    const auto policy = Policy::parse(policy_file_contents(sample_policy(network)));
    const auto frames = observations(network, 16);
    const auto alone = policy.act(frames);
    std::vector<std::thread> threads;
    std::atomic<int> different = 0;
    for (int t = 0; t < 4; ++t) {
        threads.emplace_back([&] {
            for (int i = 0; i < 10; ++i) different += !at::equal(policy.act(frames), alone);
        });
    }
    for (auto& thread : threads) thread.join();
    EXPECT_EQ(different, 0);
}

TEST(PolicyTest, RefusesWhatIsNoObservation) {
    const auto network = test::sample_networks().front().network;
    const auto policy = Policy::parse(policy_file_contents(sample_policy(network)));
    EXPECT_THAT(test::message_of([&] {
                    policy.act(torch::zeros({1, 4, 84, 84}, torch::kUInt8));
                }),
                HasSubstr("[B, 2, 21, 18]"));
    EXPECT_THAT(test::message_of([&] { policy.act(torch::zeros({1, 2, 21, 18})); }), HasSubstr("float"));
    EXPECT_EQ(test::message_of([&] { policy.act(test::random_pixels(5, 1)); }),
              "an observation has 5 bytes: it must have 756");
}

TEST(PolicyTest, RefusesDamagedFilesInOneSentence) {
    auto file = sample_policy(test::sample_networks().front().network);
    file.golden.output[0] += 1;
    EXPECT_THAT(test::message_of([&] { Policy::parse(policy_file_contents(file), "x"); }),
                testing::StartsWith("'x' cannot be used: its network does not give the golden output"));
    EXPECT_EQ(test::message_of([] { Policy::parse("", "x"); }),
              "'x' cannot be used: it has 0 bytes, too few for a header");
    EXPECT_EQ(test::message_of([] { Policy::load("/no/such.safetensors"); }),
              "cannot read '/no/such.safetensors': No such file or directory");
}

}  // namespace
}  // namespace cale
