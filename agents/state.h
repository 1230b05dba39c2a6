// How an agent's state becomes named tensors and comes back from them.
#pragma once

#include <cstdint>
#include <map>
#include <random>
#include <string>

#include <ATen/core/Generator.h>
#include <torch/nn/module.h>
#include <torch/types.h>

#include "networks/layers.h"

namespace cale {

/// Everything that an agent's future depends on, under the names it is stored with. The
/// entries refer to the agent's own: one list serves saving and restoring.
struct StateParts {
    TensorMap tensors;                                 // share memory with the agent's
    std::map<std::string, at::Generator*> generators;  // on any device
    std::map<std::string, std::mt19937_64*> engines;   // the replay's
    std::map<std::string, std::int64_t*> counters;     // whole numbers

    /// The parameters of `module` as prefix + "encoder.conv1.weight" and so on.
    void add(const std::string& prefix, const torch::nn::Module& module);
    /// These tensors as prefix + name.
    void add(const std::string& prefix, const TensorMap& named);
};

/// Adds what is `named` to `state` as prefix + name.
void add_part(TensorMap& state, const std::string& prefix, const TensorMap& named);
/// Returns what add_part() added with this prefix, under its own names.
TensorMap part_of(const TensorMap& state, const std::string& prefix);

/// Copies on the CPU.
TensorMap saved(const StateParts& parts);

/// Throws std::runtime_error, and leaves every part as it was, where the state lacks a
/// part or holds it in another shape or type.
void restore(const StateParts& parts, const TensorMap& state);

}  // namespace cale
