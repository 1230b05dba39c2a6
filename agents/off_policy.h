// The common part of every agent with a replay: filling it, the exploration schedule, updates at fixed
// intervals, saving and restoring. Losses and action selection are the algorithm's:
// agents/{sac,sacd,dqn,der}.cpp.
#pragma once

#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <string_view>

#include <ATen/core/Generator.h>
#include <c10/core/Event.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agents/agent.h"
#include "agents/captured_update.h"
#include "agents/exploration.h"
#include "agents/state.h"
#include "agents/time_split.h"
#include "cale/fields.h"
#include "replay/replay.h"

namespace cale {

/// The defaults are those of 200 million frames.
struct ReplaySettings {
    double gamma = 0.99;
    std::int64_t update_horizon = 1;
    std::int64_t min_replay = 20'000;
    std::int64_t update_period = 4;
    std::int64_t gradient_steps = 1;
    std::int64_t replay_capacity = 1'000'000;
    std::int64_t batch_size = 32;
    std::optional<double> reward_clip = std::nullopt;
    double reward_scale = 1;
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;
    bool replay_on_device = false;
    std::int64_t random_shift = 0;
};

template <class Visit>
void fields(ReplaySettings& settings, Visit&& visit) {
    visit("gamma", settings.gamma, Range{0, 1}, "discount per agent step");
    visit("update_horizon", settings.update_horizon, Range{1, 1000}, "n of the n-step return");
    visit("min_replay", settings.min_replay, Range{0, 1e12}, "transitions stored before the first update");
    visit("update_period", settings.update_period, Range{1, 1e9}, "agent steps per update");
    visit("gradient_steps", settings.gradient_steps, Range{1, 1000}, "gradient steps per update");
    visit("replay_capacity", settings.replay_capacity, Range{1, 1e9}, "transitions kept in the replay");
    visit("batch_size", settings.batch_size, Range{1, 65'536}, "transitions per gradient step");
    visit("reward_clip", settings.reward_clip, Range{1e-6, 1e9},
          "rewards are clipped to plus or minus this when stored; none: off");
    visit("reward_scale", settings.reward_scale, Range{0, 1e9},
          "factor of the n-step return in the values' target");
    visit("replay_terminal", settings.replay_terminal,
          "corrected: every transition once; dopamine: the reference's accumulator");
    visit("replay_on_device", settings.replay_on_device,
          "keep the frames in the memory of --device too, and put batches together there; 7 GB per million "
          "screens");
    visit("random_shift", settings.random_shift, Range{0, 16},
          "every sampled observation is shifted by up to this many pixels in each direction; 0: off");
}

/// Returns the replay's configuration for these settings.
ReplayConfig replay_config(const ReplaySettings& settings, const AgentSpec& spec, bool prioritised);

/// The replay of an agent, its decision counter, and the schedules that depend on the counter.
class AgentReplay {
  public:
    /// Throws as ReplayBuffer does.
    AgentReplay(const ReplaySettings& settings, const AgentSpec& spec, bool prioritised);

    /// Stores one step of every environment. Throws std::invalid_argument for other counts and for a reward
    /// that is not finite.
    void record(const StepBatch& batch);
    /// Returns whether more than min_replay transitions have been stored, so that updates may begin.
    bool ready() const;

    /// Counts the next decision of each environment.
    void advance() { decisions_ += spec_.num_envs; }
    /// Returns how many of the decisions that the newest advance() counted have a number that is a multiple
    /// of `period`. Decisions are numbered from 0 over a run.
    std::int64_t due(std::int64_t period) const;
    /// Returns epsilon for the next decision: 1 during the warm-up, then as `settings` say.
    double epsilon(const EpsilonSettings& settings) const;
    bool warms_up() const { return decisions_ <= settings_.min_replay; }  // the first decisions of a run

    /// Returns a batch on the agent's device, in the same memory every time. `index` stays on the CPU.
    Batch sample();
    /// Sets the priorities of the batch sampled last. Must be called before anything else is recorded. Throws
    /// Diverged for one that is not finite.
    void set_priorities(const Batch& batch, const torch::Tensor& priorities);

    /// Returns the seconds spent so far in the replay, and in copying its batches to the device.
    const TimeSplit& time() const { return time_; }
    /// Adds the generator and the counter. The contents are saved through buffer().
    void add_state(StateParts& parts);
    Replay& buffer() { return *buffer_; }  // what is stored

  private:
    ReplaySettings settings_;
    AgentSpec spec_;
    std::unique_ptr<Replay> buffer_;
    Batch sampled_;    // overwritten by every sample()
    Batch on_device_;  // its copy there, unless the device is the CPU
    c10::Event copied_;
    std::mt19937_64 random_;
    std::int64_t decisions_ = 0;
    TimeSplit time_;
};

/// Throws std::invalid_argument, naming both shapes, where the parts of a batch do not fit together or its
/// action has another shape than `action`.
void require_batch_shapes(std::string_view who, const Batch& batch, at::IntArrayRef action);

/// Returns the generator of an agent's initial parameters. Every call returns the same stream.
at::Generator initial_values(const AgentSpec& spec);

/// Returns a network of make_network(config, spec, generator) on the spec's device. Every call returns the
/// same parameters.
template <class Config>
auto initial_network(const Config& config, const AgentSpec& spec) {
    auto network = make_network(config, spec, initial_values(spec));
    network->to(spec.device);
    return network;
}

/// The random streams of an agent beside those of its replay and of its initial parameters.
struct RandomStreams {
    /// Seeded by the spec's seed. `draws_in_updates`: whether gradient steps draw random numbers.
    RandomStreams(const AgentSpec& spec, bool draws_in_updates);
    /// Adds random/acting, random/evaluation, and random/update_noise where updates draw.
    void add_state(StateParts& parts);

    at::Generator acting, evaluation;  // on the CPU
    at::Generator updates;             // on the agent's device; undefined where updates draw nothing
};

/// Returns the value target y for the next states' values, [B] or several for each state [B, n] (or [1, n]):
/// scaled n-step return plus discounted value.
torch::Tensor n_step_target(const Batch& batch, const torch::Tensor& next_value, double reward_scale);

/// Throws std::invalid_argument where observations that are no images are to be shifted.
void check_random_shift(const ReplaySettings& settings, const AgentSpec& spec);

/// See agents/agent.h. Throws std::invalid_argument for a world with the wrong kind of actions or of
/// observations.
template <class Config>
requires requires {
    Config::kName;
}
void check_settings(const Config& config, const AgentSpec& spec) {
    Config::kDiscrete ? require_discrete(Config::kName, spec) : require_continuous(Config::kName, spec);
    check_random_shift(config.replay, spec);
    if constexpr (requires { config.random_actions; })
        static_cast<void>(exploration_box(spec.action_space, config.random_actions));
}

/// Returns whether an agent with these settings samples by priority.
template <class Config>
bool is_prioritised(const Config& config) {
    if constexpr (requires { config.prioritised; }) return config.prioritised;
    return false;
}

/// The context in which an algorithm acts.
struct ActContext {
    bool training;  // with exploration; else as evaluations act
    bool uniform;   // in training every action is uniform: in the warm-up, or where epsilon is 1
    /// Probability of a uniform action. None where the policy explores, and in evaluations without epsilon:
    /// SAC and SAC-D then draw no number for it, DQN and DER draw as for 0.
    std::optional<double> epsilon;
    at::Generator random;  // of training or of evaluation, on the CPU
};

/// An agent that learns from a replay. `Algorithm` has
///     Algorithm(const Config&, const AgentSpec&)       networks, targets, optimisers
///     Config config                                    with replay, epsilon and learning_rate
///     Losses learn(const Batch&, at::Generator)        one gradient step; on a CUDA device recorded as a
///                                                      graph (agents/captured_update.h)
///     Tensor act(const Tensor& observations, const ActContext&)
///     map<string, double> metrics(const Losses&)
///     void add_state(StateParts&)
///     static constexpr bool kDrawsInUpdates            whether learn() uses its generator
/// and, where it has them,
///     acting_network()->acting, or network->acting     the specification that policies are exported by
///     Config::kName and kDiscrete                      a world of the other kind of actions is refused
///     config.random_actions                            the box of uniform actions: must fit the world's
///     config.sampled_evaluation, and acting_network()  whether evaluations draw their actions
///     void copy_to_target()                            every config.target_update_period decisions
///     config.prioritised                               with Losses::priorities [B]
///     double epsilon(double scheduled, bool warms_up)  epsilon in training, if not the scheduled one
///     config.exploration                               standard, also where it is the default: actions are
///                                                      drawn from the policy, without epsilon
///     Config::kSizeSettings, and make_network()        the memory that it needs is checked before it is
///                                                      made; the settings that make it smaller
///     config.actor_period                              learn() takes a third argument, false in gradient
///                                                      steps that leave the actor as it is, and its
///                                                      Losses::critic [] is what the critics minimise
/// With N environments an update() stands for N decisions, and each of them whose number is a multiple of
/// update_period is one update: 1 / update_period per agent step, as with N = 1.
template <class Algorithm>
class OffPolicy final : public Agent {
    using Config = typename Algorithm::Config;
    using Losses = typename Algorithm::Losses;
    // What an algorithm may have.
    static constexpr bool kChoosesExploration = requires(const Config& config) { config.exploration; };
    static constexpr bool kHasOwnEpsilon = requires(Algorithm & own) { own.epsilon(1.0, true); };
    static constexpr bool kCopiesToTarget = requires(Algorithm & own) { own.copy_to_target(); };
    static constexpr bool kDelaysActor = requires(const Config& config) { config.actor_period; };
    static constexpr bool kGivesPriorities = requires(const Losses& losses) { losses.priorities; };
    static constexpr bool kChoosesActingNetwork = requires(const Algorithm& own) { own.acting_network(); };
    static constexpr bool kNetworkActs = requires(const Algorithm& own) { own.network->acting; };
    static_assert(
        !requires(const Config& config) { config.prioritised; } || kGivesPriorities,
        "config.prioritised needs Losses::priorities");
    static_assert(
        !requires(const Config& config) { config.target_update_period; } || kCopiesToTarget,
        "config.target_update_period needs copy_to_target()");
    static_assert(!kDelaysActor || !kGivesPriorities, "a step without the actor gives no priorities");

  public:
    /// Throws as the algorithm and AgentReplay do.
    OffPolicy(const Config& config, const AgentSpec& spec)
        : spec_(spec),
          algorithm_(config, spec),
          replay_(config.replay, spec, is_prioritised(config)),
          random_(spec, Algorithm::kDrawsInUpdates || config.replay.random_shift > 0),
          gradient_step_(spec.device, random_.updates),
          critics_step_(spec.device, random_.updates) {}

    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool training = mode == ActMode::train;
        const auto epsilon = training ? exploration_epsilon() : evaluation_epsilon();
        return algorithm_.act(observations.to(spec_.device),
                              {.training = training,
                               .uniform = training && (epsilon ? *epsilon >= 1 : !replay_.ready()),
                               .epsilon = epsilon,
                               .random = training ? random_.acting : random_.evaluation});
    }

    void observe(const StepBatch& batch) override { replay_.record(batch); }

    bool update(const torch::Tensor&) override {
        const auto& config = algorithm_.config;
        replay_.advance();
        if (!replay_.ready()) return false;
        const auto gradient_steps = replay_.due(config.replay.update_period) * config.replay.gradient_steps;
        for (std::int64_t i = 0; i < gradient_steps; ++i) learn();
        if constexpr (kCopiesToTarget)
            if (replay_.due(config.target_update_period) > 0) algorithm_.copy_to_target();
        return gradient_steps > 0;
    }

    TimeSplit memory_time() const override { return replay_.time(); }

    std::map<std::string, double> metrics() override {
        auto values = newest_ ? algorithm_.metrics(*newest_) : std::map<std::string, double>{};
        // Critics that diverge in a step without the actor must not go into a checkpoint that is written
        // before the next decision.
        if (critics_loss_.defined()) {
            const auto loss = critics_loss_.item<double>();
            if (!std::isfinite(loss)) values["losses/qf_loss"] = loss;
        }
        values["charts/learning_rate"] = algorithm_.config.learning_rate;
        if (const auto epsilon = exploration_epsilon()) values["charts/epsilon"] = *epsilon;
        return values;
    }

    TensorMap state() override { return saved(parts()); }
    void load_state(const TensorMap& state) override {
        restore(parts(), state);
        newest_.reset();
        critics_loss_.reset();
        gradient_step_.forget();
        critics_step_.forget();
    }
    std::optional<AgentPolicy> policy() const override {
        const double epsilon = evaluation_epsilon().value_or(0);
        if constexpr (kChoosesActingNetwork)
            return policy_of(algorithm_.acting_network(), algorithm_.config.sampled_evaluation, epsilon);
        else if constexpr (kNetworkActs)
            return policy_of(algorithm_.network, is_noisy(algorithm_.network->acting), epsilon);
        return std::nullopt;
    }
    Replay* replay() override { return &replay_.buffer(); }

  private:
    /// Whether actions in training are drawn from the policy, without epsilon. Not by noisy weights: there
    /// epsilon is 0.
    bool policy_explores() const {
        if constexpr (kChoosesExploration) return algorithm_.config.exploration == Exploration::standard;
        return false;
    }

    /// None where the policy explores.
    std::optional<double> exploration_epsilon() const {
        if (policy_explores()) return std::nullopt;
        const double scheduled = replay_.epsilon(algorithm_.config.epsilon);
        if constexpr (kHasOwnEpsilon) return algorithm_.epsilon(scheduled, replay_.warms_up());
        return scheduled;
    }

    /// None where the policy explores, and where it is 0.
    std::optional<double> evaluation_epsilon() const {
        const double epsilon = algorithm_.config.epsilon.epsilon_eval;
        return policy_explores() || epsilon == 0 ? std::nullopt : std::optional(epsilon);
    }

    /// The batch as an algorithm sees it.
    Batch augmented(const Batch& batch) const {
        const auto pad = algorithm_.config.replay.random_shift;
        return pad > 0 ? randomly_shifted(batch, pad, random_.updates) : batch;
    }

    void learn() {
        const Batch batch = replay_.sample();
        ++gradient_steps_;
        if constexpr (kDelaysActor) {
            if (gradient_steps_ % algorithm_.config.actor_period != 0) {
                critics_step_([&] {
                    critics_loss_ =
                        algorithm_.learn(augmented(batch), random_.updates, /*with_actor=*/false).critic;
                });
                return;
            }
        }
        gradient_step_([&] { newest_ = algorithm_.learn(augmented(batch), random_.updates); });
        if constexpr (kGivesPriorities)
            if (is_prioritised(algorithm_.config)) replay_.set_priorities(batch, newest_->priorities);
    }

    StateParts parts() {
        StateParts parts;
        algorithm_.add_state(parts);
        random_.add_state(parts);
        replay_.add_state(parts);
        if constexpr (kDelaysActor)
            if (algorithm_.config.actor_period > 1) parts.counters["gradient_steps"] = &gradient_steps_;
        return parts;
    }

    AgentSpec spec_;
    Algorithm algorithm_;
    AgentReplay replay_;
    RandomStreams random_;
    CapturedUpdate gradient_step_, critics_step_;  // all losses; the critics', between the actor's
    std::int64_t gradient_steps_ = 0;              // saved where the actor is delayed
    std::optional<Losses> newest_;                 // of the newest gradient step with the actor
    torch::Tensor critics_loss_;                   // [] of the newest one without, where the actor is delayed
};

/// Returns the agent for `Algorithm`. Throws as check_settings() and its constructor do.
template <class Algorithm>
std::unique_ptr<Agent> off_policy(const typename Algorithm::Config& config, const AgentSpec& spec) {
    if constexpr (requires { check_settings(config, spec); }) check_settings(config, spec);
    return std::make_unique<OffPolicy<Algorithm>>(config, spec);
}

}  // namespace cale
