#include "agents/dqn.h"

#include <array>
#include <stdexcept>

#include <torch/types.h>
#include <torch/utils.h>

#include "agents/captured_update.h"
#include "agents/memory.h"
#include "agents/random.h"
#include "agents/state.h"
#include "networks/shapes.h"

namespace cale {

// Constants ---------------------------------------------------------------------------

namespace {

enum Stream : std::uint64_t { kInitialValues, kActing, kReplay, kEvaluation };

}  // namespace

std::span<const std::string_view> names_of(ValueLoss) {
    static constexpr std::array<std::string_view, 2> names{"mse", "huber"};
    return names;
}

// Loss --------------------------------------------------------------------------------

DqnLosses dqn_losses(QNetwork& network, QNetwork& target, const Batch& batch, const DqnConfig& config) {
    const auto size = batch.observation.size(0);
    require_shape("dqn_losses", "the action", batch.action, {size});
    require_shape("dqn_losses", "the n-step return", batch.n_step_return, {size});
    require_shape("dqn_losses", "the discount", batch.discount, {size});
    require_shape("dqn_losses", "the next observation", batch.next_observation, batch.observation.sizes());

    const auto all_values = network(batch.observation).squeeze(2);
    const auto q = values_of(all_values, batch.action);

    torch::Tensor y;  // DQN's equation 2
    {
        const torch::NoGradGuard no_grad;
        const auto next = target(batch.next_observation).squeeze(2);
        const auto chosen = (config.double_dqn ? network(batch.next_observation).squeeze(2) : next).argmax(1);
        y = config.replay.reward_scale * batch.n_step_return.to(q.dtype()) +
            batch.discount.to(q.dtype()) * values_of(next, chosen);
    }
    const auto loss = config.loss == ValueLoss::huber ? at::huber_loss(q, y) : at::mse_loss(q, y);
    return {loss, q.detach(), y};
}

DqnLosses dqn_update(QLearner& learner, const Batch& batch, const DqnConfig& config) {
    auto losses = dqn_losses(learner.network, learner.target, batch, config);
    learner.step(losses.loss);
    losses.loss = losses.loss.detach();
    return losses;
}

// Agent -------------------------------------------------------------------------------

namespace {

EncoderConfig encoder_of(const DqnConfig& config) {
    return {.encoder = config.encoder, .padding = config.padding};
}

QHeadConfig head_of(const DqnConfig& config, const AgentSpec& spec) {
    return {.num_actions = spec.num_actions, .hidden_units = config.hidden_units, .dueling = config.dueling};
}

QLearner make_learner(const DqnConfig& config, const AgentSpec& spec) {
    return make_q_learner(encoder_of(config), head_of(config, spec),
                          {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}, spec,
                          stream_seed(spec.seed, kInitialValues));
}

class Dqn final : public Agent {
  public:
    Dqn(const DqnConfig& config, const AgentSpec& spec)
        : config_(config),
          spec_(spec),
          learner_(make_learner(config, spec)),
          memory_(config.replay, spec, /*prioritised=*/false, stream_seed(spec.seed, kReplay)),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))),
          gradient_step_(spec.device, {}) {}

    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool training = mode == ActMode::train;
        const auto epsilon = training ? memory_.epsilon(config_.epsilon) : config_.epsilon.epsilon_eval;
        auto& random = training ? acting_random_ : evaluation_random_;
        const auto greedy = epsilon >= 1
                                ? torch::zeros({observations.size(0)}, torch::kInt64)
                                : learner_.network(observations.to(spec_.device)).squeeze(2).argmax(1);
        return epsilon_greedy(greedy.cpu(), epsilon, spec_.num_actions, random);
    }

    void observe(const Experiences& seen) override { memory_.store(seen); }

    bool update(const torch::Tensor&) override {
        const auto decisions = memory_.next_decisions();
        if (!memory_.warm()) return false;
        const auto updates = decisions.multiples_of(config_.replay.update_period);
        for (std::int64_t i = 0; i < updates; ++i) {
            const auto batch = memory_.sample();
            gradient_step_([&] { newest_ = dqn_update(learner_, batch, config_); });
        }
        if (decisions.multiples_of(config_.target_update_period) > 0) learner_.copy_to_target();
        return updates > 0;
    }

    TimeSplit memory_time() const override { return memory_.time(); }

    std::map<std::string, double> metrics() override {
        std::map<std::string, double> values{{"charts/learning_rate", learner_.adam.learning_rate()},
                                             {"charts/epsilon", memory_.epsilon(config_.epsilon)}};
        if (!newest_.loss.defined()) return values;
        values["losses/td_loss"] = newest_.loss.item<double>();
        values["losses/q_values"] = newest_.q.mean().item<double>();
        return values;
    }

    TensorMap state() override { return saved(parts()); }
    void load_state(const TensorMap& state) override {
        restore(parts(), state);
        newest_ = {};
        gradient_step_.forget();
    }
    ReplayBuffer* replay() override { return &memory_.replay(); }

  private:
    StateParts parts() {
        StateParts parts;
        learner_.add_state(parts);
        parts.generators["random/acting"] = &acting_random_;
        parts.generators["random/evaluation"] = &evaluation_random_;
        memory_.add_state(parts);
        return parts;
    }

    DqnConfig config_;
    AgentSpec spec_;
    QLearner learner_;
    ReplayMemory memory_;
    at::Generator acting_random_, evaluation_random_;
    CapturedUpdate gradient_step_;
    DqnLosses newest_;
};

}  // namespace

std::unique_ptr<Agent> make_dqn(const DqnConfig& config, const AgentSpec& spec) {
    require_discrete("DQN", spec);
    return std::make_unique<Dqn>(config, spec);
}

void check_memory(const DqnConfig& config, const AgentSpec& spec, std::int64_t available) {
    const auto network = make_q_network(encoder_of(config), head_of(config, spec), spec, no_values());
    const NetworkMemory networks{parameter_bytes(*network), /*target=*/true, "agent.hidden_units"};
    check_memory(config.replay, spec, /*prioritised=*/false, memory_beside(networks, spec, available));
}

}  // namespace cale
