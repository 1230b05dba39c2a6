// SAC-D against the numbers of Christodoulou's losses in the skeleton of Dopamine's SAC.
#include <cmath>

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agents/random.h"
#include "agents/sacd.h"
#include "golden_network.h"
#include "support/golden.h"

namespace cale {
namespace {

struct Case : golden::NetworkCase {
    SacdConfig config;
    std::int64_t num_actions;

    Case(const std::string& file_name, torch::Dtype type)
        : NetworkCase(file_name, type), num_actions(static_cast<std::int64_t>(hyper("num_actions"))) {
        const auto hyper_node = file["hyper"];
        const bool phi_sac = hyper_node["encoder"] && hyper_node["encoder"].as<std::string>() == "SAC";
        config.network.encoder = phi_sac ? EncoderKind::phi_sac : EncoderKind::phi_dqn;
        config.network.hidden_units = hyper_node["hidden_units"].as<std::int64_t>();
        config.network.hidden_layers = std::ssize(actor_layers());
        config.replay.reward_scale = hyper("reward_scale");
        config.tau = hyper("tau");
        config.next_policy =
            hyper_node["next_policy"].as<std::string>() == "online" ? NextPolicy::online : NextPolicy::target;
    }

    SacdNetwork network(const std::string& weights_case) const {
        SacdNetwork made(EncoderConfig{.encoder = config.network.encoder}, config.network.head(), num_actions,
                         make_generator(1));
        golden::load_weights(*made, file, weights_case);
        made->to(device, dtype);
        return made;
    }

    ActorCriticState<SacdNetwork> learner() const {
        return {network(name), network(name + "/target"),
                torch::full({1}, hyper("log_alpha0"), torch::dtype(dtype).device(device)).requires_grad_(),
                adam()};
    }
};

class SacdGolden : public ::testing::TestWithParam<golden::FileAndType> {
  protected:
    Case c{std::get<0>(GetParam()), std::get<1>(GetParam())};
};

TEST_P(SacdGolden, Forward) {
    const torch::NoGradGuard no_grad;
    auto learner = c.learner();
    const auto batch = c.batch();
    const auto online = c.file["forward"]["online"], target = c.file["forward"]["target"];
    const auto features = learner.network->encoder->trunk(batch.observation);
    const auto q = learner.network->critic(learner.network->encoder->critic_branch(features));
    c.expect(learner.network->log_policy(features), online, "log_pi", c.tolerance.forward);
    c.expect(q.q1, online, "q1", c.tolerance.forward);
    c.expect(q.q2, online, "q2", c.tolerance.forward);
    const auto next_features = learner.target->encoder->trunk(batch.next_observation);
    const auto next_q = learner.target->critic(learner.target->encoder->critic_branch(next_features));
    c.expect(next_q.q1, target, "q1", c.tolerance.forward);
    c.expect(next_q.q2, target, "q2", c.tolerance.forward);
    auto& next_policy = c.config.next_policy == NextPolicy::target ? learner.target : learner.network;
    const auto next_log_policy = next_policy->log_policy(next_policy->encoder->trunk(batch.next_observation));
    golden::expect_close(next_log_policy, golden::tensor(target["next_logits"]).log_softmax(1),
                         c.tolerance.forward, "log pi at the next state, of next_logits");
    const auto losses = sacd_losses(learner.network, learner.target, learner.log_alpha, batch,
                                    c.hyper("target_entropy"), c.config);
    c.expect(losses.target_values, target, "y", c.tolerance.forward);
    c.expect(losses.entropy, online, "entropy", c.tolerance.forward);
}

TEST_P(SacdGolden, ThreeUpdates) {
    auto learner = c.learner();
    const auto batch = c.batch();
    const auto initial = golden::parameters(*learner.network);
    const auto initial_target = golden::parameters(*learner.target);
    const auto steps = c.file["steps"];
    for (std::size_t step = 0; step < steps.size(); ++step) {
        const auto losses = sacd_update(learner, batch, c.hyper("target_entropy"), c.config);
        const double tolerance = step == 0 ? c.tolerance.loss_first : c.tolerance.loss_later;
        c.expect(losses.critic, steps[step], "critic_loss", tolerance);
        c.expect(losses.actor, steps[step], "policy_loss", tolerance);
        c.expect(losses.alpha, steps[step], "alpha_loss", tolerance);
        c.expect(learner.log_alpha.detach()[0], steps[step], "log_alpha_after", tolerance);
        if (step == 0) {
            c.expect(learner.log_alpha.grad(), c.file, "grad_log_alpha", tolerance);
            c.expect_gradients(*learner.network);
        }
        const auto after = "_after" + std::to_string(step + 1);
        c.expect_moved(*learner.network, initial, "params" + after);
        c.expect_moved(*learner.target, initial_target, "target" + after);
    }
}

// 0.98 log 6, the target of tests/golden/sac_discrete.yaml; other files may have another one.
TEST(SacdSettings, TheTargetEntropyIsAPartOfTheLargest) {
    EXPECT_NEAR(SacdConfig{}.target_entropy_scale * std::log(6), 1.75592428, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Files, SacdGolden, ::testing::ValuesIn(golden::files_and_types("sac_discrete")),
                         golden::name_of);

}  // namespace
}  // namespace cale
