#include "agents/sacd.h"

#include <cmath>

#include <torch/types.h>
#include <torch/utils.h>

#include "networks/discrete_actions.h"
#include "networks/layers.h"

namespace cale {

std::span<const std::string_view> names_of(NextPolicy) {
    static constexpr std::string_view names[] = {"online", "target"};
    return names;
}

// Losses ------------------------------------------------------------------------------

namespace {

/// y with SAC-D's equation 10 for what follows: an expectation over the actions.
torch::Tensor target_values(SacdNetwork& network, SacdNetwork& target, const torch::Tensor& alpha,
                            const Batch& batch, const SacdConfig& config) {
    const torch::NoGradGuard no_grad;
    const auto features = target->encoder->trunk(batch.next_observation);
    const auto log_pi = config.next_policy == NextPolicy::target
                            ? target->log_policy(features)
                            : network->log_policy(network->encoder->trunk(batch.next_observation));
    const auto q = target->critic(target->encoder->critic_branch(features)).estimate(config.twin_estimate);
    const auto soft_value = (log_pi.exp() * (config.entropy_in_target ? q - alpha * log_pi : q)).sum(1);
    return n_step_target(batch, soft_value, config.replay.reward_scale);
}

}  // namespace

SacdLosses sacd_losses(SacdNetwork& network, SacdNetwork& target_network, const torch::Tensor& log_alpha,
                       const Batch& batch, double target_entropy, const SacdConfig& config, bool with_actor) {
    require_shape("sacd_losses", "log_alpha", log_alpha, {1});
    require_batch_shapes("sacd_losses", batch, {batch.observation.size(0)});

    const auto alpha = log_alpha.detach().exp();
    const auto y = target_values(network, target_network, alpha, batch, config);

    // Critics, SAC's equation 5 for values of every action.
    const auto features = network->encoder->trunk(batch.observation);
    const auto values = network->critic(network->encoder->critic_branch(features));
    const auto q1 = gather_actions(values.q1, batch.action), q2 = gather_actions(values.q2, batch.action);
    SacdLosses losses{.critic = ((q1 - y).square() + (q2 - y).square()).mean(),
                      .q1 = q1.detach(),
                      .q2 = q2.detach(),
                      .target_values = y};
    if (!with_actor) return losses;

    // Actor, SAC-D's equation 12: a sum over the actions, not their mean.
    const auto log_pi = network->log_policy(features);
    const auto pi = log_pi.exp();
    losses.actor = (pi * (alpha * log_pi - values.estimate(config.twin_estimate).detach())).sum(1).mean();

    // Temperature, SAC-D's equation 11, with log alpha in alpha's place as in SAC's code.
    losses.entropy = -(pi * log_pi).sum(1).detach();
    losses.alpha = (log_alpha * (losses.entropy - target_entropy)).mean();
    return losses;
}

SacdLosses sacd_update(ActorCriticState<SacdNetwork>& state, const Batch& batch, double target_entropy,
                       const SacdConfig& config, bool with_actor) {
    auto losses =
        sacd_losses(state.network, state.target, state.log_alpha, batch, target_entropy, config, with_actor);
    state.step(losses, config.tau);
    return losses;
}

// Agent -------------------------------------------------------------------------------

SacdNetwork make_network(const SacdConfig& config, const AgentSpec& spec, const at::Generator& generator) {
    return SacdNetwork(config.network.encoder_for(spec), config.head(), num_actions(spec.action_space),
                       generator);
}

namespace {

struct Sacd : ActorCriticState<SacdNetwork> {
    using Config = SacdConfig;
    using Losses = SacdLosses;
    static constexpr bool kDrawsInUpdates = false;

    Sacd(const SacdConfig& settings, const AgentSpec& spec)
        : ActorCriticState(settings, spec),
          config(settings),
          num_actions(cale::num_actions(spec.action_space)),
          target_entropy(settings.target_entropy_scale * std::log(static_cast<double>(num_actions))) {}

    torch::Tensor act(const torch::Tensor& observations, const ActContext& context) {
        if (context.uniform)
            return torch::randint(0, num_actions, {observations.size(0)}, context.random, torch::kInt64);
        const auto log_pi = acting_network()->log_policy(acting_network()->encoder->trunk(observations));
        require_finite(log_pi);
        auto actions =
            context.training || config.sampled_evaluation
                ? log_pi.exp().cpu().multinomial(1, /*replacement=*/true, context.random).squeeze(1)
                : log_pi.argmax(1).cpu();
        if (!context.epsilon) return actions;
        return epsilon_greedy(actions, *context.epsilon, num_actions, context.random);
    }

    SacdLosses learn(const Batch& batch, const at::Generator&, bool with_actor = true) {
        return sacd_update(*this, batch, target_entropy, config, with_actor);
    }

    SacdConfig config;
    std::int64_t num_actions;
    double target_entropy;
};

}  // namespace

std::unique_ptr<Agent> make_sacd(const SacdConfig& config, const AgentSpec& spec) {
    return off_policy<Sacd>(config, spec);
}
}  // namespace cale
