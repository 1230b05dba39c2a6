#include "agents/der.h"

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

enum Stream : std::uint64_t { kInitialValues, kActing, kReplay, kUpdateNoise, kEvaluation };

constexpr double kTiny = 1e-10;  // keeps priorities and probabilities off zero

}  // namespace

// Pieces ------------------------------------------------------------------------------

torch::Tensor atom_support(std::int64_t num_atoms, double limit, const torch::TensorOptions& options) {
    return torch::linspace(-limit, limit, num_atoms, options);
}

torch::Tensor project_distribution(const torch::Tensor& returns, const torch::Tensor& probabilities,
                                   const torch::Tensor& support) {
    const auto spacing = support[1] - support[0];
    const auto clipped = returns.clamp(support[0], support[-1]).unsqueeze(1);  // [B, 1, atoms]
    // An atom takes from each return what is closer to it than one spacing.
    const auto share = (1 - (clipped - support.unsqueeze(1)).abs() / spacing).clamp(0, 1);  // [B, to, from]
    return (share * probabilities.unsqueeze(1)).sum(2);
}

torch::Tensor importance_weights(const torch::Tensor& probability, double exponent) {
    const auto weights = (probability + kTiny).pow(-exponent);
    return weights / weights.max();
}

// Loss --------------------------------------------------------------------------------

namespace {

/// Action values [B, A] of a network's output [B, A, atoms].
torch::Tensor action_values(const torch::Tensor& output, const torch::Tensor& support) {
    return support.defined() ? (output.softmax(2) * support).sum(2) : output.squeeze(2);
}

/// The rows [B, atoms] of the actions [B] in [B, A, atoms].
torch::Tensor rows_of(const torch::Tensor& output, const torch::Tensor& actions) {
    return output.gather(1, actions.view({-1, 1, 1}).expand({-1, 1, output.size(2)})).squeeze(1);
}

}  // namespace

DerLosses der_losses(QNetwork& network, QNetwork& target, const Batch& batch,
                     const torch::Tensor& loss_weights, const DerNoise& noise, const DerConfig& config) {
    const auto size = batch.observation.size(0);
    require_shape("der_losses", "the action", batch.action, {size});
    require_shape("der_losses", "the n-step return", batch.n_step_return, {size});
    require_shape("der_losses", "the discount", batch.discount, {size});
    require_shape("der_losses", "the next observation", batch.next_observation, batch.observation.sizes());
    require_shape("der_losses", "the loss weights", loss_weights, {size});

    const auto output = network(batch.observation, &noise.online);  // [B, A, atoms]
    const auto type = output.scalar_type();
    const auto support = config.distributional
                             ? atom_support(config.num_atoms, config.value_limit, output.options())
                             : torch::Tensor();
    const auto predicted = rows_of(output, batch.action);  // [B, atoms]

    torch::Tensor expected;  // [B, atoms], or [B, 1] if not distributional
    {
        const torch::NoGradGuard no_grad;
        const auto next = target(batch.next_observation, &noise.target);
        // Double Q-learning: one network chooses, the other values.
        const auto choosing = config.double_dqn ? network(batch.next_observation, &noise.target) : next;
        const auto valued = rows_of(next, action_values(choosing, support).argmax(1));
        const auto n_step_return = config.replay.reward_scale * batch.n_step_return.to(type).unsqueeze(1);
        const auto discount = batch.discount.to(type).unsqueeze(1);
        expected = config.distributional
                       ? project_distribution(n_step_return + discount * support, valued.softmax(1), support)
                       : n_step_return + discount * valued;
    }
    const auto per_transition = config.distributional ? -(expected * predicted.log_softmax(1)).sum(1)
                                                      : (predicted - expected).square().squeeze(1);
    const auto q = config.distributional ? (predicted.softmax(1) * support).sum(1) : predicted.squeeze(1);
    return {.loss = (loss_weights.to(type) * per_transition).mean(),
            .per_transition = per_transition.detach(),
            .priorities = (per_transition.detach() + kTiny).pow(config.priority_exponent),
            .q = q.detach(),
            .target = config.distributional ? expected : expected.squeeze(1)};
}

DerLosses der_update(QLearner& learner, const Batch& batch, const torch::Tensor& loss_weights,
                     const DerNoise& noise, const DerConfig& config) {
    auto losses = der_losses(learner.network, learner.target, batch, loss_weights, noise, config);
    learner.step(losses.loss);
    losses.loss = losses.loss.detach();
    return losses;
}

// Agent -------------------------------------------------------------------------------

