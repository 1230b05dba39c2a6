// What SAC and SAC-D have in common: their settings, and what a gradient step changes.
#pragma once

#include <cmath>
#include <concepts>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <torch/types.h>

#include "agents/exploration.h"
#include "agents/network_settings.h"
#include "agents/off_policy.h"
#include "agents/state.h"
#include "cale/fields.h"
#include "networks/actor_critic.h"
#include "networks/adam.h"
#include "networks/layers.h"

namespace cale {

/// The defaults are CALE's for 200 million frames.
struct ActorCriticSettings {
    static constexpr const char* kSizeSettings = "agent.hidden_units or agent.hidden_layers";

    NetworkSettings network;
    ReplaySettings replay{.reward_scale = 0.1};
    Exploration exploration = Exploration::standard;
    EpsilonSettings epsilon;
    double learning_rate = 6.25e-5;
    double adam_epsilon = 1.5e-4;
    double tau = 0.005;
    std::int64_t actor_period = 1;
    double weight_decay = 0;
    double initial_alpha = 1;
    std::optional<double> alpha_learning_rate = std::nullopt;
    bool entropy_in_target = true;
    TwinEstimate twin_estimate = TwinEstimate::minimum;
    bool act_with_target = false, sampled_evaluation = false, zero_outputs = false;

    /// Returns the configuration of the actor and of every critic.
    HeadConfig head() const {
        auto config = network.head();
        if (zero_outputs) config.initialise_out = zeros();
        return config;
    }
};

template <class Visit>
void fields(ActorCriticSettings& settings, Visit&& visit) {
    fields(settings.network, visit);
    fields(settings.replay, visit);
    visit(
        "exploration", settings.exploration,
        "standard: actions are sampled from the policy, uniformly until more than min_replay transitions are "
        "stored; epsilon_greedy: uniform with probability epsilon");
    fields(settings.epsilon, visit);
    visit("learning_rate", settings.learning_rate, Range{0, 1},
          "Adam's learning rate, for the networks and, without alpha_learning_rate, for alpha");
    visit("adam_epsilon", settings.adam_epsilon, Range{1e-12, 1}, "Adam's epsilon, outside the root");
    visit("tau", settings.tau, Range{0, 1},
          "part of the way that the target moves towards the online network at every gradient step");
    visit("actor_period", settings.actor_period, Range{1, 1'000'000},
          "gradient steps of the critics for each one of the actor and of alpha");
    visit("weight_decay", settings.weight_decay, Range{0, 1},
          "AdamW's weight decay, of the networks; 0: Adam");
    visit("initial_alpha", settings.initial_alpha, Range{1e-9, 1e9}, "alpha before the first gradient step");
    visit("alpha_learning_rate", settings.alpha_learning_rate, Range{0, 1},
          "alpha's own learning rate, 0: alpha stays as it is; none: learning_rate");
    visit("entropy_in_target", settings.entropy_in_target,
          "the critics' target has the policy's entropy bonus; off: only the actor's loss has it");
    visit("twin_estimate", settings.twin_estimate, "of two critics: their minimum, or their mean");
    visit("act_with_target", settings.act_with_target,
          "whether the target's actor chooses the actions instead of the one that learns");
    visit("sampled_evaluation", settings.sampled_evaluation, "evaluations draw their actions, too");
    visit("zero_outputs", settings.zero_outputs,
          "the last layers start at zero: values at 0, a box's mean action in its middle, events alike");
}

/// An actor-critic network, its target, the temperature, and their optimisers.
/// `Network`: SacNetwork or SacdNetwork.
template <class Network>
struct ActorCriticState {
    /// `log_alpha` [1] requires a gradient. The target is used as given. Where alpha's optimiser has no
    /// configuration of its own, it is like the networks', weight decay included.
    ActorCriticState(Network online, Network target_network, torch::Tensor initial_log_alpha,
                     const AdamConfig& adam_config,
                     const std::optional<AdamConfig>& alpha_adam_config = std::nullopt)
        : network(std::move(online)),
          target(std::move(target_network)),
          log_alpha(std::move(initial_log_alpha)),
          parameters(network->parameters()),
          target_parameters(target->parameters()),
          actor(actor_parameters(*network)),
          critic(critic_parameters(*network)),
          adam(parameters, adam_config),
          alpha_adam({log_alpha}, alpha_adam_config.value_or(adam_config)) {}

