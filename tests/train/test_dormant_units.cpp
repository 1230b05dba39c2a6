#include "train/dormant_units.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <torch/types.h>

#include "replay/replay.h"

namespace cale {
namespace {

/// Has a layer called `hidden`, and a replay of one transition whose bytes are `seen`.
class OfOneLayer final : public Agent {
  public:
    OfOneLayer(AgentPolicy policy, const std::vector<std::uint8_t>& seen) : layer(std::move(policy)) {
        const auto& shape = layer.network.observation;
        replay_ = make_replay({.capacity = 10,
                               .observation = {shape.front(), {shape.begin() + 1, shape.end()}},
                               .action_size = 0},
                              std::nullopt);
        if (seen.empty()) return;
        for (int step = 0; step < 2; ++step) replay_->add(0, {.frame = seen, .terminal = true});
    }

    torch::Tensor act(const torch::Tensor&, ActMode) override { return {}; }
    void observe(const StepBatch&) override {}
    bool update(const torch::Tensor&) override { return false; }
    std::map<std::string, double> metrics() override { return {}; }
    TensorMap state() override { return {}; }
    void load_state(const TensorMap&) override {}
    Replay* replay() override { return replay_.get(); }
    std::optional<AgentPolicy> policy() const override { return layer; }

    AgentPolicy layer;

  private:
    std::unique_ptr<Replay> replay_;
};

/// Sees two bytes and has four units behind a ReLU: activations of 1, 0.5, 0.01 and 0 where both are 255.
OfOneLayer of_four_units(const std::vector<std::uint8_t>& seen = {}) {
    return {{.network = {.observation = {1, 2},
                         .layers = {Layer::of(Layer::Kind::flatten), Layer::dense("hidden", 4),
                                    Layer::of(Layer::Kind::relu)},
                         .head = {.kind = Head::Kind::values, .num_actions = 2}},
             .weights = {{"hidden.weight",
                          torch::tensor({{1.0f, 0.0f}, {0.0f, 0.5f}, {0.01f, 0.0f}, {0.0f, 0.0f}})},
                         {"hidden.bias", torch::tensor({0.0f, 0.0f, 0.0f, -1.0f})},
                         {"head.out.weight", torch::zeros({2, 4})},
                         {"head.out.bias", torch::zeros({2})}}},
            seen};
}

/// Sees a picture of a bright and a dark pixel. Of its channels, before a tanh, one never is active and one
/// is negative.
OfOneLayer of_four_channels() {
    return {{.network = {.observation = {1, 1, 2},
                         .layers = {Layer::conv("hidden", 4, 1, 1), Layer::of(Layer::Kind::tanh),
                                    Layer::of(Layer::Kind::flatten)},
                         .head = {.kind = Head::Kind::values, .num_actions = 2}},
             .weights = {{"hidden.weight", torch::tensor({1.0f, 1.0f, -1.0f, 0.0f}).view({4, 1, 1, 1})},
                         {"hidden.bias", torch::zeros({4})},
                         {"head.out.weight", torch::zeros({2, 8})},
                         {"head.out.bias", torch::zeros({2})}}},
            {255, 0}};
}

TEST(DormantShare, CountsTheUnitsFarBelowTheMeanOfTheirLayer) {
    auto agent = of_four_units({255, 255});
    EXPECT_EQ(dormant_share(agent, 1), 0.25);                // 0.01 is above 0.025 x 0.3775
    agent.layer.weights.at("hidden.weight")[2][0] = 0.009f;  // and this is below 0.025 x 0.37725
    EXPECT_EQ(dormant_share(agent, 1), 0.5);
    agent.layer.weights.at("hidden.bias")[3] = 1.0f;
    EXPECT_EQ(dormant_share(agent, 1), 0.25);
}

TEST(DormantShare, AllUnitsAreWhereNothingIsActive) {
    auto agent = of_four_units({0, 0});
    EXPECT_EQ(dormant_share(agent, 1), 1);
}

TEST(DormantShare, AChannelIsOneUnitAndCountsByItsSize) {
    auto agent = of_four_channels();
    EXPECT_EQ(dormant_share(agent, 1), 0.25);
}

TEST(DormantShare, NoneBeforeTheFirstTransition) {
    auto agent = of_four_units();
    EXPECT_EQ(dormant_share(agent, 1), std::nullopt);
}

}  // namespace
}  // namespace cale