namespace {

EncoderConfig encoder_of(const DerConfig& config) {
    return {.encoder = config.encoder, .padding = config.padding};
}

QHeadConfig head_of(const DerConfig& config, const AgentSpec& spec) {
    return {.num_actions = spec.num_actions,
            .hidden_units = config.hidden_units,
            .num_atoms = config.distributional ? config.num_atoms : 1,
            .dueling = config.dueling,
            .noisy = config.noisy,
            .initial_sigma = config.noisy_sigma};
}

QLearner make_learner(const DerConfig& config, const AgentSpec& spec) {
    return make_q_learner(encoder_of(config), head_of(config, spec),
                          {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}, spec,
                          stream_seed(spec.seed, kInitialValues));
}

class Der final : public Agent {
  public:
    Der(const DerConfig& config, const AgentSpec& spec)
        : config_(config),
          spec_(spec),
          learner_(make_learner(config, spec)),
          memory_(config.replay, spec, config.prioritised, stream_seed(spec.seed, kReplay)),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          noise_random_(make_generator(stream_seed(spec.seed, kUpdateNoise), spec.device)),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))),
          gradient_step_(spec.device, {noise_random_}) {
        if (config.distributional)
            support_ = atom_support(config.num_atoms, config.value_limit, torch::kFloat32).to(spec.device);
    }

    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool training = mode == ActMode::train;
        auto& random = training ? acting_random_ : evaluation_random_;
        const auto noise = training ? draw(acting_random_) : QNoise{};  // evaluation is free of noise
        const auto output = learner_.network(observations.to(spec_.device), training ? &noise : nullptr);
        const auto greedy = action_values(output, support_).argmax(1).cpu();
        return epsilon_greedy(greedy, training ? epsilon() : config_.epsilon.epsilon_eval, spec_.num_actions,
                              random);
    }

    void observe(const Experiences& seen) override { memory_.store(seen); }

    bool update(const torch::Tensor&) override {
        const auto decisions = memory_.next_decisions();
        if (!memory_.warm()) return false;
        const auto updates = decisions.multiples_of(config_.replay.update_period);
        for (std::int64_t i = 0; i < updates; ++i) learn();
        if (decisions.multiples_of(config_.target_update_period) > 0) learner_.copy_to_target();
        return updates > 0;
    }

    TimeSplit memory_time() const override { return memory_.time(); }

    std::map<std::string, double> metrics() override {
        std::map<std::string, double> values{{"charts/learning_rate", learner_.adam.learning_rate()},
                                             {"charts/epsilon", epsilon()}};
        if (!newest_.loss.defined()) return values;
        values[config_.distributional ? "losses/cross_entropy" : "losses/td_loss"] =
            newest_.per_transition.mean().item<double>();
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
    /// Noisy weights explore by themselves, from the first step on.
    double epsilon() const { return config_.noisy ? 0 : memory_.epsilon(config_.epsilon); }

    QNoise draw(const at::Generator& random) {
        return to(learner_.network->head->draw_noise(random), spec_.device);
    }

    void learn() {
        const auto batch = memory_.sample();
        gradient_step_([&] {
            const auto weights = config_.prioritised
                                     ? importance_weights(batch.probability, config_.importance_exponent)
                                     : torch::ones_like(batch.discount);
            const auto online = draw(noise_random_);  // the order of the draws is part of a run
            newest_ = der_update(learner_, batch, weights, {online, draw(noise_random_)}, config_);
        });
        if (config_.prioritised) memory_.set_priorities(batch, newest_.priorities);
    }

    StateParts parts() {
        StateParts parts;
        learner_.add_state(parts);
        parts.generators["random/acting"] = &acting_random_;
        parts.generators["random/update_noise"] = &noise_random_;
        parts.generators["random/evaluation"] = &evaluation_random_;
        memory_.add_state(parts);
        return parts;
    }

    DerConfig config_;
    AgentSpec spec_;
    QLearner learner_;
    ReplayMemory memory_;
    torch::Tensor support_;  // [atoms], if distributional
    at::Generator acting_random_, noise_random_, evaluation_random_;
    CapturedUpdate gradient_step_;
    DerLosses newest_;
};

}  // namespace

std::unique_ptr<Agent> make_der(const DerConfig& config, const AgentSpec& spec) {
    require_discrete("DER", spec);
    return std::make_unique<Der>(config, spec);
}

void check_memory(const DerConfig& config, const AgentSpec& spec, std::int64_t available) {
    const auto network = make_q_network(encoder_of(config), head_of(config, spec), spec, no_values());
    const NetworkMemory networks{parameter_bytes(*network), /*target=*/true,
                                 "agent.hidden_units or agent.num_atoms"};
    check_memory(config.replay, spec, config.prioritised, memory_beside(networks, spec, available));
}

}  // namespace cale
