#include "agents/on_policy.h"

#include <algorithm>
#include <future>
#include <map>
#include <stdexcept>
#include <utility>

#include <torch/types.h>
#include <torch/utils.h>

#include "agents/advantages.h"
#include "agents/captured_update.h"
#include "agents/env_share.h"
#include "agents/random.h"
#include "agents/state.h"
#include "dopamine/repeated_frame.h"
#include "dopamine/rollout.h"
#include "networks/discrete_actions.h"
#include "parallel/process_group.h"

namespace cale {
namespace {

/// The random streams of an agent. Their numbers are part of a run: another number is another seed.
enum Stream : std::uint64_t { kInitialValues, kActing, kShuffling, kEvaluation };

/// Returns the group of an agent's processes; a single process if there is none.
ProcessGroup group_of(const ProcessGroup* processes) {
    return processes != nullptr ? *processes : ProcessGroup();
}

}  // namespace

std::span<const std::string_view> names_of(Minibatches) {
    static constexpr std::string_view names[] = {"shuffled", "contiguous"};
    return names;
}

std::span<const std::string_view> names_of(StackAfterUpdate) {
    static constexpr std::string_view names[] = {"correct", "repeated"};
    return names;
}

// Gradient steps ----------------------------------------------------------------------

RolloutBatch normalized(RolloutBatch batch, const ProcessGroup* processes) {
    const auto global = moments(batch.advantage, group_of(processes));
    batch.advantage = (batch.advantage - global.mean) / (global.deviation + 1e-8);
    if (batch.importance.defined()) batch.advantage = batch.advantage * batch.importance;
    batch.global_size = global.count;
    return batch;
}

OnPolicyState::OnPolicyState(PpoNetwork new_network, std::int64_t annealing_steps,
                             const OnPolicySettings& settings)
    : network(std::move(new_network)),
      parameters(network->parameters()),
      adam(parameters, {.learning_rate = settings.learning_rate, .epsilon = settings.adam_epsilon}),
      learning_rate(settings.learning_rate),
      max_gradient_norm(settings.max_gradient_norm),
      annealed_over(annealing_steps) {}

void OnPolicyState::anneal(std::int64_t gradient_step) {
    if (annealed_over == 0) return;
    const auto part = static_cast<double>(gradient_step) / static_cast<double>(annealed_over);
    adam.set_learning_rate(learning_rate * std::max(0.0, 1 - part));
}

void OnPolicyState::step(torch::Tensor& loss, const ProcessGroup* processes) {
    adam.zero_grad();
    loss.backward();
    if (processes != nullptr) processes->sum(gradients_of(parameters));
    clip_gradient_norm(parameters, max_gradient_norm);
    adam.step();
    loss = loss.detach();
}

// Agent -------------------------------------------------------------------------------

PpoNetwork make_network(const OnPolicySettings& settings, const AgentSpec& spec,
                        const at::Generator& generator) {
    return PpoNetwork(PpoNetworkConfig{.encoder = settings.network.encoder_for(spec),
                                       .torso = settings.torso,
                                       .hidden_layers = settings.network.hidden_layers,
                                       .hidden_units = settings.network.hidden_units,
                                       .log_std = settings.log_std,
                                       .layer_norm = settings.network.layer_norm},
                      num_actions(spec.action_space), generator, action_box(spec.action_space));
}

namespace {

/// The same values in every call.
PpoNetwork initial_network(const OnPolicySettings& settings, const AgentSpec& spec) {
    auto network = make_network(settings, spec, make_generator(stream_seed(spec.seed, kInitialValues)));
    network->to(spec.device);
    return network;
}

OnPolicyState initial_state(const OnPolicySettings& settings, const AgentSpec& spec) {
    const auto per_rollout = settings.epochs * (settings.rollout_steps / settings.minibatch_size);
    const auto whole_run = std::max<std::int64_t>(spec.total_steps / settings.rollout_steps * per_rollout, 1);
    const auto annealed_over = schedule_over_run(settings).empty() ? settings.anneal_steps : whole_run;
    return {initial_network(settings, spec), settings.anneal_learning_rate ? annealed_over : 0, settings};
}

class OnPolicy final : public Agent {
  public:
    OnPolicy(const OnPolicySettings& settings, const AgentSpec& spec, OnPolicyLosses losses,
             const std::vector<std::string>& names)
        : settings_(settings),
          spec_(spec),
          losses_(std::move(losses)),
          names_(names),
          processes_(group_of(spec.processes)),
          share_(spec),
          state_(initial_state(settings, spec)),
          acting_(spec.overlap ? initial_network(settings, spec) : state_.network),
          box_(action_box(spec.action_space)),
          rollout_(empty_rollout()),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          shuffling_random_(make_generator(stream_seed(spec.seed, kShuffling))),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))),
          // A message to other processes cannot be part of a recording, nor may anything run beside one.
          gradient_step_(processes_.single() && !spec.overlap ? spec.device : torch::Device(torch::kCPU), {}),
          newest_{{"charts/learning_rate", state_.adam.learning_rate()}} {}

    torch::Tensor act(const torch::Tensor& seen, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool training = mode == ActMode::train;
        auto& random = training ? acting_random_ : evaluation_random_;
        const auto observations = training && repeats() ? repeated_frame_.next(seen) : seen;
        if (training)
            rollout_->set_observations(observations);
        else
            finish_learning();
        // The policy is sampled in evaluation too, as the reference does.
        auto& network = training ? acting_ : state_.network;
        const auto policy = network(observations.to(spec_.device)).policy;
        const auto share = training ? share_ : EnvShare(observations.size(0));
        auto actions = sampled(policy, share, random);
        const auto epsilon = this->epsilon(mode);
        if (!epsilon) return actions;
        actions = share.among_all(actions, /*filler=*/0);
        return share.own(policy.gaussian
                             ? epsilon_greedy(actions, *epsilon, box_, random)
                             : epsilon_greedy(actions, *epsilon, num_actions(spec_.action_space), random));
    }

    void observe(const StepBatch& batch) override {
        rollout_->add(batch.actions, batch.results, batch.final_frames);
        training_steps_ += share_.all;
        if (repeats()) repeated_frame_.remember(batch.frames, batch.results[0]);
    }

    bool update(const torch::Tensor& observations) override {
        if (!rollout_->full()) return false;
        finish_learning();
        const auto whole =
            whole_rollout(rollout_->next_observation.defined() ? rollout_->next_observation : observations);
        rollout_->clear();
        if (repeats()) repeated_frame_.push();
        if (spec_.overlap) {
            hard_update(acting_->parameters(), state_.parameters);
            learning_ = std::async(std::launch::async, [this, whole] { return learn(whole); });
        } else {
            newest_ = learn(whole);
        }
        return true;
    }

    std::map<std::string, double> metrics() override {
        finish_learning();  // so that a row does not depend on when there was a checkpoint
        auto values = newest_;
        if (const auto epsilon = this->epsilon(ActMode::train)) values["charts/epsilon"] = *epsilon;
        return values;
    }

    std::optional<AgentPolicy> policy() const override {
        if (learning_.valid()) learning_.wait();
        return policy_of(state_.network, /*samples=*/true, epsilon(ActMode::evaluate).value_or(0));
    }

    TensorMap state() override {
        finish_learning();
        auto state = saved(parts());
        add_part(state, "rollout/", joined_rollouts(processes_.gather(rollout_->state())));
        if (repeats()) add_part(state, "repeated_frame/", repeated_frame_.state());
        return state;
    }

    void load_state(const TensorMap& state) override {
        finish_learning();
        auto rollout = empty_rollout();  // so that nothing has changed if a part is missing
        rollout->restore(share_of_rollout(part_of(state, "rollout/"), share_));
        auto repeated_frame = repeated_frame_;
        if (repeats()) repeated_frame.restore(part_of(state, "repeated_frame/"));
        restore(parts(), state);
        state_.anneal(std::max<std::int64_t>(state_.gradient_steps - 1, 0));  // as of the newest step
        rollout_ = std::move(rollout);
        repeated_frame_ = std::move(repeated_frame);
        newest_ = {{"charts/learning_rate", state_.adam.learning_rate()}};
        gradient_step_.forget();
    }

  private:
    /// Waits for the gradient steps on the rollout before, if they are under way. Throws what they threw.
    void finish_learning() {
        if (learning_.valid()) newest_ = learning_.get();
    }

    std::unique_ptr<Rollout> empty_rollout() const {
        const RolloutConfig config{.length = settings_.rollout_steps / share_.all,
                                   .num_envs = spec_.num_envs,
                                   .observation = spec_.observation,
                                   .action_size = box_size(spec_.action_space),
                                   .reward_scale = settings_.reward_scale,
                                   .reward_clip = settings_.reward_clip};
        if (settings_.replay_terminal == ReplayTerminal::dopamine)
            return std::make_unique<DopamineRollout>(config);
        return std::make_unique<Rollout>(config);
    }

    bool repeats() const { return settings_.stack_after_update == StackAfterUpdate::repeated; }

    /// None where nothing is drawn for it, as by policy files.
    std::optional<double> epsilon(ActMode mode) const {
        if (settings_.exploration == Exploration::standard) return std::nullopt;
        const auto evaluation = settings_.epsilon.epsilon_eval;
        if (mode == ActMode::evaluate) return evaluation > 0 ? std::optional(evaluation) : std::nullopt;
        return linearly_decaying_epsilon(settings_.epsilon.epsilon_decay_period, training_steps_, 0,
                                         settings_.epsilon.epsilon_train);
    }

    torch::Tensor sampled(const PpoPolicy& policy, const EnvShare& share, at::Generator& random) {
        require_finite(policy.gaussian ? policy.gaussian->mean : policy.log_pi);
        if (!policy.gaussian) {
            const auto pi = share.among_all(policy.log_pi.exp().cpu(), /*filler=*/1);
            return share.own(pi.multinomial(1, true, random).squeeze(1));
        }
        const auto noise =
            share.own(torch::randn({share.all, box_size(spec_.action_space)}, random)).to(spec_.device);
        return sample(*policy.gaussian, noise, state_.network->box).action.cpu();
    }

    torch::Tensor values(const torch::Tensor& observations) {
        return state_.network(observations.to(spec_.device)).value;
    }

    /// The rollout as one batch of T x N steps, with everything that is fixed before the update.
    RolloutBatch whole_rollout(const torch::Tensor& next_observations) {
        const torch::NoGradGuard no_grad;
        RolloutBatch whole;
        const auto steps_of = [&](const torch::Tensor& kept) {
            return kept.flatten(0, 1).to(spec_.device, kept.scalar_type(), /*non_blocking=*/false,
                                         /*copy=*/spec_.overlap);
        };
        whole.observation = steps_of(rollout_->observation);
        whole.action = steps_of(rollout_->action);
        std::vector<torch::Tensor> log_probs, old_values, acting_log_probs;
        for (std::int64_t first = 0; first < whole.observation.size(0); first += settings_.minibatch_size) {
            const auto part = [&](const torch::Tensor& steps) {
                return steps.slice(0, first, first + settings_.minibatch_size);
            };
            const auto [policy, value] = state_.network(part(whole.observation));
            log_probs.push_back(log_prob(policy, part(whole.action), state_.network->box));
            old_values.push_back(value);
            if (spec_.overlap)
                acting_log_probs.push_back(
                    log_prob(acting_(part(whole.observation)).policy, part(whole.action), acting_->box));
        }
        whole.old_log_prob = torch::cat(log_probs);
        whole.old_value = torch::cat(old_values);
        if (spec_.overlap) whole.importance = (whole.old_log_prob - torch::cat(acting_log_probs)).exp();
        const auto rewards = rollout_->reward.clone();
        for (const auto& cut : rollout_->truncations)
            rewards[cut.step][cut.env] +=
                settings_.gamma * values(cut.observation.unsqueeze(0))[0].item<float>();
        const auto estimate = generalized_advantages(
            rewards.to(spec_.device), rollout_->terminal.to(spec_.device), whole.old_value.view_as(rewards),
            values(next_observations), settings_.gamma, settings_.gae_lambda);
        whole.advantage = estimate.advantage.flatten();
        whole.returns = estimate.returns.flatten();
        return whole;
    }

    /// The rows of an epoch's minibatches in the rollout of all processes: [minibatches, size].
    torch::Tensor shuffled_rows() {
        return torch::randperm(settings_.rollout_steps, shuffling_random_, torch::kInt64)
            .view({-1, settings_.minibatch_size});
    }
    torch::Tensor contiguous_rows() {
        const auto size = settings_.minibatch_size;
        const auto order = torch::randperm(settings_.rollout_steps / size, shuffling_random_, torch::kInt64);
        return order.unsqueeze(1) * size + torch::arange(size);
    }

    /// Makes all gradient steps on a rollout. Returns what the log shows of them.
    std::map<std::string, double> learn(const RolloutBatch& whole) {
        const auto contiguous = contiguous_rows();  // drawn for either order: the draws are part of a run
        auto sums = torch::zeros({std::ssize(names_)}, torch::dtype(torch::kFloat32).device(spec_.device));
        for (std::int64_t epoch = 0; epoch < settings_.epochs; ++epoch) {
            const auto minibatches =
                settings_.minibatches == Minibatches::contiguous ? contiguous : shuffled_rows();
            for (const auto& rows : minibatches.to(spec_.device).unbind()) {
                choose(whole, share_.own_rows(rows));
                state_.anneal(state_.gradient_steps++);
                gradient_step_([&] {
                    newest_losses_ = losses_(state_.network, normalized(minibatch_, &processes_));
                    state_.step(newest_losses_.front(), &processes_);
                });
                sums += torch::stack(newest_losses_);
            }
        }
        processes_.sum({sums});
        return figures(sums / (settings_.epochs * contiguous.size(0)), whole);
    }

    /// Copies these rows to minibatch_, which stays in its place in memory while their number does.
    void choose(const RolloutBatch& whole, const torch::Tensor& rows) {
        for (const auto part :
             {&RolloutBatch::observation, &RolloutBatch::action, &RolloutBatch::old_log_prob,
              &RolloutBatch::old_value, &RolloutBatch::advantage, &RolloutBatch::returns,
              &RolloutBatch::importance}) {
            if (!(whole.*part).defined()) continue;
            auto& chosen = minibatch_.*part;
            if (!chosen.defined() || chosen.size(0) != rows.size(0))
                chosen = torch::empty({0}, (whole.*part).options());
            at::index_select_out(chosen, whole.*part, 0, rows);
        }
    }

    std::map<std::string, double> figures(const torch::Tensor& mean_losses, const RolloutBatch& whole) {
        const auto variance = [&](const torch::Tensor& part) {
            return moments(part, processes_).deviation.square();
        };
        const auto unexplained = variance(whole.returns - whole.old_value) / (variance(whole.returns) + 1e-8);
        const auto numbers = torch::cat({mean_losses, (1 - unexplained).view({1})}).cpu();
        std::map<std::string, double> result{{"charts/learning_rate", state_.adam.learning_rate()}};
        std::int64_t i = 0;
        for (const auto& name : names_) result["losses/" + name] = numbers[i++].item<double>();
        result["losses/explained_variance"] = numbers[i].item<double>();
        if (whole.action.dim() == 1) return result;
        std::vector<torch::Tensor> coordinates;
        for (const auto& coordinate : whole.action.unbind(1))
            coordinates.push_back(moments(coordinate, processes_).mean);
        add_mean_action(result, spec_.action_space, torch::stack(coordinates));
        // The same in every state.
        const auto policy = state_.network(whole.observation.slice(0, 0, 1)).policy;
        result["charts/mean_log_std"] = policy.gaussian->log_std.mean().item<double>();
        return result;
    }

    StateParts parts() {
        StateParts parts;
        parts.add("network/", *state_.network);
        if (spec_.overlap) parts.add("acting/", *acting_);
        parts.add("adam/", state_.adam.state());
        parts.generators["random/acting"] = &acting_random_;
        parts.generators["random/shuffling"] = &shuffling_random_;
        parts.generators["random/evaluation"] = &evaluation_random_;
        parts.counters["training_steps"] = &training_steps_;
        parts.counters["gradient_steps"] = &state_.gradient_steps;
        return parts;
    }

    OnPolicySettings settings_;
    AgentSpec spec_;
    OnPolicyLosses losses_;
    std::vector<std::string> names_;  // of the losses
    ProcessGroup processes_;
    EnvShare share_;
    OnPolicyState state_;
    PpoNetwork acting_;  // the network of state_; with overlap a copy from before its newest update
    ActionBox box_;
    std::unique_ptr<Rollout> rollout_;
    std::int64_t training_steps_ = 0;
    RepeatedFrame repeated_frame_;
    at::Generator acting_random_, shuffling_random_, evaluation_random_;
    CapturedUpdate gradient_step_;
    RolloutBatch minibatch_;
    std::vector<torch::Tensor> newest_losses_;
    std::map<std::string, double> newest_;  // what the log shows: of the newest update that is over
    // With overlap the update under way: it alone uses state_, the minibatch and the order of the rows. Last,
    // so that it ends before they do.
    std::future<std::map<std::string, double>> learning_;
};

}  // namespace

