#include "policy/network.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

namespace cale {
namespace {

std::map<std::string, std::string> shapes(const PolicyNetwork& network) {
    std::map<std::string, std::string> result;
    for (const auto& [name, type, shape] : parameters_of(network)) result[name] = text_of_shape(shape);
    return result;
}

TEST(PolicyNetworkTest, SacsParametersHaveTheirOrdinaryNamesAndShapes) {
    const std::map<std::string, std::string> expected{
        {"encoder.conv1.weight", "[32, 4, 3, 3]"},  {"encoder.conv1.bias", "[32]"},
        {"encoder.conv2.weight", "[32, 32, 3, 3]"}, {"encoder.conv2.bias", "[32]"},
        {"encoder.conv3.weight", "[32, 32, 3, 3]"}, {"encoder.conv3.bias", "[32]"},
        {"encoder.conv4.weight", "[32, 32, 3, 3]"}, {"encoder.conv4.bias", "[32]"},
        {"encoder.actor_fc.weight", "[50, 56448]"}, {"encoder.actor_fc.bias", "[50]"},
        {"encoder.actor_ln.weight", "[50]"},        {"encoder.actor_ln.bias", "[50]"},
        {"actor.fc1.weight", "[512, 50]"},          {"actor.fc1.bias", "[512]"},
        {"actor.out.weight", "[6, 512]"},           {"actor.out.bias", "[6]"}};
    EXPECT_EQ(shapes({}), expected);
}

TEST(PolicyNetworkTest, OfOtherKinds) {
    PolicyNetwork der;
    der.encoder = PolicyNetwork::Encoder::phi_dqn;
    der.branch = PolicyNetwork::Branch::none;
    der.head = PolicyNetwork::Head::values;
    der.num_actions = 4;
    der.num_atoms = 51;
    der.dueling = true;
    EXPECT_EQ(shapes(der)["head.fc1.weight"], "[512, 7744]");
    EXPECT_EQ(shapes(der)["head.adv.weight"], "[204, 512]");
    EXPECT_EQ(shapes(der)["head.value.weight"], "[51, 512]");
    auto rows = der;
    rows.phi_dqn = PolicyNetwork::Rows::row1d;
    EXPECT_EQ(shapes(rows)["encoder.conv1.weight"], "[32, 4, 8, 8]");
    EXPECT_EQ(shapes(rows)["head.fc1.weight"], "[512, 59136]");
    auto impala = der;
    impala.encoder = PolicyNetwork::Encoder::impala;
    EXPECT_EQ(shapes(impala)["head.fc1.weight"], "[512, 3872]");
    EXPECT_EQ(shapes(impala).size(), 2u * (15 + 3));
    PolicyNetwork ppo;
    ppo.encoder = PolicyNetwork::Encoder::phi_dqn;
    ppo.branch = PolicyNetwork::Branch::shared;
    ppo.padding = PolicyNetwork::Padding::valid;
    ppo.head = PolicyNetwork::Head::gaussian;
    EXPECT_EQ(shapes(ppo)["encoder.fc.weight"], "[512, 3136]");  // 64 x 7 x 7, as in Mnih et al. 2015
    EXPECT_EQ(shapes(ppo)["actor.log_std"], "[3]");
}

TEST(PolicyNetworkTest, FramesSmallerThanAKernel) {
    PolicyNetwork network;
    network.frame_height = 2;
    network.padding = PolicyNetwork::Padding::valid;
    EXPECT_THROW(layers_of(network), FileDamage);
}

}  // namespace
}  // namespace cale
