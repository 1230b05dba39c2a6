// Settings as text: which of them are the same.
#include "sweep/settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "settings/config.h"
#include "settings/setting_texts.h"

namespace cale {
namespace {

using testing::ElementsAre;
using testing::Pair;

TEST(Settings, AreReadAsTheProgramsPrintThem) {
    EXPECT_THAT(settings_in("env:\n  # the game\n  game: pong\n  rom_dir: \"\"\n\nagent:\n  tau: 0.005\n"),
                ElementsAre(Pair("agent.tau", "0.005"), Pair("env.game", "pong"), Pair("env.rom_dir", "")));
    EXPECT_TRUE(settings_in("").empty());
}

TEST(Settings, AreComparedByValueNotByText) {
    EXPECT_TRUE(same_value("1e-4", "0.0001"));
    EXPECT_TRUE(same_value("600_000", "600000"));
    EXPECT_TRUE(same_value("+6e5", "600000"));
    EXPECT_TRUE(same_value("on", "true"));
    EXPECT_TRUE(same_value("null", "none"));
    EXPECT_TRUE(same_value("huber", "huber"));
    EXPECT_TRUE(same_value("3-3", "3"));
    EXPECT_FALSE(same_value("3-4", "3"));
    EXPECT_FALSE(same_value("1e-4", "1e-5"));
    EXPECT_FALSE(same_value("4294967295", "4294967294"));
    EXPECT_FALSE(same_value("9223372036854775807", "9223372036854775806"));
    EXPECT_FALSE(same_value("true", "false"));
    EXPECT_FALSE(same_value("none", "0"));
    EXPECT_FALSE(same_value("huber", "mse"));
}

TEST(Settings, AreIntegersHoweverTheyAreWritten) {
    EXPECT_EQ(integer_in("2.5e3"), 2500);
    EXPECT_EQ(integer_in("50_000_000"), 50'000'000);
    EXPECT_THROW(integer_in("many"), ConfigError);
    EXPECT_EQ(if_integer("1e3"), 1000);
    EXPECT_EQ(if_integer("none"), std::nullopt);
}

}  // namespace
}  // namespace cale
