#include "agents/sacd.h"

#include <array>
#include <cmath>
#include <utility>

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

std::span<const std::string_view> names_of(NextPolicy) {
    static constexpr std::array<std::string_view, 2> names{"online", "target"};
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
    const auto q = target->critic(target->encoder->critic_branch(features)).minimum();
    const auto soft_value = (log_pi.exp() * (q - alpha * log_pi)).sum(1);
    return config.replay.reward_scale * batch.n_step_return.to(q.dtype()) +
           batch.discount.to(q.dtype()) * soft_value;
}

}  // namespace

SacdLosses sacd_losses(SacdNetwork& network, SacdNetwork& target_network, const torch::Tensor& log_alpha,
                       const Batch& batch, double target_entropy, const SacdConfig& config) {
    const auto size = batch.observation.size(0);
    require_shape("sacd_losses", "log_alpha", log_alpha, {1});
    require_shape("sacd_losses", "the action", batch.action, {size});
    require_shape("sacd_losses", "the n-step return", batch.n_step_return, {size});
    require_shape("sacd_losses", "the discount", batch.discount, {size});
    require_shape("sacd_losses", "the next observation", batch.next_observation, batch.observation.sizes());

    const auto alpha = log_alpha.detach().exp();
    const auto y = target_values(network, target_network, alpha, batch, config);

    // Critics, SAC's equation 5 for values of every action.
    const auto features = network->encoder->trunk(batch.observation);
    const auto values = network->critic(network->encoder->critic_branch(features));
    const auto q1 = values_of(values.q1, batch.action), q2 = values_of(values.q2, batch.action);
    const auto critic_loss = ((q1 - y).square() + (q2 - y).square()).mean();

    // Actor, SAC-D's equation 12: a sum over the actions, not their mean.
    const auto log_pi = network->log_policy(features);
    const auto pi = log_pi.exp();
    const auto actor_loss = (pi * (alpha * log_pi - values.minimum().detach())).sum(1).mean();

    // Temperature, SAC-D's equation 11, with log alpha in alpha's place as in SAC's code.
    const auto entropy = -(pi * log_pi).sum(1).detach();
    const auto alpha_loss = (log_alpha * (entropy - target_entropy)).mean();

    return {critic_loss, actor_loss, alpha_loss, q1.detach(), q2.detach(), y, entropy};
}

SacdLosses sacd_update(SacdLearner& learner, const Batch& batch, double target_entropy,
                       const SacdConfig& config) {
    auto losses =
        sacd_losses(learner.network, learner.target, learner.log_alpha, batch, target_entropy, config);
    learner.step(0.5 * losses.critic, losses.actor, losses.alpha, config.tau);
    for (auto* loss : {&losses.critic, &losses.actor, &losses.alpha}) *loss = loss->detach();
    return losses;
}

// Agent -------------------------------------------------------------------------------

