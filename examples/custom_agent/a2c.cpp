#include "examples/custom_agent/a2c.h"

#include <map>
#include <string>
#include <utility>

#include <torch/types.h>
#include <torch/utils.h>

#include "agents/advantages.h"
#include "agents/random.h"
#include "agents/state.h"
#include "networks/adam.h"
#include "networks/discrete_actions.h"
#include "replay/rollout.h"

namespace cale {
namespace {

// Each consumer of randomness has a stream of its own, so that none depends on the others.
enum Stream : std::uint64_t { kInitialValues, kActing, kEvaluation };

PpoNetwork make_network(const A2cConfig& config, const AgentSpec& spec) {
    PpoNetwork network(
        PpoNetworkConfig{
            .encoder = {.encoder = config.encoder, .observation = spec.observation.tensor_shape()},
            .torso = Torso::two_branch,
            .hidden_layers = 0},
        num_actions(spec.action_space), make_generator(stream_seed(spec.seed, kInitialValues)));
    network->to(spec.device);
    return network;
}

class A2c final : public Agent {
  public:
    A2c(const A2cConfig& config, const AgentSpec& spec)
        : config_(config),
          spec_(spec),
          network_(make_network(config, spec)),
          adam_(network_->parameters(),
                {.learning_rate = config.learning_rate, .epsilon = config.adam_epsilon}),
          rollout_({.length = config.rollout_length,
                    .num_envs = spec.num_envs,
                    .observation = spec.observation,
                    .action_size = 0}),
          acting_random_(make_generator(stream_seed(spec.seed, kActing))),
          evaluation_random_(make_generator(stream_seed(spec.seed, kEvaluation))) {}

    // Called first: the observations are those that the next actions will be chosen on.
    bool update(const torch::Tensor& observations) override {
        if (!rollout_.full()) return false;
        learn(observations);
        rollout_.clear();
        return true;
    }

    // Called second.
    torch::Tensor act(const torch::Tensor& observations, ActMode mode) override {
        const torch::NoGradGuard no_grad;
        const bool training = mode == ActMode::train;
        if (training) rollout_.set_observations(observations);
        const auto log_pi = network_(observations.to(spec_.device)).policy.log_pi;
        return log_pi.exp()
            .cpu()
            .multinomial(1, true, training ? acting_random_ : evaluation_random_)
            .squeeze(1);
    }

    // Called third, with what the environments answered.
    void observe(const StepBatch& batch) override {
        rollout_.add(batch.actions, batch.results, batch.final_frames);
    }

    // What the log shows.
    std::map<std::string, double> metrics() override { return newest_; }

    // What `cale export`, `cale evaluate` and `cale play` act with.
    std::optional<AgentPolicy> policy() const override {
        return policy_of(network_, /*samples=*/true, /*epsilon=*/0);
    }

    // One list of parts is enough for checkpoints and --resume.
    TensorMap state() override {
        auto state = saved(parts());
        add_part(state, "rollout/", rollout_.state());
        return state;
    }
    void load_state(const TensorMap& state) override {
        Rollout rollout(rollout_.config);  // so that nothing has changed if a part is missing
        rollout.restore(part_of(state, "rollout/"));
        restore(parts(), state);
        rollout_ = std::move(rollout);
    }

  private:
    void learn(const torch::Tensor& next_observations) {
        const auto on_device = [this](const torch::Tensor& tensor) { return tensor.to(spec_.device); };
        const auto [policy, value] = network_(on_device(rollout_.observation.flatten(0, 1)));
        Advantages estimate;
        {
            const torch::NoGradGuard no_grad;
            // An episode that was cut off would have gone on: the value of that counts as reward.
            const auto reward = rollout_.reward.clone();
            for (const auto& cut : rollout_.truncations)
                reward[cut.step][cut.env] +=
                    config_.gamma * network_(on_device(cut.observation.unsqueeze(0))).value[0].item<float>();
            // With lambda 1: the discounted rewards of the rollout and the value of what follows it.
            estimate = generalized_advantages(on_device(reward), on_device(rollout_.terminal),
                                              value.detach().view_as(rollout_.reward),
                                              network_(on_device(next_observations)).value, config_.gamma, 1);
        }
        const auto chosen = gather_actions(policy.log_pi, on_device(rollout_.action.flatten()));
        const auto policy_loss = -(chosen * estimate.advantage.flatten()).mean();
        const auto value_loss = (value - estimate.returns.flatten()).square().mean();
        const auto mean_entropy = entropy(policy).mean();
        adam_.zero_grad();
        (policy_loss + config_.value_coefficient * value_loss - config_.entropy_coefficient * mean_entropy)
            .backward();
        clip_gradient_norm(network_->parameters(), config_.max_gradient_norm);
        adam_.step();
        newest_ = {{"losses/policy_loss", policy_loss.item<double>()},
                   {"losses/value_loss", value_loss.item<double>()},
                   {"losses/entropy", mean_entropy.item<double>()}};
    }

    StateParts parts() {
        StateParts parts;
        parts.add("network/", *network_);
        parts.add("adam/", adam_.state());
        parts.generators["random/acting"] = &acting_random_;
        parts.generators["random/evaluation"] = &evaluation_random_;
        return parts;
    }

    A2cConfig config_;
    AgentSpec spec_;
    PpoNetwork network_;
    Adam adam_;
    Rollout rollout_;
    at::Generator acting_random_, evaluation_random_;
    std::map<std::string, double> newest_;
};

}  // namespace

std::unique_ptr<Agent> make_a2c(const A2cConfig& config, const AgentSpec& spec) {
    require_discrete("A2C", spec);
    return std::make_unique<A2c>(config, spec);
}

}  // namespace cale
