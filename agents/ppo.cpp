#include "agents/ppo.h"

#include <vector>

#include <torch/types.h>

#include "networks/layers.h"

namespace cale {

PpoLosses ppo_losses(PpoNetwork& network, const RolloutBatch& minibatch, const PpoConfig& config) {
    const auto size = minibatch.observation.size(0);
    require_shape("ppo_losses", "the old log-probability", minibatch.old_log_prob, {size});
    require_shape("ppo_losses", "the old value", minibatch.old_value, {size});
    require_shape("ppo_losses", "the advantage", minibatch.advantage, {size});
    require_shape("ppo_losses", "the return", minibatch.returns, {size});

    const auto [policy, value] = network(minibatch.observation);
    if (policy.gaussian) {
        require_shape("ppo_losses", "the action", minibatch.action, {size, network->box.centre.size(0)});
    } else {
        require_shape("ppo_losses", "the action", minibatch.action, {size});
    }
    const auto divisor = static_cast<double>(minibatch.global_size > 0 ? minibatch.global_size : size);
    const auto mean = [divisor](const torch::Tensor& part) { return part.sum() / divisor; };

    // PPO's equation 7.
    const auto log_ratio = log_prob(policy, minibatch.action, network->box) - minibatch.old_log_prob;
    const auto ratio = log_ratio.exp();
    const auto clipped_ratio = ratio.clamp(1 - config.clip, 1 + config.clip);
    const auto actor =
        -mean(torch::minimum(ratio * minibatch.advantage, clipped_ratio * minibatch.advantage));

    // L^VF of PPO's equation 9, halved; clipped as in OpenAI Baselines, where the larger error counts.
    auto squared_error = (value - minibatch.returns).square();
    if (config.clip_value_loss) {
        const auto clipped_delta = (value - minibatch.old_value).clamp(-config.clip, config.clip);
        squared_error =
            torch::maximum(squared_error, (minibatch.old_value + clipped_delta - minibatch.returns).square());
    }
    const auto critic = 0.5 * mean(squared_error);
    const auto mean_entropy = mean(entropy(policy));

    // PPO's equation 9, negated.
    const auto combined =
        actor + config.value_coefficient * critic - config.entropy_coefficient * mean_entropy;
    const auto change = ratio.detach() - 1;  // r - 1 - log r estimates the KL divergence without bias
    return {combined,
            actor.detach(),
            critic.detach(),
            mean_entropy.detach(),
            mean(change - log_ratio.detach()),
            mean((change.abs() > config.clip).to(ratio.dtype()))};
}

PpoLosses ppo_update(OnPolicyState& state, const RolloutBatch& minibatch, const PpoConfig& config) {
    state.anneal(state.gradient_steps++);
    auto losses = ppo_losses(state.network, normalized(minibatch), config);
    state.step(losses.combined);
    return losses;
}

std::unique_ptr<Agent> make_ppo(const PpoConfig& config, const AgentSpec& spec) {
    const auto losses = [config](PpoNetwork& network, const RolloutBatch& minibatch) {
        const auto l = ppo_losses(network, minibatch, config);
        return std::vector{l.combined, l.actor, l.critic, l.entropy, l.approximate_kl, l.clipped_fraction};
    };
    return on_policy(config, spec, losses,
                     {"loss", "policy_loss", "value_loss", "entropy", "approx_kl", "clipfrac"});
}

}  // namespace cale
