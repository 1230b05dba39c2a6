#include "agents/sac.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>

#include <torch/torch.h>

#include "agents/random.h"
#include "agents/schedules.h"

namespace cale {

// Constants ---------------------------------------------------------------------------

namespace {

constexpr std::int64_t kActionSize = 3;  // r, theta, fire

enum Stream : std::uint64_t { kInitialValues, kActing, kReplay, kUpdateNoise, kEvaluation };

}  // namespace

std::span<const std::string_view> names_of(Exploration) {
    static constexpr std::array<std::string_view, 2> names{"standard", "epsilon_greedy"};
    return names;
}

std::span<const std::string_view> names_of(CriticTarget) {
    static constexpr std::array<std::string_view, 2> names{"target_mean_action", "sampled_action"};
    return names;
}

// Networks ----------------------------------------------------------------------------

SacNetworkImpl::SacNetworkImpl(const EncoderConfig& encoder_config, const HeadConfig& head_config,
                               at::Generator generator)
    : encoder(register_module("encoder", TwoBranchEncoder(encoder_config, generator))),
      actor(register_module("actor", Mlp(encoder->size(), 2 * kActionSize, head_config, generator))),
      critic(register_module("critic", TwinCritic(encoder->size(), kActionSize, head_config, generator))),
      box(joystick_box()) {
    register_buffer("box_centre", box.centre);
    register_buffer("box_half_width", box.half_width);
}

SquashedGaussian SacNetworkImpl::policy(const torch::Tensor& features) {
    return squashed_gaussian(actor(encoder->actor_branch(features)));
}

namespace {

std::vector<torch::Tensor> parameters_of(const torch::nn::Module& network, bool of_actor) {
    std::vector<torch::Tensor> chosen;
    for (const auto& parameter : network.named_parameters()) {
        const bool actor =
            parameter.key().starts_with("actor.") || parameter.key().starts_with("encoder.actor_");
        if (actor == of_actor) chosen.push_back(parameter.value());
    }
    return chosen;
}

}  // namespace

std::vector<torch::Tensor> SacNetworkImpl::actor_parameters() const {
    return parameters_of(*this, true);
}
std::vector<torch::Tensor> SacNetworkImpl::critic_parameters() const {
    return parameters_of(*this, false);
}

// Losses ------------------------------------------------------------------------------

namespace {

void require_shape(const char* name, const torch::Tensor& tensor, at::IntArrayRef expected) {
    if (tensor.defined() && tensor.sizes() == expected) return;
    const auto text = [](at::IntArrayRef shape) {
        std::string joined = "[";
        for (const auto size : shape) joined += (joined.size() > 1 ? ", " : "") + std::to_string(size);
        return joined + "]";
    };
    throw std::invalid_argument(std::string("sac_losses: ") + name + " must have the shape " +
                                text(expected) + ", not " +
                                (tensor.defined() ? text(tensor.sizes()) : "none at all"));
}

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
    const auto q = target->critic(target->encoder->critic_branch(features), valued_action).minimum();
    const auto soft_value = q - alpha * next.log_prob;
    return config.reward_scale * batch.n_step_return.to(q.dtype()) +
           batch.discount.to(q.dtype()) * soft_value;
}

}  // namespace

SacLosses sac_losses(SacNetwork& network, SacNetwork& target_network, const torch::Tensor& log_alpha,
                     const Batch& batch, const SacNoise& noise, const SacConfig& config) {
    const auto size = batch.observation.size(0);
    require_shape("log_alpha", log_alpha, {1});
    require_shape("the action", batch.action, {size, kActionSize});
    require_shape("the n-step return", batch.n_step_return, {size});
    require_shape("the discount", batch.discount, {size});
    require_shape("the next observation", batch.next_observation, batch.observation.sizes());
    require_shape("the target's noise", noise.target, {size, kActionSize});
    require_shape("the actor's noise", noise.actor, {size, kActionSize});

    const auto alpha = log_alpha.detach().exp();
    const auto y = target_values(network, target_network, alpha, batch, noise, config);

    // Critics, SAC's equation 5.
    const auto features = network->encoder->trunk(batch.observation);
    const auto critic_z = network->encoder->critic_branch(features);
    const auto q = network->critic(critic_z, batch.action.to(y.dtype()));
    const auto critic_loss = ((q.q1 - y).square() + (q.q2 - y).square()).mean();

    // Actor, SAC's equation 9, with the clipped double Q of its section 5.
    const auto pi = sample(network->policy(features), noise.actor, network->box);
    const auto q_pi = network->critic(critic_z.detach(), pi.action).minimum();
    const auto actor_loss = (alpha * pi.log_prob - q_pi).mean();

    // Temperature, SAC's equation 18, with log alpha in alpha's place, as its authors' code has it.
    const auto log_prob = pi.log_prob.detach();
    const auto alpha_loss = (log_alpha * (-log_prob - config.target_entropy)).mean();

    return {critic_loss, actor_loss, alpha_loss, q.q1.detach(), q.q2.detach(), y, log_prob};
}

