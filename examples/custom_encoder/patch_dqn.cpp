#include "patch_dqn.h"

#include <map>
#include <string>

#include <agents/random.h>
#include <agents/state.h>
#include <networks/adam.h>
#include <networks/heads.h>

#include "patch_network.h"

namespace example {
namespace {

// Each consumer of randomness has a stream of its own, so that none depends on the others.
enum Stream : std::uint64_t { kInitialValues, kActing, kReplay, kEvaluation };

PatchNetwork make_network(const PatchDqnConfig& config, const cale::AgentSpec& spec) {
    const auto generator = cale::make_generator(cale::stream_seed(spec.seed, kInitialValues));
    PatchEncoder encoder(spec.stack, spec.frame_height, spec.frame_width, config.channels, generator);
    PatchNetwork network(
        encoder, cale::QHeadConfig{.num_actions = spec.num_actions, .hidden_units = config.hidden_units},
        generator);
    network->to(spec.device);
    return network;
}

class PatchDqn final : public cale::Agent {
  public:
    PatchDqn(const PatchDqnConfig& config, const cale::AgentSpec& spec)
        : config_(config),
          spec_(spec),
          network_(make_network(config, spec)),
          target_(make_network(config, spec)),  // the same seed makes the same network
          adam_(network_->parameters(), {.learning_rate = config.learning_rate}),
          memory_(config.replay, spec, /*prioritised=*/false, cale::stream_seed(spec.seed, kReplay)),
          acting_random_(cale::make_generator(cale::stream_seed(spec.seed, kActing))),
          evaluation_random_(cale::make_generator(cale::stream_seed(spec.seed, kEvaluation))) {}

    torch::Tensor act(const torch::Tensor& observations, cale::ActMode mode) override {
        const at::NoGradGuard no_grad;
        const bool training = mode == cale::ActMode::train;
        const auto epsilon = training ? memory_.epsilon(config_.epsilon) : config_.epsilon.epsilon_eval;
        const auto greedy = network_(observations.to(spec_.device)).argmax(1).cpu();
        return cale::epsilon_greedy(greedy, epsilon, spec_.num_actions,
                                    training ? acting_random_ : evaluation_random_);
    }

    void observe(const cale::Experiences& seen) override { memory_.store(seen); }

    bool update(const torch::Tensor&) override {
        const auto decisions = memory_.next_decisions();
        if (!memory_.warm()) return false;
        const auto updates = decisions.multiples_of(config_.replay.update_period);
        for (std::int64_t i = 0; i < updates; ++i) learn(memory_.sample());
        if (decisions.multiples_of(config_.target_update_period) > 0)
            cale::hard_update(target_->parameters(), network_->parameters());
        return updates > 0;
    }

    std::map<std::string, double> metrics() override {
        std::map<std::string, double> values{{"charts/epsilon", memory_.epsilon(config_.epsilon)}};
        if (loss_.defined()) values["losses/td_loss"] = loss_.item<double>();
        return values;
    }

    cale::TensorMap state() override { return cale::saved(parts()); }
    void load_state(const cale::TensorMap& state) override { cale::restore(parts(), state); }
    cale::ReplayBuffer* replay() override { return &memory_.replay(); }

  private:
    void learn(const cale::Batch& batch) {
        torch::Tensor target;
        {
            const at::NoGradGuard no_grad;
            target = config_.replay.reward_scale * batch.n_step_return +
                     batch.discount * target_(batch.next_observation).amax(1);
        }
        const auto loss = at::huber_loss(cale::values_of(network_(batch.observation), batch.action), target);
        adam_.zero_grad();
        loss.backward();
        adam_.step();
        loss_ = loss.detach();
    }

    cale::StateParts parts() {
        cale::StateParts parts;
        parts.add("network/", *network_);
        parts.add("target/", *target_);
        parts.add("adam/", adam_.state());
        parts.generators["random/acting"] = &acting_random_;
        parts.generators["random/evaluation"] = &evaluation_random_;
        memory_.add_state(parts);
        return parts;
    }

    PatchDqnConfig config_;
    cale::AgentSpec spec_;
    PatchNetwork network_, target_;
    cale::Adam adam_;
    cale::ReplayMemory memory_;
    at::Generator acting_random_, evaluation_random_;
    torch::Tensor loss_;
};

}  // namespace

std::unique_ptr<cale::Agent> make_patch_dqn(const PatchDqnConfig& config, const cale::AgentSpec& spec) {
    cale::require_discrete("patch_dqn", spec);
    return std::make_unique<PatchDqn>(config, spec);
}

}  // namespace example
