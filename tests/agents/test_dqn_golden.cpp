// DQN against the numbers of Dopamine's dqn_agent.train.
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agents/dqn.h"
#include "agents/random.h"
#include "golden_network.h"
#include "support/golden.h"

namespace cale {
namespace {

struct Case : golden::NetworkCase {
    DqnConfig config;

    Case(const std::string& file_name, torch::Dtype type) : NetworkCase(file_name, type) {
        config.loss = file["hyper"]["loss"].as<std::string>() == "huber" ? ValueLoss::huber : ValueLoss::mse;
        for (const auto& param : file["params"])
            if (param["name"].as<std::string>() == "head.fc1.weight")
                config.hidden_units = param["shape"][0].as<std::int64_t>();
    }

    QNetwork network(const std::string& weights_case) const {
        QNetwork made(EncoderConfig{.encoder = EncoderKind::phi_dqn},
                      QHeadConfig{.num_actions = static_cast<std::int64_t>(hyper("num_actions")),
                                  .hidden_units = config.hidden_units},
                      make_generator(1));
        golden::load_weights(*made, file, weights_case);
        made->to(device, dtype);
        return made;
    }
};

class DqnGolden : public ::testing::TestWithParam<golden::FileAndType> {
  protected:
    Case c{std::get<0>(GetParam()), std::get<1>(GetParam())};
};

TEST_P(DqnGolden, Forward) {
    const torch::NoGradGuard no_grad;
    auto network = c.network(c.name), target = c.network(c.name + "/target");
    const auto batch = c.batch();
    const auto forward = c.file["forward"];
    c.expect(network(batch.observation).squeeze(2), forward, "q", c.tolerance.forward);
    c.expect(target(batch.next_observation).squeeze(2), forward, "q_next_target", c.tolerance.forward);
    c.expect(dqn_losses(network, target, batch, c.config).target_values, forward, "y", c.tolerance.forward);
}

TEST_P(DqnGolden, ThreeUpdates) {
    QState learner(c.network(c.name), c.network(c.name + "/target"), c.adam());
    const auto batch = c.batch();
    const auto initial = golden::parameters(*learner.network);
    const auto steps = c.file["steps"];
    for (std::size_t step = 0; step < steps.size(); ++step) {
        const auto losses = dqn_update(learner, batch, c.config);
        c.expect(losses.loss, steps[step], "loss",
                 step == 0 ? c.tolerance.loss_first : c.tolerance.loss_later);
        if (step == 0) c.expect_gradients(*learner.network);
        c.expect_moved(*learner.network, initial, "params_after" + std::to_string(step + 1));
    }
}

INSTANTIATE_TEST_SUITE_P(Files, DqnGolden, ::testing::ValuesIn(golden::files_and_types("dqn")),
                         golden::name_of);

}  // namespace
}  // namespace cale
