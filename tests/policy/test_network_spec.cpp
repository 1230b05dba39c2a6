#include "policy/network_spec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "policy/encoder_layers.h"
#include "policy/json.h"
#include "policy/network_parameters.h"
#include "policy/network_text.h"
#include "policy/sample_policies.h"
#include "policy/stored_tensors.h"

namespace cale {
namespace {

using ::testing::HasSubstr;
using Kind = Layer::Kind;

std::map<std::string, std::string> shapes(const NetworkSpec& network) {
    std::map<std::string, std::string> result;
    for (const auto& [name, shape] : parameter_shapes(network)) result[name] = text_of_shape(shape);
    return result;
}

/// On four frames of 84 x 84, with so many hidden units.
NetworkSpec large(NetworkSpec network, std::int64_t units = 512) {
    network.observation = {4, 84, 84};
    for (auto& layer : network.layers)
        if (layer.kind == Kind::dense && layer.name.find(".fc") != std::string::npos) layer.outputs = units;
    return network;
}

TEST(NetworkSpecTest, SacsParametersHaveTheirOrdinaryNamesAndShapes) {
    const std::map<std::string, std::string> expected{
        {"encoder.conv1.weight", "[32, 4, 3, 3]"},  {"encoder.conv1.bias", "[32]"},
        {"encoder.conv2.weight", "[32, 32, 3, 3]"}, {"encoder.conv2.bias", "[32]"},
        {"encoder.conv3.weight", "[32, 32, 3, 3]"}, {"encoder.conv3.bias", "[32]"},
        {"encoder.conv4.weight", "[32, 32, 3, 3]"}, {"encoder.conv4.bias", "[32]"},
        {"encoder.actor_fc.weight", "[50, 56448]"}, {"encoder.actor_fc.bias", "[50]"},
        {"encoder.actor_ln.weight", "[50]"},        {"encoder.actor_ln.bias", "[50]"},
        {"actor.fc1.weight", "[512, 50]"},          {"actor.fc1.bias", "[512]"},
        {"actor.out.weight", "[6, 512]"},           {"actor.out.bias", "[6]"}};
    EXPECT_EQ(shapes(large(test::actor(phi_sac(), tanh_branch("actor")))), expected);
}

TEST(NetworkSpecTest, OfOtherKinds) {
    auto der = shapes(large(test::action_values(phi_dqn(), true, 51)));
    EXPECT_EQ(der["head.fc1.weight"], "[512, 7744]");
    EXPECT_EQ(der["head.adv.weight"], "[255, 512]");
    EXPECT_EQ(der["head.value.weight"], "[51, 512]");
    auto rows = shapes(large(test::action_values(phi_dqn(Padding::same, true))));
    EXPECT_EQ(rows["encoder.conv1.weight"], "[32, 4, 8, 8]");
    EXPECT_EQ(rows["head.fc1.weight"], "[512, 59136]");
    auto with_impala = shapes(large(test::action_values(impala(), true, 51)));
    EXPECT_EQ(with_impala["head.fc1.weight"], "[512, 3872]");
    EXPECT_EQ(with_impala.size(), 2u * (15 + 3));
    const Layers shared{Layer::dense("fc", 512), Layer::of(Kind::relu)};
    auto ppo = shapes(large(test::actor(phi_dqn(Padding::valid), shared, Head::Kind::gaussian)));
    EXPECT_EQ(ppo["encoder.fc.weight"], "[512, 3136]");  // 64 x 7 x 7, as in Mnih et al. 2015
    EXPECT_EQ(ppo["actor.log_std"], "[3]");
    auto ram = shapes(test::with_observation({4, 128}, test::action_values(mlp())));
    EXPECT_EQ(ram["encoder.fc1.weight"], "[256, 512]");
    EXPECT_EQ(ram["head.fc1.weight"], "[20, 256]");
}

/// Why these layers do not fit to frames of 84 x 84.
std::string misfit(Layers layers, std::vector<std::int64_t> input = {4, 84, 84}) {
    return test::message_of([&] { sized_layers(NetworkSpec{std::move(input), std::move(layers), {}}); });
}

TEST(NetworkSpecTest, LayersThatDoNotFitTogether) {
    const auto flatten = Layer::of(Kind::flatten), keep = Layer::of(Kind::keep),
               add = Layer::of(Kind::add_kept);
    EXPECT_EQ(misfit(phi_sac(Padding::valid), {4, 2, 84}),
              "a network needs frames that are no smaller than its kernels");
    EXPECT_EQ(misfit(phi_sac(), {4, 128}), "the convolution conv1 needs an image");
    EXPECT_EQ(misfit({Layer::dense("fc", 3)}), "the dense layer fc needs a vector: flatten first");
    EXPECT_EQ(misfit({Layer::conv("conv", 8, 3, 1)}), "the head needs a flattened observation");
    EXPECT_EQ(misfit({flatten, flatten}), "flatten needs an image or bytes");
    EXPECT_EQ(misfit({keep, flatten}), "keep needs an add_kept behind it");
    EXPECT_EQ(misfit({keep, keep}), "a second keep needs an add_kept before it");
    EXPECT_THAT(misfit({add, flatten}), HasSubstr("add_kept needs a keep before it"));
    EXPECT_THAT(misfit({keep, Layer::max_pool(3, 2), add, flatten}), HasSubstr("a result of the same size"));
    EXPECT_THAT(misfit({flatten}, {}), HasSubstr("one to three dimensions"));
    EXPECT_THAT(misfit({flatten}, {4, 0}), HasSubstr("one to three dimensions"));
}

TEST(NetworkText, IsReadAsItWasWritten) {
    for (const auto& [name, network] : test::sample_networks())
        EXPECT_EQ(parse_network(network_text(network)), network) << name;
    EXPECT_EQ(network_text(test::actor(phi_sac(), tanh_branch("actor"))),
              "observation 2 21 18; conv encoder.conv1 32 3 2 same; relu; conv encoder.conv2 32 3 1 same; "
              "relu; conv encoder.conv3 32 3 1 same; relu; conv encoder.conv4 32 3 1 same; relu; flatten; "
              "dense encoder.actor_fc 50; layer_norm encoder.actor_ln; tanh; dense actor.fc1 20; relu; "
              "squashed_gaussian");
}

TEST(NetworkText, OfEveryEncoder) {
    const auto text = [](const Layers& layers, std::vector<std::int64_t> observation = {4, 84, 84}) {
        return network_text({std::move(observation), layers, {.kind = Head::Kind::gaussian}});
    };
    EXPECT_EQ(
        text(phi_dqn(Padding::valid)),
        "observation 4 84 84; conv conv1 32 8 4 valid; relu; conv conv2 64 4 2 valid; relu; conv conv3 64 3 "
        "1 valid; relu; flatten; gaussian");
    EXPECT_EQ(text(data_efficient()),
              "observation 4 84 84; conv conv1 32 5 5 valid; relu; conv conv2 64 5 5 valid; relu; flatten; "
              "gaussian");
    EXPECT_EQ(text(phi_dqn_2013()),
              "observation 4 84 84; conv conv1 16 8 4 valid; relu; conv conv2 32 4 2 valid; relu; flatten; "
              "gaussian");
    EXPECT_EQ(
        text(compact()),
        "observation 4 84 84; conv conv1 32 3 2 valid; relu; conv conv2 32 3 2 valid; relu; conv conv3 32 3 "
        "2 valid; relu; conv conv4 32 3 1 valid; relu; flatten; gaussian");
    EXPECT_EQ(text(mlp(), {2, 128}),
              "observation 2 128; flatten; dense fc1 256; relu; dense fc2 256; relu; gaussian");
    EXPECT_EQ(
        text(mlp(/*layer_norm=*/true), {2, 128}),
        "observation 2 128; flatten; dense fc1 256; layer_norm ln1; relu; dense fc2 256; layer_norm ln2; "
        "relu; gaussian");
    EXPECT_EQ(text(flat(), {2, 128}), "observation 2 128; flatten; gaussian");
    // Espeholt et al. 2018: three stages of a convolution, a pooling and two residual blocks.
    const auto stage = [](const std::string& number, const std::string& channels) {
        std::string stage_text = "conv stageN_conv C 3 1 same; max_pool 3 2";
        for (const std::string block : {"1", "2"})
            stage_text += "; keep; relu; conv stageN_block" + block +
                          "_conv1 C 3 1 same; relu; conv stageN_block" + block +
                          "_conv2 C 3 1 same; add_kept";
        for (const auto& [mark, value] : {std::pair{'N', number}, {'C', channels}})
            for (auto at = stage_text.find(mark); at != stage_text.npos; at = stage_text.find(mark))
                stage_text.replace(at, 1, value);
        return stage_text + "; ";
    };
    EXPECT_EQ(text(impala()), "observation 4 84 84; " + stage("1", "16") + stage("2", "32") +
                                  stage("3", "32") + "relu; flatten; gaussian");
}

std::string refusal(const std::string& text) {
    return test::message_of([&] { parse_network(text); });
}

TEST(NetworkText, RefusesWhatItDoesNotKnow) {
    EXPECT_EQ(refusal("observation 4 8; flatten; values 18 51 10"), "no error");
    EXPECT_EQ(refusal(""), "its network has no layers");
    EXPECT_EQ(refusal("observation 4 8; attention 3; gaussian"),
              "its network's entry 'attention 3' is no layer that is known");
    EXPECT_THAT(refusal("flatten; flatten; gaussian"), HasSubstr("is not its observation"));
    EXPECT_THAT(refusal("observation 4 8; flatten; softmax"), HasSubstr("'softmax' is no head"));
    EXPECT_EQ(refusal("observation 4 8; flatten; gaussian 4"), "no error");
    EXPECT_THAT(refusal("observation 4 8; flatten; gaussian 3"), HasSubstr("not written as"));
    EXPECT_THAT(refusal("observation 4 8; flatten; gaussian 5"), HasSubstr("from 1 to 4"));
    EXPECT_THAT(refusal("observation 4 8; flatten; gaussian 4 4"), HasSubstr("has more to it"));
    EXPECT_THAT(refusal("observation 4 8; dense fc; gaussian"), HasSubstr("ends too early"));
    EXPECT_THAT(refusal("observation 4 8; flatten;dense a.b 8; gaussian"), HasSubstr("separated by '; '"));
    EXPECT_THAT(refusal("observation 4 8; flatten; dense a/b 8; gaussian"), HasSubstr("a name that is not"));
    EXPECT_THAT(refusal("observation 4 8; flatten; dense fc 08; gaussian"), HasSubstr("not written as"));
    EXPECT_THAT(refusal("observation 4 8; flatten; values 19 1 10"), HasSubstr("from 1 to 18"));
    EXPECT_EQ(refusal("observation 4 8; flatten; dense fc 8 noisy; values 18 1 10 noisy factors 3 3 2"),
              "no error");
    EXPECT_THAT(refusal("observation 4 8; flatten; values 18 1 10 factors"), HasSubstr("ends too early"));
    for (const auto* factors : {"2", "3 3", "3 3 3", "18 18", "1 18", "18 1"}) {
        EXPECT_THAT(refusal(std::string("observation 4 8; flatten; values 18 1 10 factors ").append(factors)),
                    HasSubstr("has factors whose product is not its number of actions"));
    }
    EXPECT_THAT(refusal("observation 4 8; flatten; values 18 1 10 loud"), HasSubstr("has more to it"));
    EXPECT_THAT(refusal("observation 4 8; flatten; values 18 1 nan"), HasSubstr("from 0 to 1e+09"));
    EXPECT_THAT(refusal("observation 4 8 8; conv c 8 3 1 full; flatten; gaussian"),
                HasSubstr("is not padded"));
    EXPECT_THAT(refusal("observation 4 8; flatten; keep; gaussian"), HasSubstr("do not fit together: keep"));
    EXPECT_THAT(refusal("observation 4 8; flatten; dense a 8; dense a 8; gaussian"),
                HasSubstr("cannot be called"));
    EXPECT_THAT(refusal("observation 4 8; flatten; dense actor.mean 8; gaussian"),
                HasSubstr("cannot be called"));
    EXPECT_THAT(refusal("observation 4 8; flatten; dense golden 8; gaussian"), HasSubstr("cannot be called"));
    std::string many = "observation 4 8; flatten";
    for (int i = 0; i < 1'000; ++i) many += "; relu";
    EXPECT_THAT(refusal(many + "; gaussian"), HasSubstr("more than 1000 layers"));
}

TEST(NetworkText, RefusesNetworksThatAreTooLarge) {
    const auto with = [](const std::string& layers) {
        return "observation 4 512 512; " + layers + "; gaussian";
    };
    EXPECT_EQ(refusal(with("conv c 16 3 1 same; flatten")), "no error");
    const auto* const too_large = "its network is larger than one for a game has reason to be";
    EXPECT_EQ(refusal(with("conv c 65536 1 1 same; flatten")), too_large);  // 64 GB of results
    EXPECT_EQ(refusal(with("conv c 64 64 1 same; flatten")), too_large);    // minutes
    // Little in itself, but each has the zeros around it that the last convolution wants.
    std::string pools = "observation 1 1 1; conv a 64 1 1 same";
    for (int i = 0; i < 950; ++i) pools += "; max_pool 1 1";
    EXPECT_EQ(refusal(pools + "; conv b 1 64 1 same; flatten; gaussian"), too_large);
    std::string windows = "observation 1 512 512";
    for (int i = 0; i < 20; ++i) windows += "; max_pool 64 1";
    EXPECT_EQ(refusal(windows + "; flatten; gaussian"), too_large);
}

}  // namespace
}  // namespace cale
