// Games played without learning.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "agents/agent.h"
#include "cale/env.h"
#include "cale/frames.h"
#include "experiment/run_config.h"

namespace cale {

struct EvaluatedGame {
    double episode_return = 0;  // undiscounted, neither clipped nor scaled
    std::int64_t length = 0;    // agent steps
    std::int64_t frames = 0;
};

struct Evaluation {
    std::vector<EvaluatedGame> games;
    std::array<std::int64_t, kEventCount> events{};  // how often each joystick event was asked for
    double mean_return = 0;
    double standard_deviation = 0;  // of the returns, divided by n
};

/// What an agent sees, as a tensor [N, depth, 84, 84] uint8: a view that lasts as long as
/// the stack and changes with it.
torch::Tensor stack_tensor(const FrameStack& stack, std::size_t num_envs, std::size_t depth);

/// Plays config.episodes games with the agent's evaluation policy. Neither the agent's
/// training nor the training environments are touched: all randomness comes from `seed`
/// and from the agent's own evaluation stream. The first game is filmed to `video` if
/// that is not empty.
Evaluation evaluate(Agent& agent, EnvConfig env, const EvalConfig& config, std::uint64_t seed,
                    std::size_t stack_depth, const std::filesystem::path& video);

/// One row per game: episode,return,length,frames.
void write_evaluation(const std::filesystem::path& csv, const Evaluation& evaluation);

}  // namespace cale
