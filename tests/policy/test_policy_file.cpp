#include "policy/policy_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>

#include "policy/policy_lite.h"
#include "policy/policy_texts.h"
#include "policy/sample_policies.h"

namespace cale {
namespace {

using test::sample_policy;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

PolicyFile small_sac() {
    return sample_policy(test::sample_networks().front().network);
}

std::string error_of(std::string_view contents) {
    return test::message_of([&] { lite::Policy::parse(contents, "x"); });
}

/// What is wrong with a file whose policy was changed like this, its checksum being right.
std::string error_after(const std::function<void(PolicyFile&)>& change, PolicyFile policy = small_sac()) {
    change(policy);
    return error_of(policy_file_contents(policy));
}

TEST(PolicyFileTest, ReadsWhatItWrites) {
    for (const auto& [name, network] : test::sample_networks()) {
        SCOPED_TRACE(name);
        auto written = sample_policy(network);
        written.info.threshold = 0.1;
        written.info.event_map = EventMap::ale_0_10;
        written.info.radius_is_strength = true;
        written.info.frame_skip = 5;
        written.info.life_loss_ends_episode = true;
        written.info.evaluation_samples = true;
        const auto read = parse_policy_file(policy_file_contents(written));
        EXPECT_EQ(policy_file_contents(read), policy_file_contents(written));
        EXPECT_EQ(read.weights, written.weights);
        EXPECT_EQ(read.golden.output, written.golden.output);
        EXPECT_EQ(read.golden.observation, written.golden.observation);
        EXPECT_EQ(read.info.actions, written.info.actions);
        EXPECT_EQ(read.info.threshold, 0.1);
        EXPECT_EQ(read.info.event_map, EventMap::ale_0_10);
        EXPECT_TRUE(read.info.radius_is_strength && read.info.life_loss_ends_episode &&
                    read.info.evaluation_samples);
        EXPECT_EQ(read.info.frame_skip, 5);
        EXPECT_EQ(read.info.epsilon, 0.25);
        EXPECT_EQ(read.info.provenance, written.info.provenance);
        EXPECT_EQ(read.info.stack, network.observation.front());
        EXPECT_EQ(read.network, network);
        EXPECT_EQ(error_of(policy_file_contents(written)), "no error");
    }
}

TEST(PolicyFileTest, TheGoldenObservationIsTheSameEverywhere) {
    const auto pixels = golden_observation(PolicyInfo{});
    ASSERT_EQ(pixels.size(), 4u * 84 * 84);
    EXPECT_EQ(pixels[0], 60);  // (1664525 + 1013904223) >> 24
    EXPECT_EQ(pixels[1], 94);
}

TEST(PolicyFileDamage, CutOffAnywhere) {
    const auto whole = policy_file_contents(small_sac());
    for (std::size_t size = 0; size < whole.size(); size = size < 6000 ? size + 7 : size + 499)
        EXPECT_THAT(error_of(whole.substr(0, size)), StartsWith("'x' cannot be used: ")) << size;
    EXPECT_THAT(error_of(whole + "x"), HasSubstr("bytes of data where its tensors need"));
}

TEST(PolicyFileDamage, AnyByteThatChanged) {
    const auto whole = policy_file_contents(small_sac());
    std::mt19937 random(5);
    for (int i = 0; i < 2'000; ++i) {
        auto bytes = whole;
        const auto at = random() % (i % 2 == 0 ? 4'000 : bytes.size());
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << random() % 8));
        const auto error = error_of(bytes);
        // Of the header's spaces alone nothing depends on.
        if (error == "no error") {
            EXPECT_EQ(policy_file_contents(parse_policy_file(bytes)), whole) << at;
        } else {
            EXPECT_THAT(error, StartsWith("'x' cannot be used: ")) << at;
            EXPECT_THAT(error, Not(HasSubstr("\n"))) << at;
        }
    }
}

TEST(PolicyFileDamage, ChangedWeightsAreNoticedByTheChecksum) {
    auto bytes = policy_file_contents(small_sac());
    // The sign of two numbers: what a weaker sum would miss.
    bytes[bytes.size() - 5'001] = static_cast<char>(bytes[bytes.size() - 5'001] ^ 0x80);
    bytes[bytes.size() - 5'009] = static_cast<char>(bytes[bytes.size() - 5'009] ^ 0x80);
    EXPECT_EQ(error_of(bytes),
              "'x' cannot be used: its checksum is not that of its contents: it was damaged or changed");
}

