// Soft Actor-Critic on the continuous joystick.
//   Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications" (SAC below)
//   Farebrother & Castro 2024, "CALE: Continuous Arcade Learning Environment" (CALE below)
// The pieces that CALE's agent has and the first paper has not: one convolutional trunk for
// actor and critics that only the critics train, one optimiser for both, and a target whose
// action value is taken at the target actor's mean action.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <torch/types.h>

#include "agents/agent.h"
#include "cale/fields.h"
#include "networks/adam.h"
#include "networks/encoders.h"
#include "networks/heads.h"
#include "replay/replay_buffer.h"

namespace cale {

enum class Exploration { standard, epsilon_greedy };
enum class CriticTarget { target_mean_action, sampled_action };
std::span<const std::string_view> names_of(Exploration);
std::span<const std::string_view> names_of(CriticTarget);

/// The defaults are CALE's for 200 million frames.
struct SacConfig {
    EncoderKind encoder = EncoderKind::phi_sac;
    PhiDqn phi_dqn = PhiDqn::conv2d;
    std::int64_t hidden_layers = 1;
    std::int64_t hidden_units = 512;
    double gamma = 0.99;
    std::int64_t update_horizon = 1;
    std::int64_t min_replay = 20'000;
    std::int64_t update_period = 4;
    std::int64_t replay_capacity = 1'000'000;
    std::int64_t batch_size = 32;
    double learning_rate = 6.25e-5;
    double adam_epsilon = 1.5e-4;
    double tau = 0.005;
    double target_entropy = -1.5;
    double reward_scale = 0.1;
    std::optional<double> reward_clip = std::nullopt;
    Exploration exploration = Exploration::standard;
    double epsilon_train = 0.01;
    double epsilon_eval = 0.001;
    std::int64_t epsilon_decay_period = 250'000;
    CriticTarget critic_target = CriticTarget::target_mean_action;
    ReplayTerminal replay_terminal = ReplayTerminal::corrected;
};

template <class Visit>
void fields(SacConfig& config, Visit&& visit) {
    visit("encoder", config.encoder, "how frames become features: phi_sac, phi_dqn or impala");
    visit("phi_dqn", config.phi_dqn,
          "conv2d: phi_dqn as meant; row1d: row by row, as Dopamine's CALE agents run it");
    visit("hidden_layers", config.hidden_layers, Range{0, 16},
          "hidden layers of the actor and of each critic");
    visit("hidden_units", config.hidden_units, Range{1, 65'536}, "units of a hidden layer");
    visit("gamma", config.gamma, Range{0, 1}, "discount per agent step");
    visit("update_horizon", config.update_horizon, Range{1, 1000}, "n of the n-step return");
    visit("min_replay", config.min_replay, Range{0, 1e12}, "transitions stored before the first update");
    visit("update_period", config.update_period, Range{1, 1e9}, "agent steps per update");
    visit("replay_capacity", config.replay_capacity, Range{1, 1e9}, "transitions kept in the replay");
    visit("batch_size", config.batch_size, Range{1, 65'536}, "transitions per update");
    visit("learning_rate", config.learning_rate, Range{0, 1},
          "Adam's learning rate, for the networks and for alpha");
    visit("adam_epsilon", config.adam_epsilon, Range{0, 1}, "Adam's epsilon, outside the root");
    visit("tau", config.tau, Range{0, 1},
          "part of the online network that the target takes on at every update");
    visit("target_entropy", config.target_entropy, Range{-1000, 1000},
          "entropy of the policy that alpha is adjusted for");
    visit("reward_scale", config.reward_scale, Range{0, 1e9},
          "factor of the n-step return in the critics' target");
    visit("reward_clip", config.reward_clip, Range{0, 1e9},
          "rewards are clipped to plus or minus this when stored; none: off");
    visit("exploration", config.exploration,
          "standard: the policy's own noise, uniform until the first update; epsilon_greedy: uniform with "
          "probability epsilon");
    visit("epsilon_train", config.epsilon_train, Range{0, 1}, "final epsilon in training (epsilon_greedy)");
    visit("epsilon_eval", config.epsilon_eval, Range{0, 1}, "epsilon in evaluation (epsilon_greedy)");
    visit("epsilon_decay_period", config.epsilon_decay_period, Range{1, 1e12},
          "agent steps from epsilon 1 to epsilon_train, after min_replay of them");
    visit("critic_target", config.critic_target,
          "target_mean_action: value of the target actor's mean action; sampled_action: of the online "
          "actor's sample, as in Haarnoja et al.");
    visit("replay_terminal", config.replay_terminal,
          "corrected: every transition once; dopamine: the reference's accumulator");
}

/// Encoder, actor and twin critics. Its parameters are float32 on the CPU until moved.
class SacNetworkImpl : public torch::nn::Module {
  public:
    SacNetworkImpl(const EncoderConfig& encoder_config, const HeadConfig& head_config,
                   at::Generator generator);

    /// The policy on the encoder's features [B, F]; its gradient does not reach the trunk.
    SquashedGaussian policy(const torch::Tensor& features);

    TwoBranchEncoder encoder{nullptr};
    Mlp actor{nullptr};
    TwinCritic critic{nullptr};
    ActionBox box;  // beside the parameters, as buffers

    /// What the actor's loss trains, and what the critics' loss trains: the rest.
    std::vector<torch::Tensor> actor_parameters() const;
    std::vector<torch::Tensor> critic_parameters() const;
};
using SacNetwork = torch::nn::ModuleHolder<SacNetworkImpl>;

/// Standard normal numbers of one update, [B, 3] each.
struct SacNoise {
    torch::Tensor target;  // for the action at the next state
    torch::Tensor actor;   // for the action at the state
};

/// The first three are means over the batch and carry gradients; the rest is for the log.
struct SacLosses {
    torch::Tensor critic;         // [] J_Q, without the factor 1/2
    torch::Tensor actor;          // [] J_pi
    torch::Tensor alpha;          // [] J_alpha
    torch::Tensor q1, q2;         // [B] values of the stored actions
    torch::Tensor target_values;  // [B] y
    torch::Tensor log_prob;       // [B] of the actor's own sample
};

/// A pure function of its arguments. `log_alpha` is [1]. Throws std::invalid_argument, naming
/// both shapes, where the batch or the noise do not fit together.
SacLosses sac_losses(SacNetwork& network, SacNetwork& target_network, const torch::Tensor& log_alpha,
                     const Batch& batch, const SacNoise& noise, const SacConfig& config);

/// Everything that an update changes.
struct SacLearner {
    /// `target` starts as it is given: make_sac copies the network into it.
    SacLearner(SacNetwork network, SacNetwork target, torch::Tensor log_alpha, const SacConfig& config);

    SacNetwork network, target;
    torch::Tensor log_alpha;  // [1]
    std::vector<torch::Tensor> parameters, target_parameters, actor_parameters, critic_parameters;
    Adam adam, alpha_adam;
};

/// One gradient step on every loss, then the target follows. Returns the losses before the
/// step, without their graphs; the gradients stay in the parameters until the next call.
SacLosses sac_update(SacLearner& learner, const Batch& batch, const SacNoise& noise, const SacConfig& config);

/// Tags: losses/{qf_loss, qf1_values, qf2_values, actor_loss, alpha_loss, alpha, entropy},
/// charts/{learning_rate, epsilon}.
/// State: network/<parameter>, target/<parameter>, log_alpha, adam/..., alpha_adam/...,
/// training_steps, random/....
/// With N environments the step counter grows by N per update(), and every multiple of
/// update_period that it passes is one gradient step: 1 / update_period per agent step, as with N = 1.
/// Throws std::invalid_argument for settings that no network can be built from, and for a
/// world with discrete actions.
std::unique_ptr<Agent> make_sac(const SacConfig& config, const AgentSpec& spec);

}  // namespace cale
