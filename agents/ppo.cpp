#include "agents/ppo.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

#include <torch/types.h>
#include <torch/utils.h>

#include "agents/action_metrics.h"
#include "agents/advantages.h"
#include "agents/captured_update.h"
#include "agents/env_share.h"
#include "agents/memory.h"
#include "agents/random.h"
#include "agents/repeated_frame.h"
#include "agents/state.h"
#include "networks/shapes.h"

namespace cale {

// Constants ---------------------------------------------------------------------------

namespace {

constexpr std::int64_t kActionSize = 3;  // r, theta, fire

enum Stream : std::uint64_t { kInitialValues, kActing, kShuffling, kEvaluation };

std::vector<torch::Tensor> gradients_of(const std::vector<torch::Tensor>& parameters) {
    std::vector<torch::Tensor> gradients;
    for (const auto& parameter : parameters) gradients.push_back(parameter.grad());
    return gradients;
}

}  // namespace

std::span<const std::string_view> names_of(Minibatches) {
    static constexpr std::array<std::string_view, 2> names{"shuffled", "contiguous"};
    return names;
}

std::span<const std::string_view> names_of(StackAfterUpdate) {
    static constexpr std::array<std::string_view, 2> names{"correct", "repeated"};
    return names;
}

// Losses ------------------------------------------------------------------------------

PpoLosses ppo_losses(PpoNetwork& network, const PpoMinibatch& minibatch, const PpoConfig& config,
                     const ProcessGroup& processes) {
    const auto size = minibatch.observation.size(0);
    require_shape("ppo_losses", "the old log-probability", minibatch.old_log_prob, {size});
    require_shape("ppo_losses", "the old value", minibatch.old_value, {size});
    require_shape("ppo_losses", "the advantage", minibatch.advantage, {size});
    require_shape("ppo_losses", "the return", minibatch.returns, {size});

    const auto [policy, value] = network(minibatch.observation);
    if (policy.gaussian) {
        require_shape("ppo_losses", "the action", minibatch.action, {size, kActionSize});
    } else {
        require_shape("ppo_losses", "the action", minibatch.action, {size});
    }
    const auto new_log_prob = log_prob(policy, minibatch.action, network->box);

    // PPO's equation 7, on advantages that are normalised over the minibatch of all processes.
    const auto whole = moments(minibatch.advantage, processes);
    const auto mean = [&](const torch::Tensor& part) {
        return part.sum() / static_cast<double>(whole.count);
    };
    const auto advantage = (minibatch.advantage - whole.mean) / (whole.deviation + 1e-8);
    const auto log_ratio = new_log_prob - minibatch.old_log_prob;
    const auto ratio = log_ratio.exp();
    const auto actor =
        -mean(torch::minimum(ratio * advantage, ratio.clamp(1 - config.clip, 1 + config.clip) * advantage));

    // PPO's equation 9: the squared error, of which the larger with and without clipping counts.
    auto squared_error = (value - minibatch.returns).square();
    if (config.clip_value_loss) {
        const auto moved = (value - minibatch.old_value).clamp(-config.clip, config.clip);
        squared_error =
            torch::maximum(squared_error, (minibatch.old_value + moved - minibatch.returns).square());
    }
    const auto critic = 0.5 * mean(squared_error);
    const auto mean_entropy = mean(entropy(policy));

    const auto combined =
        actor + config.value_coefficient * critic - config.entropy_coefficient * mean_entropy;
    const auto change = ratio.detach() - 1;
    return {combined,
            actor.detach(),
            critic.detach(),
            mean_entropy.detach(),
            mean(change - log_ratio.detach()),
            mean((change.abs() > config.clip).to(ratio.dtype()))};
}

PpoLearner::PpoLearner(PpoNetwork network_, std::int64_t anneal_steps_, const PpoConfig& config)
    : network(std::move(network_)),
      parameters(network->parameters()),
      adam(parameters, {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}),
      anneal_steps(anneal_steps_) {}

void PpoLearner::anneal(const PpoConfig& config) {
    if (anneal_steps > 0) {
        const auto part = static_cast<double>(gradient_steps) / static_cast<double>(anneal_steps);
        adam.set_learning_rate(config.learning_rate * std::max(0.0, 1 - part));
    }
    ++gradient_steps;
}

PpoLosses ppo_gradient_step(PpoLearner& learner, const PpoMinibatch& minibatch, const PpoConfig& config,
                            const ProcessGroup& processes) {
    learner.adam.zero_grad();
    auto losses = ppo_losses(learner.network, minibatch, config, processes);
    losses.combined.backward();
    if (!processes.alone()) processes.sum(gradients_of(learner.parameters));
    clip_gradient_norm(learner.parameters, config.max_gradient_norm);
    learner.adam.step();
    losses.combined = losses.combined.detach();
    return losses;
}

PpoLosses ppo_update(PpoLearner& learner, const PpoMinibatch& minibatch, const PpoConfig& config) {
    learner.anneal(config);
    return ppo_gradient_step(learner, minibatch, config);
}

// Agent -------------------------------------------------------------------------------

namespace {

PpoNetwork make_network(const PpoConfig& config, const AgentSpec& spec, const at::Generator& generator) {
    return PpoNetwork(PpoNetworkConfig{.encoder = config.network.encoder_for(spec),
                                       .torso = config.torso,
                                       .hidden_layers = config.network.hidden_layers,
                                       .hidden_units = config.network.hidden_units,
                                       .log_std = config.log_std},
                      spec.num_actions, generator);
}

PpoLearner make_learner(const PpoConfig& config, const AgentSpec& spec) {
    auto network = make_network(config, spec, make_generator(stream_seed(spec.seed, kInitialValues)));
    network->to(spec.device);
    const auto per_rollout = config.epochs * (config.rollout_steps / config.minibatch_size);
    const auto whole_run = std::max<std::int64_t>(spec.total_steps / config.rollout_steps * per_rollout, 1);
    const auto anneal_steps = schedule_over_run(config).empty() ? config.anneal_steps : whole_run;
    return {network, config.anneal_learning_rate ? anneal_steps : 0, config};
}

class Ppo final : public Agent {
  public:
    Ppo(const PpoConfig& config, const AgentSpec& spec)
        : config_(config),
          spec_(spec),
          learner_(make_learner(config, spec)),
          share_(spec),
          rollout_({.length = config.rollout_steps / share_.all,
                    .num_envs = spec.num_envs,
                    .stack = spec.stack,
                    .frame_height = spec.frame_height,
                    .frame_width = spec.frame_width,
                    .action_size = spec.num_actions == 0 ? kActionSize : 0,
                    .reward_scale = config.reward_scale,
                    .reward_clip = config.reward_clip,
                    .replay_terminal = config.replay_terminal}),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          shuffling_random_(make_generator(stream_seed(spec.seed, kShuffling))),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))),
          // A message to other processes cannot be part of a recording.
          gradient_step_(spec.processes.alone() ? spec.device : torch::Device(torch::kCPU), {}) {}

    torch::Tensor act(const torch::Tensor& seen, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool training = mode == ActMode::train;
        auto& random = training ? acting_random_ : evaluation_random_;
        const auto observations = training && repeats() ? repeated_frame_.next(seen) : seen;
        if (training) rollout_.set_observations(observations);
        // The policy is sampled in evaluation too, as the reference does.
        const auto policy = learner_.network(observations.to(spec_.device)).policy;
        const auto share = training ? share_ : EnvShare(observations.size(0));
        auto actions = sampled(policy, share, random);
        if (config_.exploration == Exploration::standard) return actions;
        const auto epsilon = training ? this->epsilon() : config_.epsilon.epsilon_eval;
        actions = share.among_all(actions, /*filler=*/0);
        return share.own(policy.gaussian ? epsilon_greedy(actions, epsilon, box_, random)
                                         : epsilon_greedy(actions, epsilon, spec_.num_actions, random));
    }

    void observe(const Experiences& seen) override {
        rollout_.add(seen.actions, seen.results, seen.final_frames);
        training_steps_ += share_.all;
        if (repeats()) repeated_frame_.remember(seen.frames, seen.results[0]);
    }

    bool update(const torch::Tensor& observations) override {
        if (!rollout_.full()) return false;
        learn(rollout_.next_observation.defined() ? rollout_.next_observation : observations);
        rollout_.clear();
        if (repeats()) repeated_frame_.push();
        return true;
    }

    std::map<std::string, double> metrics() override {
        auto values = newest_;
        values["charts/learning_rate"] = learner_.adam.learning_rate();
        if (config_.exploration == Exploration::epsilon_greedy) values["charts/epsilon"] = epsilon();
        return values;
    }

    std::optional<AgentPolicy> policy() const override {
        const bool uniform = config_.exploration == Exploration::epsilon_greedy;
        return policy_of_network(learner_.network, /*samples=*/true,
                                 uniform ? config_.epsilon.epsilon_eval : 0);
    }

    TensorMap state() override {
        auto state = saved(parts());
        add_part(state, "rollout/", joined_rollouts(spec_.processes.gather(rollout_.state())));
        if (repeats()) add_part(state, "repeated_frame/", repeated_frame_.state());
        return state;
    }
    void load_state(const TensorMap& state) override {
        Rollout rollout(rollout_.config);  // so that nothing has changed if a part is missing
        rollout.restore(share_of_rollout(part_of(state, "rollout/"), share_));
        auto repeated_frame = repeated_frame_;
        if (repeats()) repeated_frame.restore(part_of(state, "repeated_frame/"));
        restore(parts(), state);
        if (learner_.gradient_steps > 0) {  // the learning rate is that of the newest gradient step again
            --learner_.gradient_steps;
            learner_.anneal(config_);
        }
        rollout_ = std::move(rollout);
        repeated_frame_ = std::move(repeated_frame);
        newest_.clear();
        gradient_step_.forget();
    }

  private:
    bool repeats() const { return config_.stack_after_update == StackAfterUpdate::repeated; }

    double epsilon() const {
        return linearly_decaying_epsilon(config_.epsilon.epsilon_decay_period, training_steps_, 0,
                                         config_.epsilon.epsilon_train);
    }

    torch::Tensor sampled(const PpoPolicy& policy, const EnvShare& share, at::Generator& random) {
        if (!policy.gaussian) {
            const auto pi = share.among_all(policy.log_pi.exp().cpu(), /*filler=*/1);
            return share.own(pi.multinomial(1, true, random).squeeze(1));
        }
        const auto noise = share.own(torch::randn({share.all, kActionSize}, random)).to(spec_.device);
        return sample(*policy.gaussian, noise, learner_.network->box).action.cpu();
    }

    torch::Tensor values(const torch::Tensor& observations) {
        return learner_.network(observations.to(spec_.device)).value;
    }

    /// The rollout as one batch of T x N steps, with everything that is fixed before the update.
    PpoMinibatch prepared(const torch::Tensor& next_observations) {
        const torch::NoGradGuard no_grad;
        PpoMinibatch all;
        all.observation = rollout_.observation.flatten(0, 1).to(spec_.device);
        all.action = rollout_.action.flatten(0, 1).to(spec_.device);
        std::vector<torch::Tensor> log_probs, old_values;
        for (std::int64_t first = 0; first < all.observation.size(0); first += config_.minibatch_size) {
            const auto part = [&](const torch::Tensor& whole) {
                return whole.slice(0, first, first + config_.minibatch_size);
            };
            const auto [policy, value] = learner_.network(part(all.observation));
            log_probs.push_back(log_prob(policy, part(all.action), learner_.network->box));
            old_values.push_back(value);
        }
        all.old_log_prob = torch::cat(log_probs);
        all.old_value = torch::cat(old_values);
        const auto rewards = rollout_.reward.clone();
        for (const auto& cut : rollout_.truncations)
            rewards[cut.step][cut.env] +=
                config_.gamma * values(cut.observation.unsqueeze(0))[0].item<float>();
        const auto estimate = generalized_advantages(
            rewards.to(spec_.device), rollout_.terminal.to(spec_.device), all.old_value.view_as(rewards),
            values(next_observations), config_.gamma, config_.gae_lambda);
        all.advantage = estimate.advantage.flatten();
        all.returns = estimate.returns.flatten();
        return all;
    }

    void learn(const torch::Tensor& next_observations) {
        const auto all = prepared(next_observations);
        const auto parts = config_.rollout_steps / config_.minibatch_size;
        const auto contiguous =
            (torch::randperm(parts, shuffling_random_, torch::kInt64).unsqueeze(1) * config_.minibatch_size +
             torch::arange(config_.minibatch_size));
        torch::Tensor sums = torch::zeros({6}, torch::dtype(torch::kFloat32).device(spec_.device));
        for (std::int64_t epoch = 0; epoch < config_.epochs; ++epoch) {
            const auto order = config_.minibatches == Minibatches::contiguous
                                   ? contiguous
                                   : torch::randperm(config_.rollout_steps, shuffling_random_, torch::kInt64)
                                         .view({parts, -1});
            for (const auto& rows : order.to(spec_.device).unbind()) {
                choose(all, share_.own_rows(rows));
                learner_.anneal(config_);
                gradient_step_(
                    [&] { losses_ = ppo_gradient_step(learner_, minibatch_, config_, spec_.processes); });
                sums += torch::stack({losses_.combined, losses_.actor, losses_.critic, losses_.entropy,
                                      losses_.approximate_kl, losses_.clipped_fraction});
            }
        }
        spec_.processes.sum({sums});
        remember(sums / (config_.epochs * parts), all);
    }

    /// Copies these rows to minibatch_, which stays in its place in memory while their number does.
    void choose(const PpoMinibatch& all, const torch::Tensor& rows) {
        for (const auto part :
             {&PpoMinibatch::observation, &PpoMinibatch::action, &PpoMinibatch::old_log_prob,
              &PpoMinibatch::old_value, &PpoMinibatch::advantage, &PpoMinibatch::returns}) {
            auto& chosen = minibatch_.*part;
            if (!chosen.defined() || chosen.size(0) != rows.size(0))
                chosen = torch::empty({0}, (all.*part).options());
            at::index_select_out(chosen, all.*part, 0, rows);
        }
    }

    void remember(const torch::Tensor& means, const PpoMinibatch& all) {
        const auto variance = [&](const torch::Tensor& part) {
            return moments(part, spec_.processes).deviation.square();
        };
        const auto unexplained = variance(all.returns - all.old_value) / (variance(all.returns) + 1e-8);
        const auto numbers = torch::cat({means, (1 - unexplained).view({1})}).cpu();
        std::int64_t i = 0;
        for (const auto* tag :
             {"loss", "policy_loss", "value_loss", "entropy", "approx_kl", "clipfrac", "explained_variance"})
            newest_["losses/" + std::string(tag)] = numbers[i++].item<double>();
        if (all.action.dim() == 1) return;
        std::vector<torch::Tensor> coordinates;
        for (const auto& coordinate : all.action.unbind(1))
            coordinates.push_back(moments(coordinate, spec_.processes).mean);
        add_mean_action(newest_, torch::stack(coordinates));
    }

    StateParts parts() {
        StateParts parts;
        parts.add("network/", *learner_.network);
        parts.add("adam/", learner_.adam.state());
        parts.generators["random/acting"] = &acting_random_;
        parts.generators["random/shuffling"] = &shuffling_random_;
        parts.generators["random/evaluation"] = &evaluation_random_;
        parts.counters["training_steps"] = &training_steps_;
        parts.counters["gradient_steps"] = &learner_.gradient_steps;
        return parts;
    }

    PpoConfig config_;
    AgentSpec spec_;
    PpoLearner learner_;
    ActionBox box_ = joystick_box();
    EnvShare share_;
    Rollout rollout_;
    std::int64_t training_steps_ = 0;
    RepeatedFrame repeated_frame_;
    at::Generator acting_random_, shuffling_random_, evaluation_random_;
    CapturedUpdate gradient_step_;
    PpoMinibatch minibatch_;
    PpoLosses losses_;
    std::map<std::string, double> newest_;
};

}  // namespace

