// Tensors by name: a network's parameters, an agent's state, the contents of a safetensors file.
#pragma once

#include <map>
#include <string>

#include <torch/types.h>

namespace cale {

using TensorMap = std::map<std::string, torch::Tensor>;

}  // namespace cale
