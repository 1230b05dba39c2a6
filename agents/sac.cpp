#include "agents/sac.h"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include <torch/types.h>
#include <torch/utils.h>

#include "agents/action_metrics.h"
#include "agents/captured_update.h"
#include "agents/memory.h"
#include "agents/random.h"
#include "agents/state.h"
#include "networks/shapes.h"

namespace cale {

// Constants ---------------------------------------------------------------------------

namespace {

constexpr std::int64_t kActionSize = 3;  // r, theta, fire

enum Stream : std::uint64_t { kInitialValues, kActing, kReplay, kUpdateNoise, kEvaluation };

}  // namespace

std::span<const std::string_view> names_of(CriticTarget) {
    static constexpr std::array<std::string_view, 2> names{"target_mean_action", "sampled_action"};
    return names;
}

// Losses ------------------------------------------------------------------------------

namespace {

/// y of SAC's equation 3: the reward and the soft value of what follows.
torch::Tensor target_values(SacNetwork& network, SacNetwork& target, const torch::Tensor& alpha,
                            const Batch& batch, const SacNoise& noise, const SacConfig& config) {
    const torch::NoGradGuard no_grad;
    const auto features = target->encoder->trunk(batch.next_observation);
    PolicySample next;
    torch::Tensor valued_action;
    if (config.critic_target == CriticTarget::target_mean_action) {
        const auto policy = target->policy(features);
        next = sample(policy, noise.target, target->box);
        valued_action = mean_action(policy, target->box);
    } else {
        next = sample(network->policy(network->encoder->trunk(batch.next_observation)), noise.target,
                      network->box);
        valued_action = next.action;
    }
    const auto q = target->values(target->encoder->critic_branch(features), valued_action).minimum();
    const auto soft_value = q - alpha * next.log_prob;
    return config.replay.reward_scale * batch.n_step_return.to(q.dtype()) +
           batch.discount.to(q.dtype()) * soft_value;
}

}  // namespace

SacLosses sac_losses(SacNetwork& network, SacNetwork& target_network, const torch::Tensor& log_alpha,
                     const Batch& batch, const SacNoise& noise, const SacConfig& config) {
    const auto size = batch.observation.size(0);
    require_shape("sac_losses", "log_alpha", log_alpha, {1});
    require_shape("sac_losses", "the action", batch.action, {size, kActionSize});
    require_shape("sac_losses", "the n-step return", batch.n_step_return, {size});
    require_shape("sac_losses", "the discount", batch.discount, {size});
    require_shape("sac_losses", "the next observation", batch.next_observation, batch.observation.sizes());
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
            q.q2.detach(), y,          log_prob,   mean_action(policy, network->box).detach()};
}

SacLosses sac_update(SacLearner& learner, const Batch& batch, const SacNoise& noise,
                     const SacConfig& config) {
    auto losses = sac_losses(learner.network, learner.target, learner.log_alpha, batch, noise, config);
    learner.step(0.5 * losses.critic, losses.actor, losses.alpha, config.tau);
    for (auto* loss : {&losses.critic, &losses.actor, &losses.alpha}) *loss = loss->detach();
    return losses;
}

// Agent -------------------------------------------------------------------------------

namespace {

SacLearner make_learner(const SacConfig& config, const AgentSpec& spec) {
    const auto make_network = [&] {
        SacNetwork network(config.network.encoder_for(spec), config.network.head(),
                           make_generator(stream_seed(spec.seed, kInitialValues)));
        network->to(spec.device);
        return network;
    };
    // The same seed makes the same network twice: the target starts equal to it.
    return {make_network(),
            make_network(),
            torch::zeros({1}, torch::dtype(torch::kFloat32).device(spec.device)).requires_grad_(),
            {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}};
}

class Sac final : public Agent {
  public:
    Sac(const SacConfig& config, const AgentSpec& spec)
        : config_(config),
          spec_(spec),
          learner_(make_learner(config, spec)),
          memory_(config.replay, spec, /*prioritised=*/false, stream_seed(spec.seed, kReplay)),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          noise_random_(make_generator(stream_seed(spec.seed, kUpdateNoise), spec.device)),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))),
          gradient_step_(spec.device, {noise_random_}) {}

    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool greedy = config_.exploration == Exploration::epsilon_greedy;
        if (mode == ActMode::evaluate) {
            const auto actions = checked(mean_action(policy(observations), learner_.network->box).cpu());
            if (!greedy) return actions;
            return epsilon_greedy(actions, config_.epsilon.epsilon_eval, box_, evaluation_random_);
        }
        const auto epsilon = memory_.epsilon(config_.epsilon);
        const auto count = observations.size(0);
        if (greedy ? epsilon >= 1 : !memory_.warm()) return uniform_actions(box_, count, acting_random_);
        const auto noise = torch::randn({count, kActionSize}, acting_random_).to(spec_.device);
        const auto actions = checked(sample(policy(observations), noise, learner_.network->box).action.cpu());
        return greedy ? epsilon_greedy(actions, epsilon, box_, acting_random_) : actions;
    }

    void observe(const Experiences& seen) override { memory_.store(seen); }

    bool update(const torch::Tensor&) override {
        const auto updates = memory_.next_decisions().multiples_of(config_.replay.update_period);
        if (!memory_.warm()) return false;
        for (std::int64_t i = 0; i < updates; ++i) {
            const auto batch = memory_.sample();
            gradient_step_([&] {
                const auto noise =
                    torch::randn({2, config_.replay.batch_size, kActionSize}, noise_random_, spec_.device);
                newest_ = sac_update(learner_, batch, {noise[0], noise[1]}, config_);
            });
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
        values["losses/entropy"] = -mean(newest_.log_prob);
        values["losses/alpha"] = std::exp(mean(learner_.log_alpha.detach()));
        add_mean_action(values, newest_.mean_action.mean(0));
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
    SquashedGaussian policy(const torch::Tensor& observations) {
        auto& network = learner_.network;
        return network->policy(network->encoder->trunk(observations.to(spec_.device)));
    }

    torch::Tensor checked(torch::Tensor actions) const {
        if (actions.isfinite().all().item<bool>()) return actions;
        throw std::runtime_error("the actor's output is not finite after " +
                                 std::to_string(memory_.decisions()) +
                                 " training steps: training has diverged, try a lower learning_rate");
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

    SacConfig config_;
    AgentSpec spec_;
    SacLearner learner_;
    ReplayMemory memory_;
    ActionBox box_ = joystick_box();
    at::Generator acting_random_, noise_random_, evaluation_random_;
    CapturedUpdate gradient_step_;
    SacLosses newest_;
};

}  // namespace

std::unique_ptr<Agent> make_sac(const SacConfig& config, const AgentSpec& spec) {
    require_continuous("SAC", spec);
    return std::make_unique<Sac>(config, spec);
}

void check_memory(const SacConfig& config, const AgentSpec& spec, std::int64_t available) {
    const SacNetwork network(config.network.encoder_for(spec), config.network.head(), no_values());
    const NetworkMemory networks{parameter_bytes(*network), /*target=*/true,
                                 "agent.hidden_units or agent.hidden_layers"};
    check_memory(config.replay, spec, /*prioritised=*/false, memory_beside(networks, spec, available));
}

}  // namespace cale