void check_settings(const PpoConfig& config, const AgentSpec& spec) {
    const auto require_multiple = [&](std::int64_t of, const std::string& name) {
        if (config.rollout_steps % of == 0) return;
        throw std::invalid_argument("agent.rollout_steps is " + std::to_string(config.rollout_steps) +
                                    ", which is no multiple of " + name + " = " + std::to_string(of) +
                                    "; change one of the two");
    };
    if (spec.overlap)
        throw std::invalid_argument(
            "train.overlap: ppo learns only from the steps of its newest policy, so its environments cannot "
            "step while it learns; set train.overlap to false");
    const auto all_envs = spec.num_envs * spec.processes.size();
    if (config.stack_after_update == StackAfterUpdate::repeated && all_envs != 1)
        throw std::invalid_argument("agent.stack_after_update: repeated is for env.num_envs = 1, not " +
                                    std::to_string(all_envs));
    if (config.replay_terminal == ReplayTerminal::dopamine && all_envs != 1)
        throw std::invalid_argument("agent.replay_terminal: dopamine is a rule for env.num_envs = 1, not " +
                                    std::to_string(all_envs));
    require_multiple(all_envs, "env.num_envs");
    require_multiple(config.minibatch_size, "agent.minibatch_size");
}

std::string_view schedule_over_run(const PpoConfig& config) {
    return config.anneal_learning_rate && config.anneal_steps == 0 ? "agent.anneal_learning_rate" : "";
}

std::unique_ptr<Agent> make_ppo(const PpoConfig& config, const AgentSpec& spec) {
    check_settings(config, spec);
    return std::make_unique<Ppo>(config, spec);
}

void check_memory(const PpoConfig& config, const AgentSpec& spec, std::int64_t available) {
    const auto network = make_network(config, spec, no_values());
    const auto left = memory_beside(
        {parameter_bytes(*network), /*target=*/false, "agent.hidden_units or agent.hidden_layers"}, spec,
        available);
    // A second time where a checkpoint is written.
    const auto rollout =
        2 * config.rollout_steps / spec.processes.size() * spec.stack * spec.frame_height * spec.frame_width;
    if (rollout > left) refuse_memory("the rollout", rollout, left, "lower agent.rollout_steps");
}

}  // namespace cale
