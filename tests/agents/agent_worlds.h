// Worlds that an agent lives through within a unit test: frames of noise in which everything follows from the
// step, and a toy that has to be solved. Beside them, settings that make every agent small and quick.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "agents/agent.h"
#include "agents/der.h"
#include "agents/dqn.h"
#include "agents/ppo.h"
#include "agents/sac.h"
#include "agents/sacd.h"
#include "agents/state.h"

namespace cale {

inline constexpr std::int64_t kStack = 2;
inline constexpr std::int64_t kSide = 12;  // rows and columns of a frame
inline constexpr std::int64_t kPixels = kSide * kSide;
inline constexpr std::int64_t kNumActions = 4;  // of the discrete worlds

/// What an agent is told about them. A run lasts 1000 agent steps.
AgentSpec joystick_world(std::int64_t num_envs = 1, std::uint64_t seed = 1);
AgentSpec discrete_world(std::int64_t num_envs = 1, std::uint64_t seed = 1);

/// Sixteen hidden units behind the smallest encoder; updates after every step once 20 transitions are stored
/// (PPO: after every eighth).
ReplaySettings small_replay();
EncoderConfig small_encoder();
SacConfig small_sac();
DqnConfig small_dqn();
DerConfig small_der();
SacdConfig small_sacd();
PpoConfig small_ppo();

/// [count, stack, rows, columns] uint8
torch::Tensor noise_frames(std::int64_t count, std::uint64_t seed);
/// The same noise `count` times: what differs among the actions on it is chance.
torch::Tensor same_frame(std::int64_t count);

/// What the noise of a step brings: rewards of -2, -1, 0, 1 and 2 in turn, and an end every seven steps,
/// which is by turns a terminal and a truncation.
struct NoiseStep {
    NoiseStep(const AgentSpec& spec, std::int64_t step);

    torch::Tensor observations;       // [N, stack, rows, columns] uint8
    torch::Tensor frames;             // [N, rows, columns]: the newest of them
    torch::Tensor final_frames;       // [N, rows, columns]
    std::vector<StepResult> results;  // N
    StepBatch experiences(const torch::Tensor& actions) const;
};

/// One decision on the noise of this step, and what follows.
void act_and_observe(Agent& agent, const AgentSpec& spec, std::int64_t step);
/// The same for `steps` of them, with the update() before each. Returns how many of those said that they
/// updated.
std::int64_t drive(Agent& agent, const AgentSpec& spec, std::int64_t first_step, std::int64_t steps);

/// Gradient steps that the agent has made.
std::int64_t gradient_steps_of(Agent& agent);
/// What an agent with a replay remembers, oldest first.
Batch memory_of(Agent& agent);

void expect_equal(const TensorMap& first, const TensorMap& second);
/// The same numbers in memory of their own.
TensorMap copy_of(const TensorMap& tensors);
/// Coordinates spread evenly over the whole box, each by itself; actions [1000 or more, 3].
void expect_uniform_over_the_box(const torch::Tensor& actions);
/// How often each of the actions [B] was chosen, as parts of 1.
std::vector<double> frequencies(const torch::Tensor& actions);

/// The parameters by name, sharing memory with the module.
TensorMap parameters_of(const torch::nn::Module& module);
std::int64_t count_parameters(const torch::nn::Module& module);
/// Makes a dense layer, noisy or not, return these numbers whatever it is fed.
void make_constant(const TensorMap& parameters, const std::string& layer, const std::vector<double>& outputs);

/// One decision per episode: the lit quarter of the frame says which action is right, and brings a reward
/// of 1.
///   joystick  r > 1/2, theta in the quarter's own quadrant: one random action in eight
///   discrete  the quarter's own number: one in four
class Quarters {
  public:
    Quarters(std::int64_t num_envs, std::uint64_t seed);

    /// Lights one quarter in every environment: [N, stack, rows, columns].
    torch::Tensor show();
    std::vector<StepResult> judge(const torch::Tensor& actions) const;

  private:
    std::int64_t num_envs_;
    at::Generator random_;
    torch::Tensor lit_;  // [N]
};

/// Teaches the agent for so many steps of every environment. Returns the part of its actions in evaluation
/// that are right then.
double learned_after(Agent& agent, const AgentSpec& spec, std::int64_t steps);
/// What is asked of SAC, which knows three of the four quarters, 0.75, with some seeds and on some
/// processors. Random joysticks have 0.125.
constexpr double kSacLearned = 0.6;

}  // namespace cale