TEST(PolicyFileDamage, GoldenOutput) {
    EXPECT_THAT(error_after([](PolicyFile& policy) { policy.golden.output[2] += 0.01f; }),
                HasSubstr("its network does not give the golden output for the golden observation"));
    EXPECT_THAT(error_after([](PolicyFile& policy) { policy.weights["actor.out.bias"][0] += 0.01f; }),
                HasSubstr("golden output"));
    EXPECT_THAT(error_after([](PolicyFile& policy) { policy.golden.observation.assign(756, 0); }),
                HasSubstr("golden output"));
}

TEST(PolicyFileDamage, NumbersThatAreNone) {
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        EXPECT_THAT(
            error_after([&](PolicyFile& policy) { policy.weights["encoder.conv2.weight"][17] = bad; }),
            HasSubstr("tensor 'encoder.conv2.weight' holds a number that is not finite"));
        EXPECT_THAT(error_after([&](PolicyFile& policy) { policy.golden.output[0] = bad; }),
                    HasSubstr("tensor 'golden.output' holds a number that is not finite"));
    }
}

/// The contents with other texts in the metadata, and the checksum made right again.
std::string with_texts(const PolicyFile& policy, const std::function<void(Texts&)>& change) {
    auto texts = policy_file_texts(policy);
    const auto stored_contents = policy_file_contents(policy);
    const auto stored = stored_tensors(stored_contents);
    change(texts);
    texts["checksum"] = policy_checksum(texts, stored.tensors);
    std::vector<NamedShape> order;
    std::string data;
    for (const auto& [name, tensor] : stored.tensors) {
        order.push_back({name, tensor.type, tensor.shape});
        data += tensor.bytes;
    }
    return safetensors_header(order, texts) + data;
}

/// Changes one text, or removes it: "(missing)".
void set_text(Texts& texts, const std::string& key, const std::string& text) {
    texts[key] = text;
    if (text == "(missing)") texts.erase(key);
}

std::string with_text(const std::string& key, const std::string& text) {
    return with_texts(small_sac(), [&](Texts& texts) { set_text(texts, key, text); });
}

TEST(PolicyFileDamage, Texts) {
    EXPECT_EQ(error_of(with_text("threshold", "0.25")), "no error");
    const auto error = [](const std::string& key, const std::string& text) {
        return error_of(with_text(key, text));
    };
    const auto metadata = [](const std::string& what) { return "'x' cannot be used: its metadata " + what; };
    EXPECT_EQ(error("threshold", "1.5"), metadata("'threshold' is '1.5': it must be a number from 0 to 1"));
    EXPECT_EQ(error("threshold", "nan"), metadata("'threshold' is 'nan': it must be a number from 0 to 1"));
    EXPECT_EQ(error("threshold", ""), metadata("'threshold' is '': it must be a number from 0 to 1"));
    EXPECT_EQ(error("frame_skip", "4x"),
              metadata("'frame_skip' is '4x': it must be a whole number from 1 to 64"));
    EXPECT_EQ(error("frame_skip", "99999999999999999999"),
              metadata("'frame_skip' is '99999999999999999999': it must be a whole number from 1 to 64"));
    EXPECT_EQ(error("paddle_radius", "yes"), metadata("'paddle_radius' is 'yes': it must be true or false"));
    EXPECT_EQ(error("event_map", "round"),
              metadata("'event_map' is 'round': it must be one of symmetric, ale_0_10"));
    for (const auto& agent : {std::string("../sac"), std::string("a\nb"), std::string(65, 'a')}) {
        EXPECT_THAT(error("agent", agent), HasSubstr("it must be at most 64 letters, digits, '_' and '-'"));
        EXPECT_FALSE(is_agent_name(agent));
    }
    EXPECT_TRUE(is_agent_name("own-agent_2"));
    EXPECT_THAT(error("game", "Po\x1b[2Jng"), HasSubstr("it must be without control characters"));
    EXPECT_THAT(error("actions", std::string(4'000'000, ' ')), HasSubstr("at most 18 joystick events"));
    EXPECT_EQ(error("encoder", "(missing)"), metadata("'encoder' is missing"));
    EXPECT_EQ(error("network", "(missing)"), metadata("'network' is missing"));
    EXPECT_THAT(error("network", "observation 2 21 18; softmax"), HasSubstr("its network has no layers"));
    EXPECT_EQ(error("action_space", "none"),
              metadata("'action_space' is 'none': it must be one of continuous, minimal, full"));
    EXPECT_THAT(error("actions", "NOOP"), HasSubstr("the action space 'continuous' has no list of actions"));
    EXPECT_THAT(error("actions", "JUMP"), HasSubstr("joystick events by their names"));
    EXPECT_THAT(error("action_space", "minimal"),
                HasSubstr("head does not act on the action space 'minimal'"));
    EXPECT_THAT(error("cale_policy", "4"),
                HasSubstr("its format is version '4', this program reads versions 1 to 3"));
    EXPECT_THAT(error("cale_policy", "3"),
                HasSubstr("its format is version '3', but it has no text 'joystick'"));
    EXPECT_THAT(
        error("joystick", "cartesian"),
        HasSubstr("its format is version '2', but it has a text 'joystick', which only version 3 has"));
    EXPECT_THAT(error("cale_policy", "(missing)"), HasSubstr("not a policy that cale export made"));
}

