// The common part of every on-policy agent: filling a rollout, acting, learning from the rollout in
// minibatches, saving and restoring. The losses are the algorithm's: agents/ppo.cpp.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <torch/types.h>

#include "agents/agent.h"
#include "agents/exploration.h"
#include "agents/network_settings.h"
#include "cale/fields.h"
#include "networks/adam.h"
#include "networks/ppo_network.h"
#include "replay/rollout.h"

namespace cale {

/// How an epoch is divided: see OnPolicySettings::minibatches.
enum class Minibatches { shuffled, contiguous };
/// The observation after an update: see OnPolicySettings::stack_after_update.
enum class StackAfterUpdate { correct, repeated };
std::span<const std::string_view> names_of(Minibatches);
std::span<const std::string_view> names_of(StackAfterUpdate);

/// The defaults are CALE's for 200 million frames.
struct OnPolicySettings {
    static constexpr bool kSeveralProcesses = true, kLearnsBeside = true;  // see train/program.h

    NetworkSettings network{.hidden_layers = 2, .hidden_units = 64};
    Torso torso = Torso::two_branch;
    LogStd log_std = LogStd::summed;
    double gamma = 0.99;
    double gae_lambda = 0.95;
    std::int64_t rollout_steps = 1024;
    std::int64_t minibatch_size = 256;
    Minibatches minibatches = Minibatches::shuffled;
    std::int64_t epochs = 3;
    double max_gradient_norm = 0.5;
    double learning_rate = 2.5e-4;
    bool anneal_learning_rate = true;
    std::int64_t anneal_steps = 0;
    double adam_epsilon = 1e-5;
    double reward_scale = 1;
    std::optional<double> reward_clip = std::nullopt;
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;
    StackAfterUpdate stack_after_update = StackAfterUpdate::correct;
    Exploration exploration = Exploration::standard;
    EpsilonSettings epsilon;
};

template <class Visit>
void fields(OnPolicySettings& settings, Visit&& visit) {
    fields(settings.network, visit);
    visit("torso", settings.torso,
          "two_branch: CALE's, trained by the value only; shared: 512 features that both losses train, "
          "unpadded but for impala and row1d");
    visit("log_std", settings.log_std,
          "of a box: summed: 1 + hidden_units parameters per coordinate (without hidden layers 1 + the "
          "features), as released; direct: one");
    visit("gamma", settings.gamma, Range{0, 1}, "discount per agent step");
    visit("gae_lambda", settings.gae_lambda, Range{0, 1}, "lambda of the advantage estimate");
    visit("rollout_steps", settings.rollout_steps, Range{1, 1e7},
          "agent steps per update, over all environments: a multiple of num_envs and of minibatch_size");
    visit("minibatch_size", settings.minibatch_size, Range{2, 1e7}, "agent steps per gradient step");
    visit("minibatches", settings.minibatches,
          "shuffled: in another order in every epoch; contiguous: stretches of time, in one random order");
    visit("epochs", settings.epochs, Range{1, 1000}, "passes over a rollout");
    visit("max_gradient_norm", settings.max_gradient_norm, Range{1e-9, 1e9},
          "gradients of a larger norm are scaled down to this one");
    visit("learning_rate", settings.learning_rate, Range{0, 1}, "Adam's learning rate at the start");
    visit("anneal_learning_rate", settings.anneal_learning_rate, "let it fall linearly to 0");
    visit("anneal_steps", settings.anneal_steps, Range{0, 1e12},
          "where annealed: gradient steps until it is 0 (and stays so); 0: the whole run");
    visit("adam_epsilon", settings.adam_epsilon, Range{1e-12, 1}, "Adam's epsilon, outside the root");
    visit("reward_scale", settings.reward_scale, Range{0, 1e9}, "factor of every reward");
    visit("reward_clip", settings.reward_clip, Range{1e-6, 1e9},
          "rewards are clipped to plus or minus this; none: off");
    visit(
        "replay_terminal", settings.replay_terminal,
        "corrected: every step of an episode once; dopamine: the reference's accumulator (one environment)");
    visit("stack_after_update", settings.stack_after_update,
          "correct; repeated: the frame before is seen again after an update, as released (one environment)");
    visit("exploration", settings.exploration,
          "standard: the policy's own noise; epsilon_greedy: uniform with probability epsilon");
    fields(settings.epsilon, visit);
}

/// Returns the network of an agent; without values for no_values().
PpoNetwork make_network(const OnPolicySettings& settings, const AgentSpec& spec,
                        const at::Generator& generator);

/// B steps of a rollout.
struct RolloutBatch {
    torch::Tensor observation;      // [B, stack, ...] uint8
    torch::Tensor action;           // [B, A] float32, or [B] int64
    torch::Tensor old_log_prob;     // [B] of the actions, before the update
    torch::Tensor old_value;        // [B] of the observations, before the update
    torch::Tensor advantage;        // [B] by GAE
    torch::Tensor returns;          // [B] advantage + old_value
    torch::Tensor importance = {};  // [B], or undefined: 1; see on_policy()
    std::int64_t global_size = 0;   // the divisor of means: the B of all processes together
};

/// Returns the batch with its advantages normalised over those of all processes, then times their importance,
/// and with their global_size. Null: a single process.
RolloutBatch normalized(RolloutBatch batch, const ProcessGroup* processes = nullptr);

/// The state that a gradient step changes: policy, value, their optimiser, and its learning rate.
struct OnPolicyState {
    /// `annealed_over`: gradient steps in which the learning rate falls to 0; 0: it is constant.
    OnPolicyState(PpoNetwork network, std::int64_t annealed_over, const OnPolicySettings& settings);