std::unique_ptr<Agent> on_policy(const OnPolicySettings& settings, const AgentSpec& spec,
                                 OnPolicyLosses losses, const std::vector<std::string>& names) {
    check_settings(settings, spec);
    return std::make_unique<OnPolicy>(settings, spec, std::move(losses), names);
}

// Settings ----------------------------------------------------------------------------

void check_settings(const OnPolicySettings& settings, const AgentSpec& spec) {
    const auto require_multiple = [&](std::int64_t of, const std::string& name) {
        if (of > 0 && settings.rollout_steps % of == 0) return;
        throw std::invalid_argument("agent.rollout_steps is " + std::to_string(settings.rollout_steps) +
                                    ", which is no multiple of " + name + " = " + std::to_string(of) +
                                    "; change one of the two");
    };
    if (spec.overlap && !group_of(spec.processes).single())
        throw std::invalid_argument(
            "train.overlap, train.realtime: an agent with a rollout learns beside its environments in one "
            "process only; set both to false, or start a single process");
    const auto all_envs = EnvShare(spec).all;
    if (settings.stack_after_update == StackAfterUpdate::repeated && all_envs != 1)
        throw std::invalid_argument("agent.stack_after_update: repeated is for env.num_envs = 1, not " +
                                    std::to_string(all_envs));
    if (settings.replay_terminal == ReplayTerminal::dopamine && all_envs != 1)
        throw std::invalid_argument("agent.replay_terminal: dopamine is a rule for env.num_envs = 1, not " +
                                    std::to_string(all_envs));
    require_multiple(all_envs, "env.num_envs");
    require_multiple(settings.minibatch_size, "agent.minibatch_size");
}

std::string_view schedule_over_run(const OnPolicySettings& settings) {
    return settings.anneal_learning_rate && settings.anneal_steps == 0 ? "agent.anneal_learning_rate" : "";
}

}  // namespace cale