    /// A network of initial_network() and an equal target.
    template <std::derived_from<ActorCriticSettings> Config>
    ActorCriticState(const Config& settings, const AgentSpec& spec)
        : ActorCriticState(
              initial_network(settings, spec), initial_network(settings, spec),
              torch::full({1}, std::log(settings.initial_alpha),
                          torch::dtype(torch::kFloat32).device(spec.device))
                  .requires_grad_(),
              {.learning_rate = settings.learning_rate,
               .epsilon = settings.adam_epsilon,
               .weight_decay = settings.weight_decay},
              AdamConfig{.learning_rate = settings.alpha_learning_rate.value_or(settings.learning_rate),
                         .epsilon = settings.adam_epsilon}) {
        if (settings.actor_period > 1) adam.delay(actor);
        acts_with_target = settings.act_with_target;
    }

    /// One gradient step on `losses`: critic_loss(), which is twice J_Q, J_pi and J_alpha, [] each; then the
    /// target moves by `tau`. Where J_pi and J_alpha are undefined, only the critics are updated: see
    /// Adam::delay(). Detaches the losses from their graphs. The gradients stay in the parameters until the
    /// next call.
    template <class Losses>
    void step(Losses& losses, double tau) {
        adam.zero_grad();
        alpha_adam.zero_grad();
        // The lists restrict each gradient: the actor's loss does not change the critics.
        (0.5 * losses.critic).backward({}, /*keep_graph=*/false, /*create_graph=*/false, critic);
        const bool with_actor = losses.actor.defined();
        if (with_actor) {
            losses.actor.backward({}, /*keep_graph=*/false, /*create_graph=*/false, actor);
            losses.alpha.backward({}, /*keep_graph=*/false, /*create_graph=*/false, {{log_alpha}});
        }
        adam.step(with_actor);
        if (with_actor) alpha_adam.step();
        soft_update(target_parameters, parameters, tau);
        for (auto* loss : {&losses.critic, &losses.actor, &losses.alpha})
            if (loss->defined()) *loss = loss->detach();
    }

    /// Adds network/, target/, adam/, alpha_adam/ and log_alpha.
    void add_state(StateParts& parts) {
        parts.add("network/", *network);
        parts.add("target/", *target);
        parts.add("adam/", adam.state());
        parts.add("alpha_adam/", alpha_adam.state());
        parts.tensors["log_alpha"] = log_alpha.detach();
    }

    /// losses/{qf_loss, qf1_values, qf2_values, target_values, actor_loss, alpha_loss, entropy, alpha} and,
    /// unless actor_period delays the actor, charts/{critic_gradient_norm, actor_gradient_norm}.
    template <class Losses>
    std::map<std::string, double> metrics(const Losses& losses) const {
        const auto mean = [](const torch::Tensor& x) { return x.mean().template item<double>(); };
        std::map<std::string, double> values{
            {"losses/qf_loss", mean(losses.critic)},   {"losses/qf1_values", mean(losses.q1)},
            {"losses/qf2_values", mean(losses.q2)},    {"losses/target_values", mean(losses.target_values)},
            {"losses/actor_loss", mean(losses.actor)}, {"losses/alpha_loss", mean(losses.alpha)},
            {"losses/entropy", mean(losses.entropy)},  {"losses/alpha", std::exp(mean(log_alpha.detach()))}};
        if (adam.delays()) return values;  // the losses may be older than the gradients
        if (const auto norm = gradient_norm(critic)) values["charts/critic_gradient_norm"] = *norm;
        if (const auto norm = gradient_norm(actor)) values["charts/actor_gradient_norm"] = *norm;
        return values;
    }

    /// Returns the network that chooses actions.
    Network acting_network() const { return acts_with_target ? target : network; }

    Network network, target;                                   // online; target (values next states)
    bool acts_with_target = false;                             // see acting_network()
    torch::Tensor log_alpha;                                   // [1] of the temperature
    std::vector<torch::Tensor> parameters, target_parameters;  // of the network, of the target
    std::vector<torch::Tensor> actor, critic;                  // the network's, as the losses train them
    Adam adam, alpha_adam;                                     // of the network, of log_alpha
};

}  // namespace cale
