#include "agents/dqn.h"

#include <map>
#include <string>

#include <torch/types.h>
#include <torch/utils.h>

#include "networks/discrete_actions.h"

namespace cale {

std::span<const std::string_view> names_of(ValueLoss) {
    static constexpr std::string_view names[] = {"mse", "huber"};
    return names;
}

// Loss --------------------------------------------------------------------------------

DqnLosses dqn_losses(QNetwork& network, QNetwork& target, const Batch& batch, const DqnConfig& config) {
    require_batch_shapes("dqn_losses", batch, {batch.observation.size(0)});

    const auto all_values = network(batch.observation).squeeze(2);
    const auto q = gather_actions(all_values, batch.action);

    torch::Tensor y;  // DQN's equation 2
    {
        const torch::NoGradGuard no_grad;
        const auto next = target(batch.next_observation).squeeze(2);
        const auto chosen = (config.double_dqn ? network(batch.next_observation).squeeze(2) : next).argmax(1);
        y = n_step_target(batch, gather_actions(next, chosen), config.replay.reward_scale);
    }
    const auto loss = config.loss == ValueLoss::huber ? at::huber_loss(q, y) : at::mse_loss(q, y);
    return {loss, q.detach(), y};
}

DqnLosses dqn_update(QState& state, const Batch& batch, const DqnConfig& config) {
    auto losses = dqn_losses(state.network, state.target, batch, config);
    state.step(losses.loss);
    return losses;
}

// Agent -------------------------------------------------------------------------------

namespace {

struct Dqn : QState {
    using Config = DqnConfig;
    using Losses = DqnLosses;
    static constexpr bool kDrawsInUpdates = false;

    Dqn(const DqnConfig& settings, const AgentSpec& spec) : QState(settings, spec), config(settings) {}

    torch::Tensor act(const torch::Tensor& observations, const ActContext& context) {
        const double epsilon = context.epsilon.value_or(0);
        auto greedy = torch::zeros({observations.size(0)}, torch::kInt64);
        if (epsilon < 1) {
            const auto values = network(observations).squeeze(2);
            require_finite(values, "an action's value");
            greedy = values.argmax(1).cpu();
        }
        return epsilon_greedy(greedy, epsilon, network->acting.head.num_actions, context.random);
    }

    DqnLosses learn(const Batch& batch, const at::Generator&) { return dqn_update(*this, batch, config); }

    std::map<std::string, double> metrics(const DqnLosses& losses) const {
        std::map<std::string, double> values{{"losses/td_loss", losses.loss.item<double>()},
                                             {"losses/q_values", losses.q.mean().item<double>()}};
        if (const auto norm = gradient_norm(network->parameters())) values["charts/gradient_norm"] = *norm;
        return values;
    }

    DqnConfig config;
};

}  // namespace

std::unique_ptr<Agent> make_dqn(const DqnConfig& config, const AgentSpec& spec) {
    return off_policy<Dqn>(config, spec);
}
}  // namespace cale
