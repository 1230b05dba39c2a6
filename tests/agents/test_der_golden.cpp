// DER against the numbers of Dopamine's full_rainbow_agent.train.
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "agents/critic.h"
#include "agents/der.h"
#include "agents/random.h"
#include "golden_network.h"
#include "support/golden.h"

namespace cale {
namespace {

struct Case : golden::NetworkCase {
    DerConfig config;
    std::int64_t num_actions;

    Case(const std::string& file_name, torch::Dtype type)
        : NetworkCase(file_name, type), num_actions(static_cast<std::int64_t>(hyper("num_actions"))) {
        config.num_atoms = static_cast<std::int64_t>(hyper("atoms"));
        config.value_limit = hyper("vmax");
        if (const auto vmin = file["hyper"]["vmin"]; vmin && !vmin.IsNull()) {
            EXPECT_EQ(hyper("vmin"), -config.value_limit) << "the atoms of DER are symmetric";
        }
        for (const auto& param : file["params"])
            if (param["name"].as<std::string>() == "head.fc1.bias_mu")
                config.hidden_units = param["shape"][0].as<std::int64_t>();
    }

    QNetwork network(const std::string& weights_case) const {
        QNetwork made(EncoderConfig{.encoder = EncoderKind::phi_dqn},
                      QHeadConfig{.num_actions = num_actions,
                                  .hidden_units = config.hidden_units,
                                  .num_atoms = config.num_atoms,
                                  .dueling = true,
                                  .noisy = true},
                      make_generator(1));
        golden::load_weights(*made, file, weights_case);
        made->to(device, dtype);
        return made;
    }

    /// The normal numbers that the README derives from the hash, checked against the file's echo.
    torch::Tensor normal(const std::string& stream, std::int64_t size) const {
        const auto u1 = golden::uniforms(name, stream + ".u1", {size});
        const auto u2 = golden::uniforms(name, stream + ".u2", {size});
        const auto drawn =
            ((-2 * (1 - u1).log()).sqrt() * (2 * std::numbers::pi * u2).cos()).to(torch::kFloat32).to(dtype);
        const auto echo = file["noise"][stream];
        EXPECT_TRUE(echo) << stream;
        if (echo) golden::expect_close(drawn.norm(), golden::tensor(echo["l2"]), 1e-6, stream);
        return drawn.to(device);
    }

    QNoise noise(std::size_t step, const std::string& pass, std::int64_t features) const {
        const auto draw = [&](const char* side, std::int64_t size) {
            return normal(
                "noise/step" + std::to_string(step) + "/" + pass + "/" + side + std::to_string(size), size);
        };
        const auto shared = draw("p", config.hidden_units);
        return {{draw("p", features), draw("q", config.hidden_units)},
                {shared, draw("q", num_actions * config.num_atoms)},
                {shared, draw("q", config.num_atoms)}};
    }
    DerNoise noise_of(std::size_t step, QNetwork& network_) const {
        const auto features = network_->encoder->size();
        return {noise(step, "online", features), noise(step, "target", features)};
    }
};

class DerGolden : public ::testing::TestWithParam<golden::FileAndType> {
  protected:
    Case c{std::get<0>(GetParam()), std::get<1>(GetParam())};
};

TEST_P(DerGolden, Forward) {
    const torch::NoGradGuard no_grad;
    auto network = c.network(c.name), target = c.network(c.name + "/target");
    const auto batch = c.batch();
    const auto noise = c.noise_of(1, network);
    const auto forward = c.file["forward"];
    const auto support =
        atom_support(c.config.num_atoms, c.config.value_limit, torch::dtype(c.dtype).device(c.device));
    const auto values = [&](const torch::Tensor& output) { return (output.softmax(2) * support).sum(2); };
    const auto output = network(batch.observation, &noise.online);
    c.expect(values(output), forward, "q", c.tolerance.forward);
    const auto of_action =
        output.gather(1, batch.action.view({-1, 1, 1}).expand({-1, 1, c.config.num_atoms}));
    c.expect(of_action.squeeze(1), forward, "logits_action", c.tolerance.forward);
    const auto next_online = values(network(batch.next_observation, &noise.target));
    c.expect(next_online, forward, "q_next_online", c.tolerance.forward);
    c.expect(values(target(batch.next_observation, &noise.target)), forward, "q_next_target",
             c.tolerance.forward);
    c.expect(next_online.argmax(1), forward, "next_action", 0);
    const auto losses = der_losses(network, target, batch, c.input("loss_weight"), noise, c.config);
    c.expect(losses.target, forward, "target_distribution", c.tolerance.forward);
    c.expect(losses.per_transition, forward, "loss", c.tolerance.forward);
    c.expect(losses.priorities, forward, "priority", c.tolerance.forward);
}

TEST_P(DerGolden, ThreeUpdates) {
    QState learner(c.network(c.name), c.network(c.name + "/target"), c.adam());
    const auto batch = c.batch();
    const auto weights = c.input("loss_weight");
    const auto initial = golden::parameters(*learner.network);
    const auto steps = c.file["steps"];
    for (std::size_t step = 0; step < steps.size(); ++step) {
        const auto losses =
            der_update(learner, batch, weights, c.noise_of(step + 1, learner.network), c.config);
        const double tolerance = step == 0 ? c.tolerance.loss_first : c.tolerance.loss_later;
        c.expect(losses.per_transition, steps[step], "loss", tolerance);
        c.expect(losses.loss, steps[step], "mean_weighted_loss", tolerance);
        if (step == 0) c.expect_gradients(*learner.network);
        c.expect_moved(*learner.network, initial, "params_after" + std::to_string(step + 1));
    }
}

INSTANTIATE_TEST_SUITE_P(Files, DerGolden, ::testing::ValuesIn(golden::files_and_types("der")),
                         golden::name_of);

TEST(DerGoldenSchedules, ImportanceWeightsAndPriorities) {
    int cases = 0;
    for (const auto& file : golden::files_of_kind("schedules")) {
        const auto golden_case = golden::load(file)["prioritized"];
        if (!golden_case) continue;
        ++cases;
        const auto probability = golden::tensor(golden_case["probability"]);
        golden::expect_close(importance_weights(probability, DerConfig{}.importance_exponent),
                             golden::tensor(golden_case["loss_weight"]), 1e-6, "loss_weight of " + file);
        golden::expect_close(priorities(golden::tensor(golden_case["loss"]), DerConfig{}.priority_exponent),
                             golden::tensor(golden_case["new_priority"]), 1e-6, "new_priority of " + file);
    }
    EXPECT_GT(cases, 0);
}

}  // namespace
}  // namespace cale
