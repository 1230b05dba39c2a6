// Networks that are counted without being made.
#include <ATen/CPUGeneratorImpl.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include "agents/memory.h"
#include "networks/actor_critic.h"
#include "networks/ppo_network.h"
#include "networks/q_network.h"
#include "networks/sacd_network.h"

namespace cale {
namespace {

TEST(NoValues, HaveTheSizeOfTheWholeNetwork) {
    const auto generator = at::detail::createCPUGenerator(1);
    const HeadConfig head{.hidden_layers = 2, .hidden_units = 24};
    for (const auto kind :
         {EncoderKind::phi_sac, EncoderKind::phi_dqn, EncoderKind::impala, EncoderKind::mlp}) {
        const EncoderConfig encoder{.encoder = kind};
        EXPECT_EQ(parameter_bytes(*SacNetwork(encoder, head, no_values())),
                  parameter_bytes(*SacNetwork(encoder, head, generator)));
        EXPECT_EQ(parameter_bytes(*SacdNetwork(encoder, head, 6, no_values())),
                  parameter_bytes(*SacdNetwork(encoder, head, 6, generator)));
        for (const bool rainbow : {false, true}) {
            const QHeadConfig values{
                .num_actions = 6, .num_atoms = rainbow ? 51 : 1, .dueling = rainbow, .noisy = rainbow};
            EXPECT_EQ(parameter_bytes(*QNetwork(encoder, values, no_values())),
                      parameter_bytes(*QNetwork(encoder, values, generator)));
        }
        for (const auto torso : {Torso::two_branch, Torso::shared}) {
            for (const std::int64_t actions : {0, 6}) {
                const PpoNetworkConfig config{.encoder = encoder, .torso = torso};
                EXPECT_EQ(parameter_bytes(*PpoNetwork(config, actions, no_values())),
                          parameter_bytes(*PpoNetwork(config, actions, generator)));
            }
        }
    }
}

TEST(NoValues, OfADenseLayerAreFloats) {
    EXPECT_EQ(parameter_bytes(*Dense(1'000'000, 1'000'000, glorot_uniform(), no_values())),
              4 * (1'000'000'000'000 + 1'000'000));
}

}  // namespace
}  // namespace cale