/// The error with one part of the network's text replaced.
std::string error_with_network(const std::string& part, const std::string& replacement) {
    return error_of(with_texts(small_sac(), [&](Texts& texts) {
        auto& text = texts.at("network");
        text.replace(text.find(part), part.size(), replacement);
    }));
}

TEST(PolicyFileDamage, NetworksThatDoNotFitTheirWeights) {
    EXPECT_THAT(error_with_network("fc1 20", "fc1 21"),
                HasSubstr("tensor 'actor.fc1.weight' is F32 [20, 50]: its network needs F32 [21, 50]"));
    EXPECT_THAT(error_with_network("fc1 20", "fc1 65536"), HasSubstr("its network needs F32 [65536, 50]"));
    EXPECT_THAT(error_with_network("2 21 18", "2 512 512"), HasSubstr("its network needs"));
    EXPECT_THAT(error_with_network("dense actor.fc1 20; ", ""),
                HasSubstr("tensor 'actor.fc1.bias' is no part of its network"));
    EXPECT_THAT(
        error_with_network("dense actor.fc1 20; relu", "dense actor.fc1 20; relu; dense actor.fc2 20"),
        HasSubstr("tensor 'actor.fc2.weight' is missing"));
    EXPECT_THAT(error_with_network("dense encoder.actor_fc 50; layer_norm encoder.actor_ln",
                                   "dense encoder.actor_fc 50"),
                HasSubstr("tensor 'encoder.actor_ln.bias' is no part of its network"));
    EXPECT_THAT(error_with_network("same", "valid"), HasSubstr("its network needs"));
    EXPECT_THAT(error_with_network("squashed_gaussian", "categorical 6"),
                HasSubstr("head does not act on the action space 'continuous'"));
    const auto dqn = sample_policy(test::action_values(phi_dqn()));
    EXPECT_THAT(error_of(with_texts(dqn, [](Texts& texts) { texts["actions"] = "NOOP FIRE"; })),
                HasSubstr("another number of actions than are listed"));
    EXPECT_THAT(error_of(with_texts(dqn,
                                    [](Texts& texts) {
                                        texts["joystick"] = "cartesian";
                                        texts["cale_policy"] = "3";
                                    })),
                HasSubstr("'minimal' has no coordinates of a joystick"));
}

TEST(PolicyFileTest, TheJoystickFitsTheNetwork) {
    const auto with_joystick = [](const PolicyFile& policy, const std::string& joystick) {
        return error_of(with_texts(policy, [&](Texts& texts) {
            texts["joystick"] = joystick;
            texts["cale_policy"] = "3";
        }));
    };
    const auto sac = small_sac();
    EXPECT_EQ(policy_file_contents(sac).find("joystick"),
              std::string::npos);  // polar, as before there were others
    EXPECT_EQ(with_joystick(sac, "cartesian"), "no error");
    EXPECT_THAT(with_joystick(sac, "direction"), HasSubstr("3 coordinates, and its joystick 4"));
    EXPECT_THAT(with_joystick(sac, "factored"), HasSubstr("does not act on the action space 'continuous'"));
    EXPECT_THAT(with_joystick(sac, "polar"), HasSubstr("cartesian"));  // is written by leaving it out
    const auto factored = sample_policy(test::with_actions(kEventCount, test::action_values(phi_dqn())));
    EXPECT_THAT(with_joystick(factored, "factored"), "no error");
    EXPECT_THAT(error_of(with_texts(factored,
                                    [](Texts& texts) {
                                        auto& actions = texts["actions"];
                                        actions = actions.substr(actions.find(' ') + 1) + " " +
                                                  actions.substr(0, actions.find(' '));
                                    })),
                HasSubstr("not that of the factored joystick"));
}