SacLearner::SacLearner(SacNetwork network_, SacNetwork target_, torch::Tensor log_alpha_,
                       const SacConfig& config)
    : network(std::move(network_)),
      target(std::move(target_)),
      log_alpha(std::move(log_alpha_)),
      parameters(network->parameters()),
      target_parameters(target->parameters()),
      actor_parameters(network->actor_parameters()),
      critic_parameters(network->critic_parameters()),
      adam(parameters, {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}),
      alpha_adam({log_alpha}, {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}) {}

SacLosses sac_update(SacLearner& learner, const Batch& batch, const SacNoise& noise,
                     const SacConfig& config) {
    learner.adam.zero_grad();
    learner.alpha_adam.zero_grad();
    auto losses = sac_losses(learner.network, learner.target, learner.log_alpha, batch, noise, config);
    // The lists say where each gradient ends: the actor's loss leaves the critics alone.
    (0.5 * losses.critic)
        .backward({}, /*keep_graph=*/false, /*create_graph=*/false, learner.critic_parameters);
    losses.actor.backward({}, /*keep_graph=*/false, /*create_graph=*/false, learner.actor_parameters);
    losses.alpha.backward({}, /*keep_graph=*/false, /*create_graph=*/false, {{learner.log_alpha}});
    learner.adam.step();
    learner.alpha_adam.step();
    soft_update(learner.target_parameters, learner.parameters, config.tau);
    for (auto* loss : {&losses.critic, &losses.actor, &losses.alpha}) *loss = loss->detach();
    return losses;
}

// Agent -------------------------------------------------------------------------------

