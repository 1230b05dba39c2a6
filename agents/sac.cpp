#include "agents/sac.h"

#include <array>
#include <map>
#include <stdexcept>
#include <string>

#include <torch/types.h>
#include <torch/utils.h>

#include "agents/action_metrics.h"
#include "networks/shapes.h"

namespace cale {

std::span<const std::string_view> names_of(CriticTarget) {
    static constexpr std::array<std::string_view, 2> names{"target_mean_action", "sampled_action"};
    return names;
}

// Losses ------------------------------------------------------------------------------

namespace {

constexpr std::int64_t kActionSize = 3;  // r, theta, fire

/// y of SAC's equation 3: the reward and the soft value of what follows.
torch::Tensor target_values(SacNetwork& network, SacNetwork& target, const torch::Tensor& alpha,
                            const Batch& batch, const SacNoise& noise, const SacConfig& config) {
    const torch::NoGradGuard no_grad;
    const auto features = target->encoder->trunk(batch.next_observation);
    PolicySample next;
    torch::Tensor next_action;
    if (config.critic_target == CriticTarget::target_mean_action) {
        const auto policy = target->policy(features);
        next = sample(policy, noise.target, target->box);
        next_action = mean_action(policy, target->box);
    } else {
        next = sample(network->policy(network->encoder->trunk(batch.next_observation)), noise.target,
                      network->box);
        next_action = next.action;
    }
    const auto q = target->values(target->encoder->critic_branch(features), next_action).minimum();
    const auto soft_value = q - alpha * next.log_prob;
    return config.replay.reward_scale * batch.n_step_return.to(q.dtype()) +
           batch.discount.to(q.dtype()) * soft_value;
}

}  // namespace

SacLosses sac_losses(SacNetwork& network, SacNetwork& target_network, const torch::Tensor& log_alpha,
                     const Batch& batch, const SacNoise& noise, const SacConfig& config) {
    const auto size = batch.observation.size(0);
    require_shape("sac_losses", "log_alpha", log_alpha, {1});
    require_batch_shapes("sac_losses", batch, {size, kActionSize});
    require_shape("sac_losses", "the target's noise", noise.target, {size, kActionSize});
    require_shape("sac_losses", "the actor's noise", noise.actor, {size, kActionSize});

    const auto alpha = log_alpha.detach().exp();
    const auto y = target_values(network, target_network, alpha, batch, noise, config);

    // Critics, SAC's equation 5.
    const auto features = network->encoder->trunk(batch.observation);
    const auto critic_z = network->encoder->critic_branch(features);
    const auto q = network->values(critic_z, batch.action.to(y.dtype()));
    const auto critic_loss = ((q.q1 - y).square() + (q.q2 - y).square()).mean();

    // Actor, SAC's equation 9, with the clipped double Q of its section 5.
    const auto policy = network->policy(features);
    const auto pi = sample(policy, noise.actor, network->box);
    const auto q_pi = network->values(critic_z.detach(), pi.action).minimum();
    const auto actor_loss = (alpha * pi.log_prob - q_pi).mean();

    // Temperature, SAC's equation 18, with log alpha in alpha's place, as its authors' code has it.
    const auto log_prob = pi.log_prob.detach();
    const auto alpha_loss = (log_alpha * (-log_prob - config.target_entropy)).mean();

    return {critic_loss,   actor_loss, alpha_loss, q.q1.detach(),
            q.q2.detach(), y,          -log_prob,  mean_action(policy, network->box).detach()};
}

SacLosses sac_update(ActorCriticState<SacNetwork>& state, const Batch& batch, const SacNoise& noise,
                     const SacConfig& config) {
    auto losses = sac_losses(state.network, state.target, state.log_alpha, batch, noise, config);
    state.step(losses, config.tau);
    return losses;
}

// Agent -------------------------------------------------------------------------------

namespace {

SacNetwork make_network(const SacConfig& config, const AgentSpec& spec, const at::Generator& generator) {
    return SacNetwork(config.network.encoder_for(spec), config.network.head(), generator);
}

struct Sac : ActorCriticState<SacNetwork> {
    using Config = SacConfig;
    using Losses = SacLosses;
    static constexpr bool kDrawsInUpdates = true;

    Sac(const SacConfig& settings, const AgentSpec& spec)
        : ActorCriticState(settings, spec,
                           [&] { return make_network(settings, spec, initial_values(spec)); }),
          config(settings) {}

    torch::Tensor act(const torch::Tensor& observations, const Acting& now) {
        const auto count = observations.size(0);
        if (now.training() && now.epsilon >= 1) return uniform_actions(box, count, now.random);
        const auto noise = now.training() ? torch::randn({count, kActionSize}, now.random) : torch::Tensor();
        const auto policy = network->policy(network->encoder->trunk(observations));
        const auto actions = now.training()
                                 ? sample(policy, noise.to(observations.device()), network->box).action
                                 : mean_action(policy, network->box);
        if (!actions.isfinite().all().item<bool>()) {
            throw std::runtime_error(
                "the actor's output is not finite: training has diverged, try a lower learning_rate");
        }
        if (config.exploration == Exploration::standard) return actions.cpu();
        return epsilon_greedy(actions.cpu(), now.epsilon, box, now.random);
    }

    SacLosses learn(const Batch& batch, const at::Generator& random) {
        const auto noise =
            torch::randn({2, batch.action.size(0), kActionSize}, random, batch.action.device());
        return sac_update(*this, batch, {noise[0], noise[1]}, config);
    }

    std::optional<double> epsilon(double scheduled) const {
        return config.exploration == Exploration::epsilon_greedy ? std::optional(scheduled) : std::nullopt;
    }

    std::map<std::string, double> metrics(const SacLosses& losses) const {
        auto values = ActorCriticState::metrics(losses);
        add_mean_action(values, losses.mean_action.mean(0));
        return values;
    }

    SacConfig config;
    ActionBox box = joystick_box();  // on the CPU
};

}  // namespace

void check_settings(const SacConfig&, const AgentSpec& spec) {
    require_continuous("SAC", spec);
}

std::unique_ptr<Agent> make_sac(const SacConfig& config, const AgentSpec& spec) {
    check_settings(config, spec);
    return off_policy<Sac>(config, spec);
}

void check_memory(const SacConfig& config, const AgentSpec& spec, std::int64_t available) {
    check_memory(config, *make_network(config, spec, no_values()), spec, available);
}

}  // namespace cale
