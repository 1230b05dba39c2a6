#include "patch_dqn.h"

#include <map>
#include <optional>
#include <string>

#include <networks/adam.h>
#include <networks/discrete_actions.h>

#include "patch_network.h"

namespace example {
namespace {

PatchNetwork make_network(const PatchDqnConfig& config, const cale::AgentSpec& spec) {
    const auto generator = cale::initial_values(spec);
    const cale::QHeadConfig head{.num_actions = cale::num_actions(spec.action_space),
                                 .hidden_units = config.hidden_units};
    PatchNetwork network(spec.observation.tensor_shape(), config.channels, head, generator);
    network->to(spec.device);
    return network;
}

// The algorithm: how it acts, and one gradient step. Everything else is cale::OffPolicy's.
struct PatchDqn {
    using Config = PatchDqnConfig;
    struct Losses {
        torch::Tensor loss;  // []
    };
    static constexpr bool kDrawsInUpdates = false;

    PatchDqn(const PatchDqnConfig& settings, const cale::AgentSpec& spec)
        : config(settings),
          num_actions(cale::num_actions(spec.action_space)),
          network(make_network(settings, spec)),
          target(make_network(settings, spec)),  // equal to the network
          adam(network->parameters(), {.learning_rate = settings.learning_rate}) {}

    torch::Tensor act(const torch::Tensor& observations, const cale::ActContext& context) {
        const auto greedy = network(observations).argmax(1).cpu();
        return cale::epsilon_greedy(greedy, context.epsilon.value_or(0), num_actions, context.random);
    }

    Losses learn(const cale::Batch& batch, const at::Generator&) {
        torch::Tensor y;
        {
            const at::NoGradGuard no_grad;
            y = cale::n_step_target(batch, target(batch.next_observation).amax(1),
                                    config.replay.reward_scale);
        }
        const auto loss = at::huber_loss(cale::gather_actions(network(batch.observation), batch.action), y);
        adam.zero_grad();
        loss.backward();
        adam.step();
        return {loss.detach()};
    }

    void copy_to_target() { cale::hard_update(target->parameters(), network->parameters()); }

    std::map<std::string, double> metrics(const Losses& losses) const {
        return {{"losses/td_loss", losses.loss.item<double>()}};
    }

    void add_state(cale::StateParts& parts) {
        parts.add("network/", *network);
        parts.add("target/", *target);
        parts.add("adam/", adam.state());
    }

    PatchDqnConfig config;
    std::int64_t num_actions;
    PatchNetwork network, target;
    cale::Adam adam;
};

}  // namespace

std::unique_ptr<cale::Agent> make_patch_dqn(const PatchDqnConfig& config, const cale::AgentSpec& spec) {
    return cale::off_policy<PatchDqn>(config, spec);
}

}  // namespace example
