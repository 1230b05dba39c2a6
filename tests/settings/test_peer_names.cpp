#include "settings/peer_names.h"

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "agents/der.h"
#include "agents/ppo.h"
#include "agents/sac.h"
#include "settings/run_config.h"

namespace cale {
namespace {

std::vector<ConfigEntry> entries_with(const std::vector<std::string>& keys) {
    std::vector<ConfigEntry> entries(keys.size());
    for (std::size_t i = 0; i < keys.size(); ++i) entries[i].key = keys[i];
    return entries;
}

template <class Agent>
void add_keys(std::vector<std::string>& keys) {
    RunConfig<Agent> config;
    const auto table = settings_of(config);
    for (const auto& entry : table.entries()) keys.push_back(entry.key);
}

TEST(PeerNames, EveryKeyIsOneOfOurs) {
    std::vector<std::string> keys;
    add_keys<SacConfig>(keys);
    add_keys<PpoConfig>(keys);
    add_keys<DerConfig>(keys);
    for (const auto& [name, key] : peer_names())
        EXPECT_THAT(keys, testing::Contains(std::string(key))) << name;
}

TEST(PeerNames, TheFirstKeyThatTheProgramHas) {
    const auto sac = entries_with({"agent.initial_alpha", "agent.replay_capacity"});
    const auto ppo = entries_with({"agent.initial_alpha", "agent.entropy_coefficient"});
    EXPECT_EQ(key_of_peer("ent_coef", sac), "agent.initial_alpha");
    EXPECT_EQ(key_of_peer("ent_coef", ppo), "agent.entropy_coefficient");
    EXPECT_EQ(key_of_peer("buffer_size", sac), "agent.replay_capacity");
    EXPECT_EQ(key_of_peer("buffer_size", ppo), "");
    EXPECT_EQ(key_of_peer("nothing", sac), "");
}

}  // namespace
}  // namespace cale