/// The file as version 1 had it: a network by the names of its parts.
std::string of_version_1(const PolicyFile& policy, const std::map<std::string, std::string>& parts) {
    return with_texts(policy, [&](Texts& texts) {
        texts.erase("network");
        texts["cale_policy"] = "1";
        for (const auto& [key, text] : Texts{{"stack", "2"},
                                             {"frame_height", "21"},
                                             {"frame_width", "18"},
                                             {"encoder", "phi_sac"},
                                             {"phi_dqn", "conv2d"},
                                             {"padding", "same"},
                                             {"branch", "actor"},
                                             {"hidden_layers", "1"},
                                             {"hidden_units", "20"},
                                             {"activation", "relu"},
                                             {"head", "squashed_gaussian"},
                                             {"dueling", "false"},
                                             {"num_atoms", "1"},
                                             {"value_limit", "10"}})
            texts[key] = text;
        for (const auto& [key, text] : parts) set_text(texts, key, text);
    });
}

TEST(PolicyFileVersion1, IsReadAsTheNetworkThatItWas) {
    const std::map<std::string, Texts> parts{
        {"sac", {}},
        {"sac_dqn", {{"encoder", "phi_dqn"}}},
        {"sac_rows", {{"encoder", "phi_dqn"}, {"phi_dqn", "row1d"}}},
        {"sac_impala", {{"encoder", "impala"}, {"padding", "valid"}}},  // which always pads
        {"sacd", {{"head", "categorical"}}},
        {"deep", {{"hidden_layers", "3"}}},
        {"flat", {{"hidden_layers", "0"}}},
        {"ppo", {{"head", "gaussian"}, {"hidden_layers", "2"}, {"activation", "tanh"}}},
        {"ppo_discrete", {{"head", "categorical"}, {"hidden_layers", "2"}, {"activation", "tanh"}}},
        {"ppo_shared",
         {{"head", "gaussian"},
          {"hidden_layers", "2"},
          {"activation", "tanh"},
          {"branch", "shared"},
          {"padding", "valid"}}},
        {"dqn", {{"encoder", "phi_dqn"}, {"branch", "none"}, {"head", "values"}}},
        {"der",
         {{"encoder", "phi_dqn"},
          {"branch", "none"},
          {"head", "values"},
          {"dueling", "true"},
          {"num_atoms", "51"}}},
        {"der_impala",
         {{"encoder", "impala"},
          {"branch", "none"},
          {"head", "values"},
          {"dueling", "true"},
          {"num_atoms", "51"}}}};
    std::size_t seen = 0;
    for (const auto& [name, network] : test::sample_networks()) {
        const auto found = parts.find(name);
        if (found == parts.end()) continue;
        ++seen;
        SCOPED_TRACE(name);
        const auto contents = of_version_1(sample_policy(network), found->second);
        EXPECT_EQ(error_of(contents), "no error");
        const auto read = parse_policy_file(contents);
        EXPECT_EQ(read.network, network);
        EXPECT_EQ(read.info.provenance, sample_policy(network).info.provenance);
    }
    EXPECT_EQ(seen, parts.size());
}

TEST(PolicyFileVersion1, IsCheckedAsStrictly) {
    const auto error = [](const std::string& key, const std::string& text) {
        return error_of(of_version_1(small_sac(), {{key, text}}));
    };
    const auto metadata = [](const std::string& what) { return "'x' cannot be used: its metadata " + what; };
    EXPECT_EQ(error("hidden_layers", "99999999999999999999"),
              metadata("'hidden_layers' is '99999999999999999999': it must be a whole number from 0 to 16"));
    EXPECT_EQ(error("dueling", "yes"), metadata("'dueling' is 'yes': it must be true or false"));
    EXPECT_EQ(
        error("head", "softmax"),
        metadata("'head' is 'softmax': it must be one of squashed_gaussian, gaussian, categorical, values"));
    EXPECT_EQ(error("encoder", "mlp"),
              metadata("'encoder' is 'mlp': it must be one of phi_sac, phi_dqn, impala"));
    EXPECT_EQ(error("encoder", "(missing)"), metadata("'encoder' is missing"));
    EXPECT_THAT(error("hidden_units", "65536"), HasSubstr("its network needs F32 [65536, 50]"));
    EXPECT_THAT(error("hidden_layers", "0"), HasSubstr("tensor 'actor.fc1.bias' is no part of its network"));
    EXPECT_THAT(error("padding", "valid"), HasSubstr("its network needs"));
}

TEST(PolicyFileTest, ProvenanceMayNotBeCalledLikeASetting) {
    auto policy = small_sac();
    for (const auto* name : {"threshold", "checksum", "cale_policy", "network"}) {
        policy.info.provenance = {{name, "1"}};
        EXPECT_THROW(policy_file_contents(policy), std::invalid_argument);
    }
}

}  // namespace
}  // namespace cale