    /// Sets the learning rate of a gradient step, which is numbered from 0.
    void anneal(std::int64_t gradient_step);
    /// Makes one gradient step on `loss` [] and detaches it. With several processes, steps along the sum of
    /// their gradients.
    void step(torch::Tensor& loss, const ProcessGroup* processes = nullptr);

    PpoNetwork network;                              // also acts
    std::vector<torch::Tensor> parameters;           // the network's
    Adam adam;                                       // their optimiser
    double learning_rate;                            // at the start
    double max_gradient_norm;                        // gradients are scaled down to it
    std::int64_t annealed_over, gradient_steps = 0;  // gradient_steps: made so far
};

/// The losses of a batch as prepared by normalized(), [] each: the first carries a gradient and is minimised.
using OnPolicyLosses = std::function<std::vector<torch::Tensor>(PpoNetwork&, const RolloutBatch&)>;

/// Returns the agent that minimises these losses, whose means over an update are logged as losses/<name>.
/// Tags beside them: losses/explained_variance, charts/{learning_rate, epsilon, mean_<coordinate>,
/// mean_log_std}.
/// State: network/<parameter>, adam/..., training_steps, gradient_steps, random/..., rollout/...,
/// repeated_frame/..., and with AgentSpec::overlap acting/<parameter>.
/// With AgentSpec::overlap it learns from a rollout on a thread of its own while the next one is filled, and
/// acts meanwhile with the parameters from before. An action's old log-probability is then the newest
/// policy's, and its importance the ratio of that policy's probability to the probability under the policy
/// that acted (the decoupled objective of Hilton et al. 2022, "Batch size-invariance for policy
/// optimization"). What it computes does not depend on how long either takes. Several processes together are
/// equivalent to one with all their environments: all draw the same random numbers, each uses those of its
/// environments, and every process applies the sum of the gradients. Throws as check_settings() does.
std::unique_ptr<Agent> on_policy(const OnPolicySettings& settings, const AgentSpec& spec,
                                 OnPolicyLosses losses, const std::vector<std::string>& names);

/// See agents/agent.h. Throws std::invalid_argument where rollout_steps is no multiple of the number of
/// environments, of all processes, or of minibatch_size; for several environments with an option that
/// requires one; and for several processes whose environments step during updates.
void check_settings(const OnPolicySettings& settings, const AgentSpec& spec);
/// See agents/agent.h: the learning rate's schedule, unless anneal_steps is set.
std::string_view schedule_over_run(const OnPolicySettings& settings);

}  // namespace cale
