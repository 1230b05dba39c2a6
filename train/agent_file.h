// The agent's state in a checkpoint's folder: agent.safetensors.zst
//
// A file in the safetensors format, compressed by zstd: `zstd -d` makes one that Python reads. Tensors with
// the same contents are stored once, such as a target that equals its network, or the moments of an optimiser
// that has made no step: the metadata map the name of each other one to the name that is stored.
#pragma once

#include <filesystem>

#include "policy/torch/safetensors.h"

namespace cale {

/// Writes the file. Throws std::invalid_argument that names a tensor which cannot be stored, and
/// std::system_error, naming the file, where it cannot be written.
void save_agent(const std::filesystem::path& folder, const TensorMap& state);

/// The name of the file in the folder of a checkpoint.
inline constexpr const char* kAgentFile = "agent.safetensors.zst";

/// The tensors that were saved, each in memory of its own. Throws std::runtime_error that names the file and
/// what is wrong with it, before it allocates more than 32,768 times the file's size, zstd's largest
/// compression ratio.
TensorMap load_agent(const std::filesystem::path& folder);

}  // namespace cale
