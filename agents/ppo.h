// Proximal policy optimisation, on the continuous joystick or on a game's own set of actions.
//   Schulman et al. 2017, "Proximal Policy Optimization Algorithms" (PPO below)
//   Farebrother & Castro 2024, "CALE: Continuous Arcade Learning Environment": its two-branch encoder
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
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

/// How an epoch is dealt out: see PpoConfig::minibatches.
enum class Minibatches { shuffled, contiguous };
/// What is seen after an update: see PpoConfig::stack_after_update.
enum class StackAfterUpdate { correct, repeated };
std::span<const std::string_view> names_of(Minibatches);
std::span<const std::string_view> names_of(StackAfterUpdate);

/// The defaults are CALE's for 200 million frames.
struct PpoConfig {
    static constexpr ActionSet kActionSet = ActionSet::continuous;
    static constexpr bool kSeveralProcesses = true;  // see train/program.h

    NetworkSettings network{.hidden_layers = 2, .hidden_units = 64};
    Torso torso = Torso::two_branch;
    LogStd log_std = LogStd::summed;
    double gamma = 0.99;
    double gae_lambda = 0.95;
    std::int64_t rollout_steps = 1024;
    std::int64_t minibatch_size = 256;
    Minibatches minibatches = Minibatches::shuffled;
    std::int64_t epochs = 3;
    double clip = 0.1;
    bool clip_value_loss = true;
    double value_coefficient = 0.5;
    double entropy_coefficient = 0.01;
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
void fields(PpoConfig& config, Visit&& visit) {
    fields(config.network, visit);
    visit("torso", config.torso,
          "two_branch: CALE's, trained by the value only; shared: unpadded, 512 features that both losses "
          "train");
    visit("log_std", config.log_std,
          "summed: 1 + hidden_units parameters per coordinate, as released; direct: one");
    visit("gamma", config.gamma, Range{0, 1}, "discount per agent step");
    visit("gae_lambda", config.gae_lambda, Range{0, 1}, "lambda of the advantage estimate");
    visit("rollout_steps", config.rollout_steps, Range{1, 1e7},
          "agent steps per update, over all environments: a multiple of num_envs and of minibatch_size");
    visit("minibatch_size", config.minibatch_size, Range{2, 1e7}, "agent steps per gradient step");
    visit("minibatches", config.minibatches,
          "shuffled: drawn anew in every epoch; contiguous: stretches of time, in one random order");
    visit("epochs", config.epochs, Range{1, 1000}, "passes over a rollout");
    visit("clip", config.clip, Range{0, 10}, "how far a probability ratio counts, and a value may move");
    visit("clip_value_loss", config.clip_value_loss, "clip the value's change too");
    visit("value_coefficient", config.value_coefficient, Range{0, 1000}, "weight of the value's loss");
    visit("entropy_coefficient", config.entropy_coefficient, Range{0, 1000}, "weight of the entropy bonus");
    visit("max_gradient_norm", config.max_gradient_norm, Range{1e-9, 1e9}, "gradients are scaled down to it");
    visit("learning_rate", config.learning_rate, Range{0, 1}, "Adam's learning rate at the start");
    visit("anneal_learning_rate", config.anneal_learning_rate, "let it fall linearly to 0");
    visit("anneal_steps", config.anneal_steps, Range{0, 1e12},
          "gradient steps until it is 0 (and stays so); 0: the whole run");
    visit("adam_epsilon", config.adam_epsilon, Range{0, 1}, "Adam's epsilon, outside the root");
    visit("reward_scale", config.reward_scale, Range{0, 1e9}, "factor of every reward");
    visit("reward_clip", config.reward_clip, Range{0, 1e9},
          "rewards are clipped to plus or minus this; none: off");
    visit(
        "replay_terminal", config.replay_terminal,
        "corrected: every step of an episode once; dopamine: the reference's accumulator (one environment)");
    visit("stack_after_update", config.stack_after_update,
          "correct; repeated: the frame before is seen again after an update, as released (one environment)");
    visit("exploration", config.exploration,
          "standard: the policy's own noise; epsilon_greedy: uniform with probability epsilon");
    fields(config.epsilon, visit);
}

/// B steps of a rollout; the second line [B] is from before the update.
struct PpoMinibatch {
    torch::Tensor observation, action;      // what was seen and done
    torch::Tensor old_log_prob, old_value;  // of the actions; of the states
    torch::Tensor advantage, returns;       // GAE; advantage + value
};

/// The first carries a gradient. Means over the minibatch; of several processes' minibatches together, this
/// one's parts of the means, which add up to them.
struct PpoLosses {
    torch::Tensor combined, actor, critic, entropy;  // [] each: what is minimised, and its three parts
    torch::Tensor approximate_kl, clipped_fraction;  // [] each, for the log
};

/// A pure function of its arguments, among them what the other processes give at the same time: their parts
/// of the minibatch. Throws std::invalid_argument, naming both shapes, where the minibatch does not fit
/// together.
PpoLosses ppo_losses(PpoNetwork& network, const PpoMinibatch& minibatch, const PpoConfig& config,
                     const ProcessGroup& processes = {});

/// What PPO updates: the network, its optimiser and the learning rate.
struct PpoLearner {
    /// `anneal_steps` 0: the learning rate is constant.
    PpoLearner(PpoNetwork network, std::int64_t anneal_steps, const PpoConfig& config);

    /// Counts a gradient step and sets the learning rate that it has.
    void anneal(const PpoConfig& config);

    PpoNetwork network;                     // acts too
    std::vector<torch::Tensor> parameters;  // the network's
    Adam adam;                              // their optimiser
    std::int64_t anneal_steps;              // gradient steps until the learning rate is 0; 0: it is constant
    std::int64_t gradient_steps = 0;        // made so far
};

/// One gradient step at the present learning rate, the same in all processes. Returns the losses before it,
/// without their graph.
PpoLosses ppo_gradient_step(PpoLearner& learner, const PpoMinibatch& minibatch, const PpoConfig& config,
                            const ProcessGroup& processes = {});
/// The same at the learning rate that is due.
PpoLosses ppo_update(PpoLearner& learner, const PpoMinibatch& minibatch, const PpoConfig& config);

/// Tags: losses/{loss, policy_loss, value_loss, entropy, approx_kl, clipfrac, explained_variance},
/// charts/{learning_rate, epsilon, mean_radius, mean_theta, mean_fire}.
/// State: network/<parameter>, adam/..., training_steps, gradient_steps, random/..., rollout/...,
/// repeated_frame/....
/// Several processes do together what one would do with all their environments: they draw the same random
/// numbers, each uses those of its environments, and the sums of their gradients are applied everywhere.
/// Throws as check_settings() does.
std::unique_ptr<Agent> make_ppo(const PpoConfig& config, const AgentSpec& spec);
/// See AgentSpec. Throws std::invalid_argument where rollout_steps is no multiple of the number of
/// environments, of all processes, or of minibatch_size; for several environments with an option that is for
/// one; and where environments are to step while it learns.
void check_settings(const PpoConfig& config, const AgentSpec& spec);
/// See AgentSpec: the learning rate's, unless anneal_steps are given.
std::string_view schedule_over_run(const PpoConfig& config);

/// Throws std::runtime_error, naming what is too large and the settings to lower, unless such an agent fits
/// into `available` bytes (see available_memory) once its memory is full.
void check_memory(const PpoConfig& config, const AgentSpec& spec, std::int64_t available);

}  // namespace cale
