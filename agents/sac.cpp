#include "agents/sac.h"

#include <map>
#include <string>

#include <torch/types.h>
#include <torch/utils.h>

#include "networks/layers.h"

namespace cale {

// Losses ------------------------------------------------------------------------------

namespace {

/// Returns y of SAC's equation 5, without a gradient: the n-step return and the discounted soft value,
/// equation 3, of the next state.
CriticTargets target_values(SacNetwork& network, SacNetwork& target, const torch::Tensor& alpha,
                            const Batch& batch, const SacNoise& noise, const SacConfig& config) {
    const torch::NoGradGuard no_grad;
    const auto features = target->encoder->trunk(batch.next_observation);
    const bool targets_mean = config.critic.target == CriticTarget::target_mean_action;
    const auto policy = targets_mean ? target->policy(features)
                                     : network->policy(network->encoder->trunk(batch.next_observation));
    const auto next = sample(policy, noise.target, target->box);
    const auto action = targets_mean ? mean_action(policy, target->box) : next.action;
    const auto outputs = target->outputs(target->encoder->critic_branch(features), action);
    const auto bonus = config.entropy_in_target ? -alpha * next.log_prob : torch::zeros_like(next.log_prob);
    return critic_targets(outputs, target->support, config.twin_estimate, bonus, batch,
                          config.replay.reward_scale);
}

}  // namespace

SacLosses sac_losses(SacNetwork& network, SacNetwork& target_network, const torch::Tensor& log_alpha,
                     const Batch& batch, const SacNoise& noise, const SacConfig& config, bool with_actor) {
    const auto size = batch.observation.size(0), axes = network->box.centre.size(0);
    require_shape("sac_losses", "log_alpha", log_alpha, {1});
    require_batch_shapes("sac_losses", batch, {size, axes});
    require_shape("sac_losses", "the target's noise", noise.target, {size, axes});
    require_shape("sac_losses", "the actor's noise", noise.actor, {size, axes});

    const auto alpha = log_alpha.detach().exp();
    const auto y = target_values(network, target_network, alpha, batch, noise, config);

    // Critics, SAC's equation 5.
    const auto features = network->encoder->trunk(batch.observation);
    const auto critic_z = network->encoder->critic_branch(features);
    const auto outputs = network->outputs(critic_z, batch.action.to(y.values.dtype()));
    const auto q = critic_values({outputs.q1.detach(), outputs.q2.detach()}, network->support);
    SacLosses losses{.critic = critic_loss(outputs, network->support, y),
                     .q1 = q.q1,
                     .q2 = q.q2,
                     .target_values = y.values};
    if (!with_actor) return losses;

    // Actor, SAC's equation 9. The critics are not trained by it: see ActorCriticState::step().
    const auto policy = network->policy(features);
    const auto pi = sample(policy, noise.actor, network->box);
    const auto q_pi = network->values(critic_z.detach(), pi.action).estimate(config.twin_estimate);
    losses.actor = (alpha * pi.log_prob - q_pi).mean();
    losses.policy = {policy.mean.detach(), policy.log_std.detach()};

    // Temperature, SAC's equation 18, with log alpha in alpha's place, as its authors' code has it.
    losses.entropy = -pi.log_prob.detach();
    losses.alpha = (log_alpha * (losses.entropy - config.target_entropy)).mean();
    return losses;
}

SacLosses sac_update(ActorCriticState<SacNetwork>& state, const Batch& batch, const SacNoise& noise,
                     const SacConfig& config, bool with_actor) {
    auto losses = sac_losses(state.network, state.target, state.log_alpha, batch, noise, config, with_actor);
    state.step(losses, config.tau);
    return losses;
}

// Agent -------------------------------------------------------------------------------

SacNetwork make_network(const SacConfig& config, const AgentSpec& spec, const at::Generator& generator) {
    return SacNetwork(config.network.encoder_for(spec), config.head(), generator,
                      action_box(spec.action_space), config.critic.support());
}

namespace {

struct Sac : ActorCriticState<SacNetwork> {
    using Config = SacConfig;
    using Losses = SacLosses;
    static constexpr bool kDrawsInUpdates = true;

    Sac(const SacConfig& settings, const AgentSpec& spec)
        : ActorCriticState(settings, spec),
          config(settings),
          space(spec.action_space),
          random_box(exploration_box(space, settings.random_actions)) {}

    torch::Tensor act(const torch::Tensor& observations, const ActContext& context) {
        const auto count = observations.size(0), axes = random_box.centre.size(0);
        if (context.uniform) return uniform_actions(random_box, count, context.random);
        const bool draws = context.training || config.sampled_evaluation;
        const auto noise = draws ? torch::randn({count, axes}, context.random) : torch::Tensor();
        const auto policy = acting_network()->policy(acting_network()->encoder->trunk(observations));
        const auto actions = draws ? sample(policy, noise.to(observations.device()), network->box).action
                                   : mean_action(policy, network->box);
        require_finite(actions);
        if (!context.epsilon) return actions.cpu();
        return epsilon_greedy(actions.cpu(), *context.epsilon,
                              context.training ? random_box : action_box(space), context.random);
    }

    SacLosses learn(const Batch& batch, const at::Generator& random, bool with_actor = true) {
        const auto noise =
            torch::randn({2, batch.action.size(0), box_size(space)}, random, batch.action.device());
        return sac_update(*this, batch, {noise[0], noise[1]}, config, with_actor);
    }

    std::map<std::string, double> metrics(const SacLosses& losses) const {
        auto values = ActorCriticState::metrics(losses);
        add_mean_action(values, space, mean_action(losses.policy, network->box).mean(0));
        values["charts/mean_log_std"] = losses.policy.log_std.mean().item<double>();
        return values;
    }

    SacConfig config;
    ActionSpace space;
    ActionBox random_box;  // of random actions in training, on the CPU
};

}  // namespace

std::unique_ptr<Agent> make_sac(const SacConfig& config, const AgentSpec& spec) {
    return off_policy<Sac>(config, spec);
}
}  // namespace cale
