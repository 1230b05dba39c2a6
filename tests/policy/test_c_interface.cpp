#include "policy/cale_policy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>

#include "policy/observer.h"
#include "policy/policy_lite.h"
#include "policy/sample_policies.h"

namespace cale {
namespace {

using ::testing::HasSubstr;
using PolicyHandle = std::unique_ptr<cale_policy, decltype(&cale_policy_free)>;
using SessionHandle = std::unique_ptr<cale_session, decltype(&cale_session_free)>;

/// A policy of the ordinary size.
std::string contents() {
    const NetworkSpec network{.layers = chain({prefixed("encoder.", phi_dqn()),
                                               {Layer::dense("head.fc1", 8), Layer::of(Layer::Kind::relu)}}),
                              .head = {.kind = Head::Kind::values, .num_actions = 4}};
    return policy_file_contents(test::sample_policy(network));
}

class CInterface : public testing::Test {
  protected:
    std::string bytes = contents();
    PolicyHandle policy{cale_policy_parse(bytes.data(), bytes.size()), cale_policy_free};
    SessionHandle session{cale_session_new(policy.get(), 210, 1), cale_session_free};
    std::vector<std::uint8_t> screen = test::random_pixels(std::size_t{210} * 160 * 3, 1);
};

TEST_F(CInterface, SaysWhatThePolicyIs) {
    EXPECT_EQ(cale_policy_version(), 1);
    cale_policy_info info;
    ASSERT_EQ(cale_policy_get_info(policy.get(), &info), 1);
    EXPECT_EQ(info.num_actions, 4);
    EXPECT_EQ(info.stack, 4);
    EXPECT_EQ(info.frame_height, 84);
    EXPECT_EQ(info.frame_skip, 4);
    EXPECT_EQ(info.epsilon, 0.25);
    EXPECT_STREQ(cale_policy_text(policy.get(), "game"), "Breakout");
    EXPECT_STREQ(cale_policy_text(policy.get(), "action_space"), "minimal");
    EXPECT_STREQ(cale_policy_text(policy.get(), "joystick"), "polar");
    EXPECT_STREQ(cale_policy_text(policy.get(), "seed"), "7");
    EXPECT_EQ(cale_policy_text(policy.get(), "colour"), nullptr);
}

TEST_F(CInterface, PlaysAsTheLibraryBelow) {
    const auto below = lite::Policy::parse(bytes);
    auto workspace = below.workspace();
    Observer observer(below.info());
    EXPECT_EQ(cale_session_due(session.get()), 0) << "before a game has begun";
    ASSERT_EQ(cale_session_start(session.get(), screen.data(), screen.size()), 1);
    observer.start(screen);
    for (std::uint32_t i = 0; i < 12; ++i) {
        EXPECT_EQ(cale_session_due(session.get()), observer.due());
        cale_decision decision;
        ASSERT_EQ(cale_session_act(session.get(), CALE_GREEDY, &decision), 1);
        const auto expected = below.act(observer.observation(), workspace);
        EXPECT_EQ(decision.action, expected.action);
        EXPECT_EQ(decision.event, static_cast<int>(expected.event));
        cale_decision again;
        ASSERT_EQ(cale_session_act_on(session.get(), observer.observation().data(), 4 * 84 * 84, CALE_GREEDY,
                                      &again),
                  1);
        EXPECT_EQ(again.action, decision.action);
        screen = test::random_pixels(screen.size(), i + 2);
        ASSERT_EQ(cale_session_see(session.get(), screen.data(), screen.size()), 1);
        observer.see(screen);
    }
    EXPECT_EQ(cale_session_lose_life(session.get()), 1);
}

TEST(CInterfaceOfTheJoystick, EveryChoiceIsThatOfTheLibraryBelow) {
    const NetworkSpec network{.layers = chain({prefixed("encoder.", phi_dqn()),
                                               {Layer::dense("actor.fc1", 8), Layer::of(Layer::Kind::relu)}}),
                              .head = {.kind = Head::Kind::squashed_gaussian}};
    const auto bytes = policy_file_contents(test::sample_policy(network));
    const PolicyHandle policy{cale_policy_parse(bytes.data(), bytes.size()), cale_policy_free};
    const SessionHandle session{cale_session_new(policy.get(), 210, 5), cale_session_free};
    const auto below = lite::Policy::parse(bytes);
    auto workspace = below.workspace();
    std::mt19937_64 random(5);
    for (std::uint32_t i = 0; i < 8; ++i) {
        const auto observation = test::random_pixels(std::size_t{4} * 84 * 84, i);
        for (const auto& [number, choice] : {std::pair{CALE_SAMPLED, Choice::sampled},
                                             {CALE_AS_EVALUATED, Choice::as_evaluated},
                                             {CALE_GREEDY, Choice::greedy}}) {
            cale_decision decision;
            ASSERT_EQ(
                cale_session_act_on(session.get(), observation.data(), observation.size(), number, &decision),
                1)
                << cale_policy_error();
            const auto expected = below.act(observation, workspace, choice, random);
            EXPECT_EQ(decision.radius, expected.stick.radius);
            EXPECT_EQ(decision.theta, expected.stick.theta);
            EXPECT_EQ(decision.fire, expected.stick.fire);
            EXPECT_EQ(decision.strength, expected.strength);
            EXPECT_EQ(decision.action, -1);
            EXPECT_EQ(decision.event, static_cast<int>(expected.event));
        }
    }
}

TEST_F(CInterface, NothingIsDecidedBeforeAGameHasBegun) {
    cale_decision decision;
    EXPECT_EQ(cale_session_act(session.get(), CALE_GREEDY, &decision), 0);
    EXPECT_STREQ(cale_policy_error(), "no game has begun in this session: call cale_session_start() first");
}

TEST(CInterfaceOfOtherFrames, DecidesOnObservationsOfTheCallersOwn) {
    const NetworkSpec network{.observation = {2, 12, 12},
                              .layers = {Layer::of(Layer::Kind::flatten), Layer::dense("head.fc1", 8),
                                         Layer::of(Layer::Kind::relu)},
                              .head = {.kind = Head::Kind::values, .num_actions = 4}};
    const auto bytes = policy_file_contents(test::sample_policy(network));
    const PolicyHandle policy{cale_policy_parse(bytes.data(), bytes.size()), cale_policy_free};
    ASSERT_NE(policy, nullptr) << cale_policy_error();
    const SessionHandle session{cale_session_new(policy.get(), 210, 1), cale_session_free};
    ASSERT_NE(session, nullptr) << cale_policy_error();
    const auto observation = test::random_pixels(std::size_t{2} * 12 * 12, 1);
    cale_decision decision;
    ASSERT_EQ(
        cale_session_act_on(session.get(), observation.data(), observation.size(), CALE_GREEDY, &decision), 1)
        << cale_policy_error();
    const auto below = lite::Policy::parse(bytes);
    auto workspace = below.workspace();
    EXPECT_EQ(decision.action, below.act(observation, workspace).action);
    EXPECT_EQ(cale_session_due(session.get()), 0);
    for (const int result :
         {cale_session_start(session.get(), observation.data(), observation.size()),
          cale_session_see(session.get(), observation.data(), observation.size()),
          cale_session_lose_life(session.get()), cale_session_act(session.get(), CALE_GREEDY, &decision)}) {
        EXPECT_EQ(result, 0);
    }
    EXPECT_THAT(cale_policy_error(), HasSubstr("frames of 12x12, which are not made of screens: call "
                                               "cale_session_act_on()"));
}

TEST_F(CInterface, ASessionOutlivesItsPolicy) {
    policy.reset();
    ASSERT_EQ(cale_session_start(session.get(), screen.data(), screen.size()), 1);
    cale_decision decision;
    EXPECT_EQ(cale_session_act(session.get(), CALE_AS_EVALUATED, &decision), 1);
}

TEST_F(CInterface, FailuresAreAValueAndASentence) {
    EXPECT_EQ(cale_policy_load("/no/such.safetensors"), nullptr);
    EXPECT_STREQ(cale_policy_error(), "cannot read '/no/such.safetensors': No such file or directory");
    EXPECT_EQ(cale_policy_parse(bytes.data(), bytes.size() - 1), nullptr);
    EXPECT_THAT(cale_policy_error(), HasSubstr("'policy' cannot be used: "));
    EXPECT_EQ(cale_session_new(policy.get(), 12, 1), nullptr);
    EXPECT_THAT(cale_policy_error(), HasSubstr("12 rows"));
    EXPECT_EQ(cale_session_see(session.get(), screen.data(), 7), 0);
    EXPECT_THAT(cale_policy_error(), HasSubstr("a screen has 7 bytes"));
    cale_decision decision;
    EXPECT_EQ(cale_session_act(session.get(), 3, &decision), 0);
    EXPECT_THAT(cale_policy_error(), HasSubstr("there is no choice 3"));
    EXPECT_EQ(cale_session_act_on(session.get(), screen.data(), 5, CALE_GREEDY, &decision), 0);
    EXPECT_THAT(cale_policy_error(), HasSubstr("an observation has 5 bytes"));
}

TEST_F(CInterface, NullIsAFailureToo) {
    cale_decision decision;
    EXPECT_EQ(cale_policy_load(nullptr), nullptr);
    EXPECT_STREQ(cale_policy_error(), "the path is NULL");
    EXPECT_EQ(cale_policy_parse(nullptr, 8), nullptr);
    EXPECT_EQ(cale_policy_get_info(nullptr, nullptr), 0);
    EXPECT_EQ(cale_policy_get_info(policy.get(), nullptr), 0);
    EXPECT_EQ(cale_policy_text(nullptr, "game"), nullptr);
    EXPECT_EQ(cale_policy_text(policy.get(), nullptr), nullptr);
    EXPECT_EQ(cale_session_new(nullptr, 210, 1), nullptr);
    EXPECT_EQ(cale_session_start(nullptr, screen.data(), screen.size()), 0);
    EXPECT_EQ(cale_session_start(session.get(), nullptr, 0), 0);
    EXPECT_EQ(cale_session_lose_life(nullptr), 0);
    EXPECT_EQ(cale_session_due(nullptr), 0);
    EXPECT_EQ(cale_session_act(session.get(), CALE_GREEDY, nullptr), 0);
    EXPECT_EQ(cale_session_act(nullptr, CALE_GREEDY, &decision), 0);
    cale_policy_free(nullptr);
    cale_session_free(nullptr);
}

}  // namespace
}  // namespace cale
