// The parameters that a NetworkSpec stands for, and the sizes of its head.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "policy/network_spec.h"

namespace cale {

/// Returns how many outputs a head of values has, each of num_atoms: one for each action or, with factors,
/// for each choice.
std::int64_t num_outputs(const Head& head);

/// Returns the head's dense layers on so many inputs: actor.out, actor.mean, head.out, or head.adv and
/// head.value.
std::vector<SizedLayer> head_layers(const Head& head, std::int64_t inputs);

/// A parameter of a network, float32.
struct ParameterShape {
    std::string name;                 // "encoder.conv1.weight"
    std::vector<std::int64_t> shape;  // in PyTorch's order: outputs first
};
/// Returns every parameter of the network: "encoder.conv1.weight", ... Throws as sized_layers() does.
std::vector<ParameterShape> parameter_shapes(const NetworkSpec& network);

/// Returns how many numbers Policy::output has for one observation.
std::int64_t output_size(const Head& head);

}  // namespace cale
