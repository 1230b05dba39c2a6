// The memory that an agent needs, computed before it is constructed.
#pragma once

#include <cstdint>
#include <string_view>

#include <torch/nn/module.h>

#include "agents/agent.h"
#include "policy/network_spec.h"

namespace cale {

/// Returns the bytes of all parameters of a module.
std::int64_t parameter_bytes(const torch::nn::Module& module);

/// The memory of a network and its target.
struct NetworkMemory {
    std::int64_t parameters;    // bytes of the network's parameters
    bool target;                // whether there is a target of the same size
    std::string_view settings;  // that reduce its size, for the error message
};

/// Returns the bytes of `available` that remain for the rest of the agent, after the parameters, their
/// gradients, Adam's two moments, the target, and the copies of them that a checkpoint is written from. On a
/// device other than the CPU only the copies count. Throws std::runtime_error, naming both figures and the
/// settings to lower, where they do not fit.
std::int64_t memory_beside(const NetworkMemory& networks, const AgentSpec& spec, std::int64_t available);

/// A network, and the half of it that acts.
struct BatchNetwork {
    const torch::nn::Module& whole;  // with critics
    const NetworkSpec& acting;       // from observations to actions
};

/// Returns the bytes of `available` that remain beside a gradient step on `batch_size` observations: these
/// and as many next ones as bytes, these as numbers, and the results of the acting half's convolutions and of
/// all dense layers and norms, with their gradients. That is less than is needed: what LibTorch keeps beside
/// it takes up to one and a half times as much again. On a device other than the CPU only the bytes count.
/// Throws std::runtime_error, naming both figures and the setting `key` to lower, where they do not fit.
std::int64_t memory_beside_batch(const BatchNetwork& network, std::int64_t batch_size, const AgentSpec& spec,
                                 std::int64_t available, std::string_view key);

/// Throws std::runtime_error for insufficient memory: `what` needs `needed` bytes, and how to reduce that.
[[noreturn]] void refuse_memory(std::string_view what, std::int64_t needed, std::int64_t available,
                                std::string_view way_out);

}  // namespace cale