namespace {

SacdLearner make_learner(const SacdConfig& config, const AgentSpec& spec) {
    const auto make_network = [&] {
        SacdNetwork network(config.network.encoder_for(spec), config.network.head(), spec.num_actions,
                            make_generator(stream_seed(spec.seed, kInitialValues)));
        network->to(spec.device);
        return network;
    };
    const auto log_alpha =
        torch::zeros({1}, torch::dtype(torch::kFloat32).device(spec.device)).requires_grad_();
    // The same seed makes the same network twice: the target starts equal to it.
    return {make_network(),
            make_network(),
            log_alpha,
            {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}};
}

class Sacd final : public Agent {
  public:
    Sacd(const SacdConfig& config, const AgentSpec& spec)
        : config_(config),
          spec_(spec),
          target_entropy_(config.target_entropy_scale * std::log(static_cast<double>(spec.num_actions))),
          learner_(make_learner(config, spec)),
          memory_(config.replay, spec, /*prioritised=*/false, stream_seed(spec.seed, kReplay)),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))),
          gradient_step_(spec.device, {}) {}

    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool greedy = config_.exploration == Exploration::epsilon_greedy;
        if (mode == ActMode::evaluate) {
            const auto actions = log_policy(observations).argmax(1).cpu();
            const auto epsilon = greedy ? config_.epsilon.epsilon_eval : 0;
            return epsilon_greedy(actions, epsilon, spec_.num_actions, evaluation_random_);
        }
        const auto epsilon = greedy ? memory_.epsilon(config_.epsilon) : memory_.warm() ? 0 : 1;
        if (epsilon >= 1)
            return torch::randint(0, spec_.num_actions, {observations.size(0)}, acting_random_,
                                  torch::kInt64);
        const auto actions = log_policy(observations)
                                 .exp()
                                 .cpu()
                                 .multinomial(1, /*replacement=*/true, acting_random_)
                                 .squeeze(1);
        return epsilon_greedy(actions, epsilon, spec_.num_actions, acting_random_);
    }

    void observe(const Experiences& seen) override { memory_.store(seen); }

    bool update(const torch::Tensor&) override {
        const auto updates = memory_.next_decisions().multiples_of(config_.replay.update_period);
        if (!memory_.warm()) return false;
        for (std::int64_t i = 0; i < updates; ++i) {
            const auto batch = memory_.sample();
            gradient_step_([&] { newest_ = sacd_update(learner_, batch, target_entropy_, config_); });
        }
        return updates > 0;
    }

    TimeSplit memory_time() const override { return memory_.time(); }

    std::map<std::string, double> metrics() override {
        std::map<std::string, double> values{{"charts/learning_rate", learner_.adam.learning_rate()}};
        if (config_.exploration == Exploration::epsilon_greedy)
            values["charts/epsilon"] = memory_.epsilon(config_.epsilon);
        if (!newest_.critic.defined()) return values;
        const auto mean = [](const torch::Tensor& x) { return x.mean().item<double>(); };
        values["losses/qf_loss"] = mean(newest_.critic);
        values["losses/qf1_values"] = mean(newest_.q1);
        values["losses/qf2_values"] = mean(newest_.q2);
        values["losses/target_values"] = mean(newest_.target_values);
        values["losses/actor_loss"] = mean(newest_.actor);
        values["losses/alpha_loss"] = mean(newest_.alpha);
        values["losses/entropy"] = mean(newest_.entropy);
        values["losses/alpha"] = std::exp(mean(learner_.log_alpha.detach()));
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
    torch::Tensor log_policy(const torch::Tensor& observations) {
        auto& network = learner_.network;
        return network->log_policy(network->encoder->trunk(observations.to(spec_.device)));
    }

    StateParts parts() {
        StateParts parts;
        learner_.add_state(parts);
        parts.generators["random/acting"] = &acting_random_;
        parts.generators["random/evaluation"] = &evaluation_random_;
        memory_.add_state(parts);
        return parts;
    }

    SacdConfig config_;
    AgentSpec spec_;
    double target_entropy_;
    SacdLearner learner_;
    ReplayMemory memory_;
    at::Generator acting_random_, evaluation_random_;
    CapturedUpdate gradient_step_;
    SacdLosses newest_;
};

}  // namespace

std::unique_ptr<Agent> make_sacd(const SacdConfig& config, const AgentSpec& spec) {
    require_discrete("SAC-D", spec);
    return std::make_unique<Sacd>(config, spec);
}

void check_memory(const SacdConfig& config, const AgentSpec& spec, std::int64_t available) {
    const SacdNetwork network(config.network.encoder_for(spec), config.network.head(), spec.num_actions,
                              no_values());
    const NetworkMemory networks{parameter_bytes(*network), /*target=*/true,
                                 "agent.hidden_units or agent.hidden_layers"};
    check_memory(config.replay, spec, /*prioritised=*/false, memory_beside(networks, spec, available));
}

}  // namespace cale