namespace {

EncoderConfig encoder_config(const SacConfig& config, const AgentSpec& spec) {
    return {config.encoder, config.phi_dqn, spec.stack, spec.frame_height, spec.frame_width};
}

ReplayConfig replay_config(const SacConfig& config, const AgentSpec& spec) {
    return {.capacity = config.replay_capacity,
            .num_envs = spec.num_envs,
            .stack = spec.stack,
            .frame_height = spec.frame_height,
            .frame_width = spec.frame_width,
            .action_size = kActionSize,
            .update_horizon = config.update_horizon,
            .gamma = config.gamma,
            .replay_terminal = config.replay_terminal};
}

SacLearner make_learner(const SacConfig& config, const AgentSpec& spec) {
    const auto make_network = [&] {
        SacNetwork network(encoder_config(config, spec),
                           HeadConfig{config.hidden_layers, config.hidden_units},
                           make_generator(stream_seed(spec.seed, kInitialValues)));
        network->to(spec.device);
        return network;
    };
    // The same seed makes the same network twice: the target starts equal to it.
    return {make_network(), make_network(),
            torch::zeros({1}, torch::dtype(torch::kFloat32).device(spec.device)).requires_grad_(), config};
}

class Sac final : public Agent {
  public:
    Sac(const SacConfig& config, const AgentSpec& spec)
        : config_(config),
          spec_(spec),
          learner_(make_learner(config, spec)),
          replay_(replay_config(config, spec)),
          sampled_(replay_.empty_batch(config.batch_size)),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          noise_random_(make_generator(stream_seed(spec.seed, kUpdateNoise))),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))),
          replay_random_(stream_seed(spec.seed, kReplay)) {}

    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool greedy = config_.exploration == Exploration::epsilon_greedy;
        if (mode == ActMode::evaluate) {
            auto actions = mean_action(policy(observations), learner_.network->box).cpu();
            if (greedy) randomise(actions, config_.epsilon_eval, evaluation_random_);
            return checked(std::move(actions));
        }
        const auto count = observations.size(0);
        if (greedy ? epsilon() >= 1 : !warm()) return uniform_actions(count, acting_random_);
        const auto noise = torch::randn({count, kActionSize}, acting_random_).to(spec_.device);
        auto actions = sample(policy(observations), noise, learner_.network->box).action.cpu();
        if (greedy) randomise(actions, epsilon(), acting_random_);
        return checked(std::move(actions));
    }

    void observe(const Experiences& seen) override {
        const auto frame_size = static_cast<std::size_t>(spec_.frame_height * spec_.frame_width);
        const auto count = static_cast<std::size_t>(spec_.num_envs);
        const auto actions = seen.actions.to(torch::kCPU, torch::kFloat32).contiguous();
        if (seen.results.size() != count || seen.frames.size() != count * frame_size ||
            actions.numel() != spec_.num_envs * kActionSize) {
            throw std::invalid_argument("Sac::observe expects the results, frames and actions of " +
                                        std::to_string(count) + " environments, not of " +
                                        std::to_string(seen.results.size()));
        }
        for (std::size_t env = 0; env < count; ++env) {
            const auto& result = seen.results[env];
            if (!std::isfinite(result.reward)) {
                throw std::invalid_argument("Sac::observe: the reward of environment " + std::to_string(env) +
                                            " is " + std::to_string(result.reward));
            }
            const auto frame_of = [&](std::span<const std::uint8_t> frames) {
                return frames.subspan(env * frame_size, frame_size);
            };
            Experience experience{.frame = frame_of(seen.frames),
                                  .action = {actions.data_ptr<float>() + env * kActionSize, kActionSize},
                                  .reward = clipped(result.reward),
                                  .terminal = result.terminal,
                                  .truncated = result.truncated,
                                  .final_frame = {}};
            if (result.truncated) experience.final_frame = frame_of(seen.final_frames);
            replay_.add(static_cast<std::int64_t>(env), experience);
        }
    }

    bool update() override {
        const auto due_before = [period = config_.update_period](std::int64_t step) {
            return (step + period - 1) / period;
        };
        const auto updates = due_before(training_steps_ + spec_.num_envs) - due_before(training_steps_);
        training_steps_ += spec_.num_envs;
        if (!warm() || replay_.size() == 0) return false;
        for (std::int64_t i = 0; i < updates; ++i) learn();
        return updates > 0;
    }

    std::map<std::string, double> metrics() override {
        std::map<std::string, double> values{{"charts/learning_rate", learner_.adam.learning_rate()}};
        if (config_.exploration == Exploration::epsilon_greedy) values["charts/epsilon"] = epsilon();
        if (!newest_.critic.defined()) return values;
        const auto mean = [](const torch::Tensor& x) { return x.mean().item<double>(); };
        values["losses/qf_loss"] = mean(newest_.critic);
        values["losses/qf1_values"] = mean(newest_.q1);
        values["losses/qf2_values"] = mean(newest_.q2);
        values["losses/actor_loss"] = mean(newest_.actor);
        values["losses/alpha_loss"] = mean(newest_.alpha);
        values["losses/entropy"] = -mean(newest_.log_prob);
        values["losses/alpha"] = std::exp(mean(learner_.log_alpha.detach()));
        return values;
    }

    TensorMap state() const override {
        TensorMap state;
        for (const auto& [name, tensor] : learned_tensors())
            state[name] = tensor.to(torch::kCPU, /*non_blocking=*/false, /*copy=*/true);
        state["training_steps"] = torch::tensor(training_steps_, torch::kInt64);
        state["random/acting"] = random_state(acting_random_);
        state["random/update_noise"] = random_state(noise_random_);
        state["random/evaluation"] = random_state(evaluation_random_);
        state["random/replay"] = random_state(replay_random_);
        return state;
    }

    void load_state(const TensorMap& state) override {
        const torch::NoGradGuard no_grad;
        const auto stored = [&state](const std::string& name) {
            const auto found = state.find(name);
            if (found == state.end()) throw std::runtime_error("the agent's state lacks '" + name + "'");
            return found->second;
        };
        const auto own = learned_tensors();
        for (const auto& [name, tensor] : own) {
            if (stored(name).sizes() != tensor.sizes()) {
                throw std::runtime_error("the agent's state holds '" + name +
                                         "' in another shape: it was saved with "
                                         "another configuration");
            }
        }
        // Everything is read before anything is changed.
        auto acting = restored_generator(stored("random/acting"));
        auto noise = restored_generator(stored("random/update_noise"));
        auto evaluation = restored_generator(stored("random/evaluation"));
        replay_random_ = restored_engine(stored("random/replay"));
        training_steps_ = stored("training_steps").item<std::int64_t>();
        acting_random_ = std::move(acting);
        noise_random_ = std::move(noise);
        evaluation_random_ = std::move(evaluation);
        for (const auto& [name, tensor] : own) tensor.copy_(stored(name));
        newest_ = {};
    }

    void save_memory(const std::string& path) const override { replay_.save(path); }
    void load_memory(const std::string& path) override {
        replay_.load(path);
        replay_.abandon_episodes();
    }

  private:
    bool warm() const { return replay_.add_count() > config_.min_replay; }

    double epsilon() const {
        return linearly_decaying_epsilon(config_.epsilon_decay_period, training_steps_, config_.min_replay,
                                         config_.epsilon_train);
    }

    float clipped(float reward) const {
        if (!config_.reward_clip) return reward;
        const auto limit = static_cast<float>(*config_.reward_clip);
        return std::clamp(reward, -limit, limit);
    }

    SquashedGaussian policy(const torch::Tensor& observations) {
        auto& network = learner_.network;
        return network->policy(network->encoder->trunk(observations.to(spec_.device)));
    }

    /// Coordinates are independent: uniform in (r, theta), not on the disc.
    torch::Tensor uniform_actions(std::int64_t count, at::Generator random) const {
        return box_.centre + box_.half_width * (2 * torch::rand({count, kActionSize}, random) - 1);
    }

    /// Replaces each action, with this probability, by a uniform one.
    void randomise(torch::Tensor& actions, double probability, at::Generator random) const {
        const auto chosen = torch::rand({actions.size(0), 1}, random) <= probability;
        actions = torch::where(chosen, uniform_actions(actions.size(0), random), actions);
    }

    torch::Tensor checked(torch::Tensor actions) const {
        if (actions.isfinite().all().item<bool>()) return actions;
        throw std::runtime_error("the actor's output is not finite after " + std::to_string(training_steps_) +
                                 " training steps: training has diverged, try a lower learning_rate");
    }

    void learn() {
        replay_.sample_into(sampled_, replay_random_);
        const auto on_device = [this](const torch::Tensor& tensor) { return tensor.to(spec_.device); };
        const Batch batch{.observation = on_device(sampled_.observation),
                          .action = on_device(sampled_.action),
                          .n_step_return = on_device(sampled_.n_step_return),
                          .discount = on_device(sampled_.discount),
                          .next_observation = on_device(sampled_.next_observation),
                          .index = sampled_.index};
        const auto noise = on_device(torch::randn({2, config_.batch_size, kActionSize}, noise_random_));
        newest_ = sac_update(learner_, batch, {noise[0], noise[1]}, config_);
    }

    /// What is trained, under the names of state(), sharing memory with it.
    TensorMap learned_tensors() const {
        TensorMap tensors{{"log_alpha", learner_.log_alpha.detach()}};
        const auto add = [&tensors](const std::string& prefix, const auto& named) {
            for (const auto& [name, tensor] : named) tensors[prefix + name] = tensor.detach();
        };
        const auto parameters = [](const SacNetwork& network) {
            TensorMap named;
            for (const auto& parameter : network->named_parameters())
                named[parameter.key()] = parameter.value();
            return named;
        };
        add("network/", parameters(learner_.network));
        add("target/", parameters(learner_.target));
        add("adam/", learner_.adam.state());
        add("alpha_adam/", learner_.alpha_adam.state());
        return tensors;
    }

    SacConfig config_;
    AgentSpec spec_;
    SacLearner learner_;
    ReplayBuffer replay_;
    Batch sampled_;  // filled anew by every update
    ActionBox box_ = joystick_box();
    at::Generator acting_random_, noise_random_, evaluation_random_;
    std::mt19937_64 replay_random_;
    std::int64_t training_steps_ = 0;  // decisions
    SacLosses newest_;
};

}  // namespace

std::unique_ptr<Agent> make_sac(const SacConfig& config, const AgentSpec& spec) {
    if (spec.num_actions != 0) {
        throw std::invalid_argument("SAC acts on the continuous joystick; this world has " +
                                    std::to_string(spec.num_actions) +
                                    " discrete actions (set action_space: continuous)");
    }
    return std::make_unique<Sac>(config, spec);
}

}  // namespace cale
