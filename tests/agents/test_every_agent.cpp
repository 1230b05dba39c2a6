// What holds for every agent, or for all that learn from a replay, written once over a table of them.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/cuda.h>
#include <torch/types.h>

#include "agent_worlds.h"
#include "agents/random.h"
#include "cale/joystick.h"
#include "replay/replay_buffer.h"
#include "replay/replay_snapshot.h"
#include "support/temporary_folder.h"
#include "test_device.h"

namespace cale {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

/// The settings that the tests below change.
struct Settings {
    std::int64_t hidden_units = 16;
    ReplaySettings replay = small_replay();
    EpsilonSettings epsilon{.epsilon_decay_period = 20};
    std::int64_t actor_period = 1;
};

struct Kind {
    std::string name;
    std::int64_t num_actions;  // of its world; 0: the joystick
    std::vector<std::string> losses;
    std::function<std::unique_ptr<Agent>(const Settings&, const AgentSpec&)> make;
    bool draws_on_the_device = false;                 // in its updates
    std::optional<Joystick> joystick = std::nullopt;  // of its world, if not that of joystick_world()

    AgentSpec world(std::int64_t num_envs = 1, std::uint64_t seed = 1) const {
        if (num_actions == 0) {
            auto spec = joystick_world(num_envs, seed);
            if (joystick) spec.action_space = joystick_space(*joystick);
            return spec;
        }
        auto spec = discrete_world(num_envs, seed);
        spec.action_space = Discrete{num_actions};
        return spec;
    }
};

std::ostream& operator<<(std::ostream& out, const Kind& kind) {
    return out << kind.name;
}

std::string name_of(const testing::TestParamInfo<Kind>& info) {
    return info.param.name;
}

template <class Config>
Kind kind(const std::string& name, std::int64_t num_actions,
          std::unique_ptr<Agent> (*make)(const Config&, const AgentSpec&), const Config& config,
          const std::vector<std::string>& losses) {
    return {name, num_actions, losses,
            [=](const Settings& settings, const AgentSpec& spec) {
                auto changed = config;
                changed.epsilon = settings.epsilon;
                if constexpr (requires { changed.network; })
                    changed.network.hidden_units = settings.hidden_units;
                else
                    changed.hidden_units = settings.hidden_units;
                if constexpr (requires { changed.replay; }) changed.replay = settings.replay;
                if constexpr (requires { changed.actor_period; })
                    changed.actor_period = settings.actor_period;
                return make(changed, spec);
            },
            std::is_same_v<Config, SacConfig> || std::is_same_v<Config, DerConfig>};
}

const std::vector<std::string> kSacLosses{"qf_loss",    "qf1_values", "qf2_values", "target_values",
                                          "actor_loss", "alpha_loss", "alpha",      "entropy"};

Kind sac() {
    auto config = small_sac();
    config.exploration = Exploration::epsilon_greedy;
    return kind("Sac", 0, make_sac, config, kSacLosses);
}

Kind sacd() {
    auto config = small_sacd();
    config.exploration = Exploration::epsilon_greedy;
    return kind("Sacd", kNumActions, make_sacd, config, kSacLosses);
}

/// SAC with most of what the paper's has not.
Kind sac_plus() {
    return {"SacPlus", 0, kSacLosses,
            [](const Settings& settings, AgentSpec spec) {
                auto config = small_sac();
                config.network.hidden_units = settings.hidden_units;
                config.network.layer_norm = true;
                config.replay = settings.replay;
                config.replay.random_shift = 2;
                config.exploration = Exploration::epsilon_greedy;
                config.random_actions = RandomActions::events;
                config.critic.atoms = 11;
                config.epsilon = settings.epsilon;
                config.actor_period = settings.actor_period;
                config.weight_decay = 0.1;
                config.initial_alpha = 0.01;
                config.alpha_learning_rate = 1e-3;
                config.entropy_in_target = false;
                config.twin_estimate = TwinEstimate::mean;
                config.act_with_target = true;
                spec.action_space = joystick_space(Joystick::polar);
                return make_sac(config, spec);
            },
            /*draws_on_the_device=*/true};
}

/// Four coordinates instead of three.
Kind sac_direction() {
    auto config = small_sac();
    config.critic.atoms = 11;
    config.exploration = Exploration::epsilon_greedy;
    auto kind_of_sac = kind("SacDirection", 0, make_sac, config, kSacLosses);
    kind_of_sac.joystick = Joystick::direction;
    return kind_of_sac;
}

/// A critic with one head for each axis of the joystick and one for the button.
Kind der_factored() {
    return {"DerFactored",
            18,
            {"cross_entropy", "q_values"},
            [](const Settings& settings, AgentSpec spec) {
                auto config = small_der();
                config.hidden_units = settings.hidden_units;
                config.layer_norm = true;
                config.replay = settings.replay;
                config.replay.random_shift = 2;
                config.epsilon = settings.epsilon;
                config.weight_decay = 0.1;
                config.noisy_evaluation = config.random_warmup = true;
                spec.action_space = joystick_space(Joystick::factored);
                return make_der(config, spec);
            },
            /*draws_on_the_device=*/true};
}

Kind dqn() {
    return kind("Dqn", kNumActions, make_dqn, small_dqn(), {"td_loss", "q_values"});
}

Kind der() {
    return kind("Der", kNumActions, make_der, small_der(), {"cross_entropy", "q_values"});
}

Kind der_without_noise() {
    auto config = small_der();
    config.noisy = false;
    return kind("DerWithoutNoise", kNumActions, make_der, config, {"cross_entropy", "q_values"});
}

Kind ppo(const std::string& name, std::int64_t num_actions) {
    return kind(
        name, num_actions, make_ppo, small_ppo(),
        {"loss", "policy_loss", "value_loss", "entropy", "approx_kl", "clipfrac", "explained_variance"});
}

// Every agent -------------------------------------------------------------------------

std::vector<Kind> every_agent() {
    return {sac(),
            sac_plus(),
            sac_direction(),
            dqn(),
            der(),
            der_factored(),
            sacd(),
            ppo("PpoWithTheJoystick", 0),
            ppo("PpoWithActions", kNumActions)};
}

class EveryAgent : public testing::TestWithParam<Kind> {
  protected:
    std::unique_ptr<Agent> make(const AgentSpec& spec, const Settings& settings = {}) const {
        return GetParam().make(settings, spec);
    }
    AgentSpec world(std::int64_t num_envs = 1, std::uint64_t seed = 1) const {
        return GetParam().world(num_envs, seed);
    }
};

INSTANTIATE_TEST_SUITE_P(Table, EveryAgent, testing::ValuesIn(every_agent()), name_of);

TEST_P(EveryAgent, ActsWithinItsWorld) {
    const auto spec = world(4);
    const auto agent = make(spec);
    const auto expect_inside = [&](std::int64_t count, ActMode mode) {
        const auto actions = agent->act(noise_frames(count, 5), mode);
        if (num_actions(spec.action_space) == 0) {
            ASSERT_EQ(actions.sizes(), (std::vector<std::int64_t>{count, box_size(spec.action_space)}));
            ASSERT_EQ(actions.scalar_type(), torch::kFloat32);
            const auto box = action_box(spec.action_space);
            EXPECT_TRUE(((actions - box.centre).abs() <= box.half_width).all().item<bool>());
        } else {
            ASSERT_EQ(actions.sizes(), (std::vector<std::int64_t>{count}));
            ASSERT_EQ(actions.scalar_type(), torch::kInt64);
            EXPECT_TRUE(((actions >= 0) & (actions < num_actions(spec.action_space))).all().item<bool>());
        }
        EXPECT_FALSE(actions.requires_grad());
    };
    expect_inside(4, ActMode::train);
    expect_inside(7, ActMode::evaluate);
    drive(*agent, spec, 0, 30);
    agent->update(noise_frames(4, 30));
    expect_inside(4, ActMode::train);
    expect_inside(7, ActMode::evaluate);
}

TEST_P(EveryAgent, TheSameSeedGivesTheSameBits) {
    const auto spec = world(2);
    const auto first = make(spec), second = make(spec), other = make(world(2, 5));
    drive(*first, spec, 0, 40);
    torch::rand({3});  // the global generator is nobody's
    drive(*second, spec, 0, 40);
    drive(*other, spec, 0, 40);
    EXPECT_GT(gradient_steps_of(*first), 0);
    const auto state = first->state(), other_state = other->state();
    expect_equal(state, second->state());
    for (const auto& [name, tensor] : state) {
        if (!name.starts_with("random/") && !name.ends_with("conv1.weight")) continue;
        EXPECT_FALSE(torch::equal(tensor, other_state.at(name))) << name;
    }
}

TEST_P(EveryAgent, TheSameSeedGivesTheSameBitsInBf16AndOthersThanInFloat32) {
    auto spec = world(2);
    const auto full = make(spec);
    spec.precision = Precision::bf16;
    const auto first = make(spec), second = make(spec);
    for (auto* agent : {full.get(), first.get(), second.get()}) drive(*agent, spec, 0, 40);
    const auto state = first->state(), full_state = full->state();
    expect_equal(state, second->state());
    bool differs = false;
    for (const auto& [name, tensor] : state) {
        EXPECT_EQ(tensor.scalar_type(), full_state.at(name).scalar_type()) << name;
        differs |= name.ends_with("conv1.weight") && !torch::equal(tensor, full_state.at(name));
    }
    EXPECT_TRUE(differs);
}

TEST_P(EveryAgent, EvaluationLeavesTrainingAsItIs) {
    const auto spec = world();
    const auto disturbed = make(spec), undisturbed = make(spec);
    drive(*disturbed, spec, 0, 25);
    for (int i = 0; i < 3; ++i) disturbed->act(noise_frames(7, 9), ActMode::evaluate);
    drive(*disturbed, spec, 25, 10);
    drive(*undisturbed, spec, 0, 35);
    auto first = disturbed->state(), second = undisturbed->state();
    first.erase("random/evaluation");
    second.erase("random/evaluation");
    EXPECT_GT(gradient_steps_of(*disturbed), 0);
    expect_equal(first, second);
}

void spoil(Agent& agent) {
    auto state = agent.state();
    for (auto& [name, tensor] : state)
        if (name.starts_with("network/") && name.ends_with("bias"))
            tensor = torch::full_like(tensor, std::numeric_limits<float>::quiet_NaN());
    agent.load_state(state);
}

class EveryActor : public EveryAgent {};

INSTANTIATE_TEST_SUITE_P(Table, EveryActor,
                         testing::Values(sac(), sacd(), ppo("PpoWithTheJoystick", 0),
                                         ppo("PpoWithActions", kNumActions)),
                         name_of);

TEST_P(EveryActor, SaysThatItHasDiverged) {
    const auto agent = make(world());
    spoil(*agent);
    EXPECT_THAT([&] { agent->act(noise_frames(1, 1), ActMode::evaluate); },
                ThrowsMessage<Diverged>(HasSubstr("the actor's output is not finite")));
}

class EveryCritic : public EveryAgent {};

INSTANTIATE_TEST_SUITE_P(Table, EveryCritic, testing::Values(dqn(), der(), der_factored()), name_of);

TEST_P(EveryCritic, SaysThatItHasDiverged) {
    const auto agent = make(world());
    spoil(*agent);
    EXPECT_THAT([&] { agent->act(noise_frames(1, 1), ActMode::evaluate); },
                ThrowsMessage<Diverged>(HasSubstr("an action's value is not finite")));
}

TEST(Priorities, SayThatAnAgentHasDiverged) {
    const auto spec = der().world(1, 1);
    const auto agent = der().make({}, spec);
    drive(*agent, spec, 0, 25);
    spoil(*agent);
    EXPECT_THAT([&] { drive(*agent, spec, 25, 10); },
                ThrowsMessage<Diverged>(HasSubstr("a transition's priority is not finite")));
}

TEST_P(EveryAgent, GoesOnAsTheOriginalOnceRestored) {
    Settings settings;
    settings.replay.update_horizon = 3;
    settings.epsilon.epsilon_decay_period = 50;
    const auto spec = world(2);
    // In the middle of a game and of a rollout, at an end, and right behind a truncation.
    for (const std::int64_t moment : {5, 28, 29, 34}) {
        const test::TemporaryFolder folder;
        const auto original = make(spec, settings);
        drive(*original, spec, 0, moment);
        original->act(noise_frames(2, 1), ActMode::evaluate);
        const auto state = original->state();
        if (original->replay() != nullptr) save_replay(*original->replay(), folder.path());

        const auto restored = make(world(2, 99), settings);
        drive(*restored, spec, 0, 3);
        restored->load_state(state);
        if (restored->replay() != nullptr) load_replay(*restored->replay(), folder.path());
        expect_equal(restored->state(), state);
        for (auto* agent : {original.get(), restored.get()}) drive(*agent, spec, moment, 30);
        EXPECT_FALSE(torch::equal(restored->state().at("adam/steps"), state.at("adam/steps")));
        expect_equal(restored->state(), original->state());
        EXPECT_TRUE(torch::equal(restored->act(noise_frames(2, 1), ActMode::evaluate),
                                 original->act(noise_frames(2, 1), ActMode::evaluate)));
    }
}

TEST_P(EveryAgent, GoesOnFromTheStateOfAnotherDevice) {
    const auto spec = world(2);
    // A generator's state on a CUDA device is a seed and an offset, eight bytes each.
    const auto foreign_random = [&](std::uint8_t first) {
        return spec.device.is_cpu() ? torch::arange(first, first + 16, torch::kUInt8)
                                    : random_state(make_generator(first));
    };
    const auto continued = [&](std::optional<std::uint8_t> random) {
        const auto agent = make(spec);
        drive(*agent, spec, 0, 30);
        auto state = agent->state();
        if (random && state.contains("random/update_noise"))
            state["random/update_noise"] = foreign_random(*random);
        agent->load_state(state);
        drive(*agent, spec, 30, 30);
        EXPECT_GT(gradient_steps_of(*agent), 10);
        return agent->state();
    };
    const auto own = continued({}), first = continued(240), again = continued(240), other = continued(200);
    expect_equal(first, again);
    const auto draws = own.find("random/update_noise");
    if (draws == own.end()) return expect_equal(first, own);
    for (const auto* state : {&own, &other})
        EXPECT_FALSE(torch::equal(first.at(draws->first), state->at(draws->first)));
}

TEST_P(EveryAgent, ItsStateIsACopy) {
    const auto spec = world();
    const auto agent = make(spec);
    const auto state = agent->state();
    const auto before = copy_of(state);
    drive(*agent, spec, 0, 35);
    EXPECT_GT(gradient_steps_of(*agent), 0);
    expect_equal(state, before);
}

TEST_P(EveryAgent, RefusesAStateThatDoesNotFitAndStaysAsItIs) {
    const auto agent = make(world());
    const auto own = agent->state();
    const auto expect_refused = [&](const TensorMap& state, const std::string& reason) {
        EXPECT_THAT([&] { agent->load_state(state); }, ThrowsMessage<std::runtime_error>(HasSubstr(reason)));
        expect_equal(agent->state(), own);
    };
    // Each of them would change something, were it not refused as a whole.
    Settings wider;
    wider.hidden_units = 17;
    expect_refused(make(world(1, 2), wider)->state(), "another shape");
    for (const auto& [name, tensor] : own) {
        if (!tensor.is_floating_point()) continue;
        auto doubled = make(world(1, 2))->state();
        doubled[name] = tensor.to(torch::kFloat64);
        expect_refused(doubled, "'" + name + "'");
    }
    for (const auto& [name, tensor] : own) {
        auto lacking = make(world(1, 2))->state();
        lacking.erase(name);
        expect_refused(lacking, "'" + name + "'");
    }
    auto garbled = make(world(1, 2))->state();
    garbled["random/evaluation"] = torch::zeros({4}, torch::kUInt8);
    expect_refused(garbled, "random state");
    auto fractional = make(world(1, 2))->state();
    fractional["training_steps"] = torch::tensor(1.7);
    expect_refused(fractional, "'training_steps'");
    for (const auto& other : every_agent()) {
        if (other.name == GetParam().name) continue;
        EXPECT_THROW(agent->load_state(other.make({}, other.world())->state()), std::runtime_error)
            << other.name;
    }
    expect_equal(agent->state(), own);
}

TEST_P(EveryAgent, RefusesRewardsThatAreNoNumbersAndOtherCounts) {
    const auto spec = world(2);
    const auto agent = make(spec);
    NoiseStep step(spec, 0);
    const auto actions = agent->act(step.observations, ActMode::train);
    for (const float reward :
         {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
        step.results[1].reward = reward;
        EXPECT_THAT([&] { agent->observe(step.experiences(actions)); },
                    ThrowsMessage<std::invalid_argument>(HasSubstr("the reward of environment 1")));
    }
    step.results[1].reward = 0;
    EXPECT_NO_THROW(agent->observe(step.experiences(actions)));
    agent->act(step.observations, ActMode::train);
    EXPECT_THAT([&] { agent->observe(step.experiences(actions.slice(0, 0, 1))); },
                ThrowsMessage<std::invalid_argument>(HasSubstr("actions")));
    step.results.resize(3);
    EXPECT_THAT([&] { agent->observe(step.experiences(actions)); },
                ThrowsMessage<std::invalid_argument>(AllOf(HasSubstr("2 environments"), HasSubstr("3"))));
}

TEST_P(EveryAgent, RefusesATruncationWithoutItsFinalFrames) {
    const auto spec = world(2);
    const auto agent = make(spec);
    NoiseStep step(spec, 0);
    step.results[1].truncated = step.results[1].episode_over = true;
    const auto actions = agent->act(step.observations, ActMode::train);
    auto seen = step.experiences(actions);
    for (const std::int64_t given : {std::int64_t{0}, kPixels}) {  // none, and the first environment's
        seen.final_frames = seen.final_frames.first(static_cast<std::size_t>(given));
        EXPECT_THAT([&] { agent->observe(seen); }, ThrowsMessage<std::invalid_argument>(HasSubstr("final")));
        seen.final_frames = step.experiences(actions).final_frames;
    }
    EXPECT_NO_THROW(agent->observe(seen));
}

/// More updates than a CUDA graph takes to be recorded. What an agent draws for its updates is drawn on the
/// device and differs there, so that only agents without such draws end up where they would on the CPU.
TEST_P(EveryAgent, LearnsOnACudaDeviceAsOnTheCpu) {
    if (!torch::cuda::is_available()) GTEST_SKIP() << "this machine has no CUDA device";
    const auto on_cpu = make(world(2));
    auto spec = world(2);
    spec.device = in_full_precision(torch::kCUDA);
    const auto on_cuda = make(spec);
    drive(*on_cpu, world(2), 0, 60);
    drive(*on_cuda, spec, 0, 60);
    EXPECT_EQ(gradient_steps_of(*on_cuda), gradient_steps_of(*on_cpu));
    EXPECT_GT(gradient_steps_of(*on_cuda), 10);
    for (const auto& [name, value] : on_cuda->metrics()) EXPECT_TRUE(std::isfinite(value)) << name;
    const auto expected = on_cpu->state();
    for (const auto& [name, value] : on_cuda->state()) {
        if (!name.starts_with("network/")) continue;
        EXPECT_TRUE(value.isfinite().all().item<bool>()) << name;
        if (GetParam().draws_on_the_device) continue;
        EXPECT_TRUE(torch::allclose(value, expected.at(name), 1e-2, 1e-3)) << name;
    }
}

TEST_P(EveryAgent, LogsFiniteNumbersOfItsNewestUpdate) {
    const auto spec = world();
    const auto agent = make(spec);
    const auto at_first = agent->metrics();
    for (const auto& loss : GetParam().losses) EXPECT_FALSE(at_first.contains("losses/" + loss)) << loss;
    drive(*agent, spec, 0, 35);
    const auto metrics = agent->metrics();
    for (const auto& loss : GetParam().losses) EXPECT_TRUE(metrics.contains("losses/" + loss)) << loss;
    for (const auto& [tag, value] : metrics) EXPECT_TRUE(std::isfinite(value)) << tag;
    EXPECT_GT(metrics.at("charts/learning_rate"), 0);
    const auto* const box = std::get_if<Box>(&spec.action_space);
    for (const auto& [tag, value] : metrics)
        EXPECT_TRUE(box != nullptr || !tag.starts_with("charts/mean_")) << tag;
    for (std::int64_t i = 0; i < box_size(spec.action_space); ++i) {
        const auto tag = "charts/mean_" + box->names.at(static_cast<std::size_t>(i));
        const auto limits = action_box(spec.action_space);
        ASSERT_TRUE(metrics.contains(tag)) << tag;
        EXPECT_LT(std::abs(metrics.at(tag) - limits.centre[i].item<double>()),
                  limits.half_width[i].item<double>())
            << tag;
    }
    drive(*agent, spec, 35, 8);
    const auto& loss = "losses/" + GetParam().losses.front();
    EXPECT_NE(agent->metrics().at(loss), metrics.at(loss));
    agent->load_state(agent->state());  // what was logged is not part of a state
    EXPECT_FALSE(agent->metrics().contains(loss));
}

// Agents that learn from a replay -----------------------------------------------------

class ReplayAgent : public EveryAgent {};

INSTANTIATE_TEST_SUITE_P(Table, ReplayAgent, testing::Values(sac(), dqn(), der(), sacd()), name_of);

TEST_P(ReplayAgent, RefusesTheOtherActionSpace) {
    const bool continuous = GetParam().num_actions == 0;
    const auto other = continuous ? discrete_world() : joystick_world();
    EXPECT_THAT([&] { make(other); },
                ThrowsMessage<std::invalid_argument>(
                    HasSubstr(continuous ? "numbered actions: set env.action_space to continuous"
                                         : "coordinates: set env.action_space to minimal or full")));
}

TEST_P(ReplayAgent, UpdatesOnceMoreThanMinReplayIsStoredAndEveryPeriod) {
    Settings settings;
    settings.replay.update_period = 4;
    const auto spec = world();
    const auto agent = make(spec, settings);
    EXPECT_EQ(drive(*agent, spec, 0, 21), 0);  // 21 stored: more than 20 for the first time
    EXPECT_EQ(drive(*agent, spec, 21, 3), 0);  // decisions 21, 22, 23
    EXPECT_EQ(gradient_steps_of(*agent), 0);
    EXPECT_EQ(drive(*agent, spec, 24, 1), 1);
    EXPECT_EQ(gradient_steps_of(*agent), 1);
    EXPECT_EQ(drive(*agent, spec, 25, 40), 10);
    EXPECT_EQ(gradient_steps_of(*agent), 11);
}

TEST_P(ReplayAgent, MakesItsReplayAsItsSettingsSay) {
    Settings settings;
    settings.replay.replay_capacity = 77;
    settings.replay.gamma = 0.75;
    settings.replay.update_horizon = 3;
    settings.replay.replay_terminal = ReplayTerminal::dopamine;
    const auto spec = world(2);
    const auto config = make(spec, settings)->replay()->config();
    EXPECT_EQ(config.capacity, 77);
    EXPECT_EQ(config.num_envs, 2);
    EXPECT_EQ(config.observation, spec.observation);
    EXPECT_EQ(config.action_size, GetParam().num_actions == 0 ? 3 : 0);
    EXPECT_EQ(config.gamma, 0.75);
    EXPECT_EQ(config.update_horizon, 3);
    EXPECT_EQ(config.replay_terminal, ReplayTerminal::dopamine);
    EXPECT_EQ(config.prioritised, GetParam().name == "Der");
}

TEST_P(ReplayAgent, SeveralEnvironmentsKeepTheUpdatesPerAgentStep) {
    for (const auto& [num_envs, period, expected] : {std::tuple{8, 4, 40}, {3, 4, 15}, {2, 1, 40}}) {
        Settings settings;
        settings.replay.min_replay = 0;
        settings.replay.update_period = period;
        const auto spec = world(num_envs);
        const auto agent = make(spec, settings);
        drive(*agent, spec, 0, 5);  // until something is stored
        const auto before = gradient_steps_of(*agent);
        drive(*agent, spec, 5, 20);
        EXPECT_NEAR(static_cast<double>(gradient_steps_of(*agent) - before), expected, 1)
            << num_envs << " environments";
    }
}

TEST_P(ReplayAgent, ClipsRewardsWhenItStoresThem) {
    Settings settings;
    const auto spec = world();
    const auto stored_by = [&](std::optional<double> clip) {
        settings.replay.reward_clip = clip;
        const auto agent = make(spec, settings);
        drive(*agent, spec, 0, 8);
        return memory_of(*agent).n_step_return;
    };
    // The last one's next observation is not known yet.
    EXPECT_TRUE(
        torch::equal(stored_by(std::nullopt), torch::tensor({-2.f, -1.f, 0.f, 1.f, 2.f, -2.f, -1.f})));
    EXPECT_TRUE(torch::equal(stored_by(1.5), torch::tensor({-1.5f, -1.f, 0.f, 1.f, 1.5f, -1.5f, -1.f})));
}

TEST_P(ReplayAgent, RefusesToShiftWhatIsNoImage) {
    Settings settings;
    settings.replay.random_shift = 4;
    auto spec = world();
    spec.observation.shape = {128};
    EXPECT_THAT([&] { make(spec, settings); }, ThrowsMessage<std::invalid_argument>(AllOf(
                                                   HasSubstr("agent.random_shift"), HasSubstr("env.obs"))));
}

TEST_P(ReplayAgent, KeepsWhatItSaw) {
    const Settings settings;
    const auto spec = world(2);
    const auto agent = make(spec, settings);
    drive(*agent, spec, 0, 14);
    const auto memory = memory_of(*agent);
    // Two environments end together: a terminal after seven steps, a truncation after fourteen.
    ASSERT_EQ(memory.discount.size(0), 28);
    EXPECT_EQ((memory.discount == 0).sum().item<std::int64_t>(), 2);
    const NoiseStep last(spec, 13);
    for (std::int64_t env = 0; env < 2; ++env) {
        const auto row = 25 + 2 * env;  // its last step completes two transitions
        EXPECT_TRUE(torch::equal(memory.observation[row][-1], last.frames[env]));
        EXPECT_TRUE(torch::equal(memory.next_observation[row][-1], last.final_frames[env]));
        EXPECT_FLOAT_EQ(memory.discount[row].item<float>(), 0.99f);
    }
}

TEST_P(ReplayAgent, GoesOnWithTheGameUnderWayAfterARestore) {
    const auto spec = world();
    const auto transitions_of = [&](Agent& agent) { return memory_of(agent).index.size(0); };
    const test::TemporaryFolder folder;
    const auto original = make(spec), restored = make(spec);
    drive(*original, spec, 0, 10);
    const auto before = transitions_of(*original);
    save_replay(*original->replay(), folder.path());
    load_replay(*restored->replay(), folder.path());
    drive(*restored, spec, 10, 1);
    EXPECT_EQ(transitions_of(*restored), before + 1);
}

// Agents with an actor of their own ---------------------------------------------------

class ActorCritic : public EveryAgent {
  protected:
    static Settings delayed_actor(std::int64_t period) {
        Settings settings;
        settings.actor_period = period;
        return settings;
    }
    static bool is_of_actor(const std::string& name) {
        return name.starts_with("network/actor.") || name.starts_with("network/encoder.actor_") ||
               name == "log_alpha";
    }
};

INSTANTIATE_TEST_SUITE_P(Table, ActorCritic, testing::Values(sac(), sacd()), name_of);

TEST_P(ActorCritic, StepsItsActorAtEveryThirdGradientStepAlone) {
    const auto spec = world();
    const auto agent = make(spec, delayed_actor(3));
    drive(*agent, spec, 0, 21);
    for (std::int64_t step = 21; step < 33; ++step) {
        const auto before = agent->state();
        EXPECT_EQ(drive(*agent, spec, step, 1), 1);
        const bool steps_actor = gradient_steps_of(*agent) % 3 == 0;
        const auto after = agent->state();
        for (const auto& [name, tensor] : after) {
            if (name.starts_with("target/")) {
                const auto& old = before.at(name);
                const auto towards = after.at("network/" + name.substr(std::string("target/").size()));
                EXPECT_TRUE(torch::allclose(tensor, old + SacConfig{}.tau * (towards - old), 1e-5, 1e-7))
                    << name << " follows at every gradient step";
            }
            if (!name.starts_with("network/") && name != "log_alpha") continue;
            EXPECT_EQ(torch::equal(tensor, before.at(name)), is_of_actor(name) && !steps_actor)
                << name << " at gradient step " << gradient_steps_of(*agent);
        }
        EXPECT_EQ(agent->metrics().contains("losses/actor_loss"), gradient_steps_of(*agent) >= 3);
    }
    EXPECT_EQ(agent->state().at("adam/delayed_steps").item<float>(), 4);
    EXPECT_EQ(agent->state().at("alpha_adam/steps").item<float>(), 4);
}

TEST_P(ActorCritic, ResumesInTheMiddleOfThePeriodOfItsActor) {
    const auto settings = delayed_actor(3);
    const auto spec = world();
    for (const std::int64_t moment : {25, 26, 27}) {
        const test::TemporaryFolder folder;
        const auto original = make(spec, settings), restored = make(spec, settings);
        drive(*original, spec, 0, moment);
        save_replay(*original->replay(), folder.path());
        restored->load_state(original->state());
        load_replay(*restored->replay(), folder.path());
        for (auto* agent : {original.get(), restored.get()}) drive(*agent, spec, moment, 8);
        expect_equal(restored->state(), original->state());
    }
}

TEST_P(ActorCritic, ShowsCriticsThatDivergeBetweenTheStepsOfItsActor) {
    const auto spec = world();
    const auto agent = make(spec, delayed_actor(1000));
    drive(*agent, spec, 0, 25);
    EXPECT_FALSE(agent->metrics().contains("losses/qf_loss"));
    auto state = agent->state();
    for (auto& [name, tensor] : state)
        if (name.starts_with("network/") && !is_of_actor(name))
            tensor = torch::full_like(tensor, std::numeric_limits<float>::quiet_NaN());
    agent->load_state(state);
    EXPECT_TRUE(agent->update(NoiseStep(spec, 25).observations));
    EXPECT_TRUE(std::isnan(agent->metrics().at("losses/qf_loss")));
}

TEST_P(ActorCritic, HasTheStateOfOldCheckpointsUnlessItsActorIsDelayed) {
    const auto state = make(world())->state();
    EXPECT_FALSE(state.contains("gradient_steps"));
    EXPECT_FALSE(state.contains("adam/delayed_steps"));
}

// Agents that explore epsilon-greedily ------------------------------------------------

class EpsilonGreedyAgent : public EveryAgent {
  protected:
    /// How often an action on one and the same frame is not the one that it is otherwise.
    static double part_at_random(Agent& agent, ActMode mode) {
        constexpr std::int64_t count = 2000;
        const auto actions = agent.act(same_frame(count), mode);
        if (actions.dim() == 2) {  // the greedy action is the commonest one, up to rounding
            const auto radius = actions.select(1, 0);
            const auto greedy = std::get<0>(radius.mode());
            return ((radius - greedy).abs() > 1e-4).to(torch::kFloat64).mean().item<double>();
        }
        // Uniform actions hit the greedy one too.
        const auto parts = frequencies(actions);
        return (1 - *std::max_element(parts.begin(), parts.end())) * kNumActions / (kNumActions - 1);
    }
};

INSTANTIATE_TEST_SUITE_P(Table, EpsilonGreedyAgent,
                         testing::Values(sac(), dqn(), der_without_noise(), sacd()), name_of);

TEST_P(EpsilonGreedyAgent, EpsilonIsOneUntilItIsWarmAndThenFallsLinearly) {
    Settings settings;
    settings.epsilon = {.epsilon_train = 0.1, .epsilon_decay_period = 10};
    const auto spec = world();
    const auto agent = make(spec, settings);
    const auto epsilon_after = [&](std::int64_t first, std::int64_t steps) {
        drive(*agent, spec, first, steps);
        return agent->metrics().at("charts/epsilon");
    };
    EXPECT_DOUBLE_EQ(epsilon_after(0, 0), 1);
    EXPECT_DOUBLE_EQ(epsilon_after(0, 20), 1);
    EXPECT_DOUBLE_EQ(epsilon_after(20, 5), 0.55);
    EXPECT_DOUBLE_EQ(epsilon_after(25, 5), 0.1);
    EXPECT_DOUBLE_EQ(epsilon_after(30, 5), 0.1);
}

TEST_P(EpsilonGreedyAgent, CountsTheDecisionsOfAllItsEnvironments) {
    Settings settings;
    settings.epsilon = {.epsilon_train = 0, .epsilon_decay_period = 40};
    const auto spec = world(4);
    const auto agent = make(spec, settings);
    drive(*agent, spec, 0, 10);
    EXPECT_DOUBLE_EQ(agent->metrics().at("charts/epsilon"), 0.5);
}

TEST_P(EpsilonGreedyAgent, ActsAtRandomWithProbabilityEpsilon) {
    Settings settings;
    settings.epsilon = {.epsilon_train = 0.25, .epsilon_eval = 0.5, .epsilon_decay_period = 1};
    const auto spec = world();
    const auto agent = make(spec, settings);
    drive(*agent, spec, 0, 10);
    const auto uniform = agent->act(same_frame(2000), ActMode::train);
    if (num_actions(spec.action_space) == 0)
        expect_uniform_over_the_box(uniform);
    else
        for (const double part : frequencies(uniform)) EXPECT_NEAR(part, 0.25, 0.04);
    EXPECT_NEAR(part_at_random(*agent, ActMode::evaluate), 0.5, 0.06);
    drive(*agent, spec, 10, 20);
    // An actor's own choices are random too, unless it is sure.
    auto state = agent->state();
    if (num_actions(spec.action_space) == 0)
        make_constant(state, "network/actor.out", {0, 0, 0, -20, -20, -20});
    else
        make_constant(state, "network/actor.out", {50, 0, 0, 0});
    agent->load_state(state);
    EXPECT_NEAR(part_at_random(*agent, ActMode::train), 0.25, 0.06);
}

// Agents whose target is copied now and then ------------------------------------------

class HardTarget : public EveryAgent {};

INSTANTIATE_TEST_SUITE_P(Table, HardTarget, testing::Values(dqn(), der()), name_of);

/// The tensors whose names begin with `prefix`, without it.
TensorMap part_of(const TensorMap& state, const std::string& prefix) {
    TensorMap part;
    for (const auto& [name, tensor] : state)
        if (name.starts_with(prefix)) part[name.substr(prefix.size())] = tensor;
    return part;
}

bool equal(const TensorMap& first, const TensorMap& second) {
    for (const auto& [name, tensor] : first)
        if (!torch::equal(tensor, second.at(name))) return false;
    return first.size() == second.size();
}

TEST_P(HardTarget, IsCopiedAtMultiplesOfItsPeriodOnceWarm) {
    for (const std::int64_t num_envs : {1, 4}) {
        const auto spec = world(num_envs);
        const auto agent = make(spec);
        auto state = agent->state();
        expect_equal(part_of(state, "network/"), part_of(state, "target/"));
        // A target of its own shows that nothing is copied before.
        for (const auto& [name, tensor] : part_of(state, "target/")) tensor.add_(1);
        agent->load_state(state);
        auto target = part_of(state, "target/");
        const std::int64_t warm = num_envs == 1 ? 21 : 28;  // the first decision with more than 20 stored
        for (std::int64_t step = 0; step < 60 / num_envs; ++step) {
            agent->update(NoiseStep(spec, step).observations);
            state = agent->state();
            const auto first = step * num_envs, end = first + num_envs;
            bool copied = false;  // ten decisions are a period
            for (auto decision = first; decision < end; ++decision) copied |= decision % 10 == 0;
            if (copied && first >= warm) target = part_of(state, "network/");
            EXPECT_TRUE(equal(part_of(state, "target/"), target)) << "decision " << first;
            EXPECT_EQ(equal(part_of(state, "network/"), target), copied && first >= warm)
                << "decision " << first;
            act_and_observe(*agent, spec, step);
        }
    }
}

// Agents whose target follows slowly --------------------------------------------------

TEST(EvaluationEpsilon, IsWithoutEffectWhereThePolicyExplores) {
    const auto expect_none = [](auto config, auto make, const AgentSpec& spec) {
        config.exploration = Exploration::standard;
        config.epsilon.epsilon_eval = 1;
        const auto agent = make(config, spec);
        EXPECT_EQ(agent->policy()->epsilon, 0);
        return agent->act(same_frame(200), ActMode::evaluate);
    };
    for (const auto& actions : {expect_none(small_sac(), make_sac, joystick_world()),
                                expect_none(small_sacd(), make_sacd, discrete_world())})
        EXPECT_TRUE(torch::equal(actions, actions[0].expand_as(actions)));
    expect_none(small_ppo(), make_ppo, joystick_world());
}

TEST(SoftTarget, FollowsByTauAtEveryUpdate) {
    const auto expect_following = [](auto config, auto make, const AgentSpec& spec) {
        config.tau = 0.25;
        const auto agent = make(config, spec);
        const auto start = agent->state();
        expect_equal(part_of(start, "network/"), part_of(start, "target/"));
        std::int64_t step = 0;
        while (gradient_steps_of(*agent) == 0) drive(*agent, spec, step++, 1);
        const auto state = agent->state();
        EXPECT_FALSE(equal(part_of(state, "network/"), part_of(start, "network/")));
        for (const auto& [name, before] : part_of(start, "target/")) {
            const auto expected = before + 0.25 * (state.at("network/" + name) - before);
            EXPECT_TRUE(torch::allclose(state.at("target/" + name), expected, 1e-5, 1e-7)) << name;
        }
    };
    expect_following(small_sac(), make_sac, joystick_world());
    expect_following(small_sacd(), make_sacd, discrete_world());
}

}  // namespace
}  // namespace cale
