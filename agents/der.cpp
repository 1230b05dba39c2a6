#include "agents/der.h"

#include <map>
#include <string>

#include <torch/types.h>
#include <torch/utils.h>

#include "agents/c51.h"
#include "networks/discrete_actions.h"
#include "networks/layers.h"

namespace cale {

constexpr double kTiny = 1e-10;  // keeps priorities and probabilities off zero

torch::Tensor importance_weights(const torch::Tensor& probability, double exponent) {
    const auto weights = (probability + kTiny).pow(-exponent);
    return weights / weights.max();
}

torch::Tensor priorities(const torch::Tensor& loss, double exponent) {
    return (loss + kTiny).pow(exponent);
}

// Loss --------------------------------------------------------------------------------

namespace {

/// The returns that atoms stand for, if there are several.
torch::Tensor support_of(const DerConfig& config, const torch::TensorOptions& options) {
    return config.distributional ? atom_support(config.num_atoms, config.value_limit, options)
                                 : torch::Tensor();
}

/// The mean [...] of distributions, by their logits [..., atoms].
torch::Tensor expected_return(const torch::Tensor& logits, const torch::Tensor& support) {
    return (logits.softmax(-1) * support).sum(-1);
}

/// Action values [B, A] of a network's output [B, A, atoms].
torch::Tensor action_values(const torch::Tensor& output, const torch::Tensor& support) {
    return support.defined() ? expected_return(output, support) : output.squeeze(2);
}

/// The outputs [B, atoms] of the actions [B] in [B, A, atoms].
torch::Tensor gather_outputs(const torch::Tensor& output, const torch::Tensor& actions) {
    return output.gather(1, actions.view({-1, 1, 1}).expand({-1, 1, output.size(2)})).squeeze(1);
}

}  // namespace

DerLosses der_losses(QNetwork& network, QNetwork& target, const Batch& batch,
                     const torch::Tensor& loss_weights, const DerNoise& noise, const DerConfig& config) {
    const auto size = batch.observation.size(0);
    require_batch_shapes("der_losses", batch, {size});
    require_shape("der_losses", "the loss weights", loss_weights, {size});

    const auto output = network(batch.observation, &noise.online);  // [B, A, atoms]
    const auto type = output.scalar_type();
    const auto support = support_of(config, output.options());
    const auto predicted = gather_outputs(output, batch.action);  // [B, atoms]

    torch::Tensor y;  // C51's projected distribution [B, atoms], or [B, 1] if not distributional
    {
        const torch::NoGradGuard no_grad;
        const auto next = target(batch.next_observation, &noise.target);
        // Double Q-learning: one network chooses, the other evaluates.
        const auto choosing = config.double_dqn ? network(batch.next_observation, &noise.target) : next;
        const auto evaluated = gather_outputs(next, action_values(choosing, support).argmax(1));
        const auto returns = n_step_target(batch, config.distributional ? support.unsqueeze(0) : evaluated,
                                           config.replay.reward_scale);
        y = config.distributional ? project_distribution(returns, evaluated.softmax(1), support) : returns;
    }
    const auto per_transition =
        config.distributional ? cross_entropy(y, predicted) : (predicted - y).square().squeeze(1);
    const auto q = config.distributional ? expected_return(predicted, support) : predicted.squeeze(1);
    return {.loss = (loss_weights.to(type) * per_transition).mean(),
            .per_transition = per_transition.detach(),
            .priorities = priorities(per_transition.detach(), config.priority_exponent),
            .q = q.detach(),
            .target = config.distributional ? y : y.squeeze(1)};
}

DerLosses der_update(QState& state, const Batch& batch, const torch::Tensor& loss_weights,
                     const DerNoise& noise, const DerConfig& config) {
    auto losses = der_losses(state.network, state.target, batch, loss_weights, noise, config);
    state.step(losses.loss);
    return losses;
}

// Agent -------------------------------------------------------------------------------

QHeadConfig head_of(const DerConfig& config) {
    return {.num_atoms = config.distributional ? config.num_atoms : 1,
            .noisy = config.noisy,
            .noisy_evaluation = config.noisy_evaluation,
            .initial_sigma = config.noisy_sigma,
            .value_limit = config.value_limit};
}

namespace {

struct Der : QState {
    using Config = DerConfig;
    using Losses = DerLosses;
    static constexpr bool kDrawsInUpdates = true;

    Der(const DerConfig& settings, const AgentSpec& spec)
        : QState(settings, spec), config(settings), device(spec.device) {}

    torch::Tensor act(const torch::Tensor& observations, const ActContext& context) {
        const bool noisy = context.training || is_noisy(network->acting);
        // With one draw for all, the environments would explore alike.
        const auto noise = noisy ? draw(context.random, observations.size(0)) : QNoise{};
        const auto output = network(observations, noisy ? &noise : nullptr);
        const auto values = action_values(output, support_of(config, output.options()));
        require_finite(values, "an action's value");
        return epsilon_greedy(values.argmax(1).cpu(), context.epsilon.value_or(0),
                              network->acting.head.num_actions, context.random);
    }

    DerLosses learn(const Batch& batch, const at::Generator& random) {
        const auto weights = config.prioritised
                                 ? importance_weights(batch.probability, config.importance_exponent)
                                 : torch::ones_like(batch.discount);
        return der_update(*this, batch, weights, {draw(random), draw(random)}, config);
    }

    /// Noisy weights explore by themselves, from the first step on or behind a random warm-up.
    double epsilon(double scheduled, bool warms_up) const {
        return config.noisy && !(config.random_warmup && warms_up) ? 0 : scheduled;
    }

    std::map<std::string, double> metrics(const DerLosses& losses) const {
        std::map<std::string, double> values{
            {config.distributional ? "losses/cross_entropy" : "losses/td_loss",
             losses.per_transition.mean().item<double>()},
            {"losses/q_values", losses.q.mean().item<double>()}};
        if (const auto norm = gradient_norm(network->parameters())) values["charts/gradient_norm"] = *norm;
        return values;
    }

    QNoise draw(const at::Generator& random, std::int64_t rows = 1) {
        return to(network->head->draw_noise(random, rows), device);
    }

    DerConfig config;
    torch::Device device;
};

}  // namespace

std::unique_ptr<Agent> make_der(const DerConfig& config, const AgentSpec& spec) {
    return off_policy<Der>(config, spec);
}
}  // namespace cale
