// Writing named tensors to a file; policy/torch/safetensors.h reads them.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "policy/torch/safetensors.h"

namespace cale {

/// safetensors_pieces() of a file: throws std::invalid_argument that names it, too.
SafetensorsPieces pieces_of(const std::filesystem::path& path, const TensorMap& tensors,
                            const std::map<std::string, std::string>& metadata);

/// Writes the tensors, of any device and strides, and the metadata; see write_file_atomically.
/// Element types: those of safetensors_pieces().
/// Throws std::invalid_argument that names a tensor which cannot be stored and
/// std::system_error where the file cannot be written.
void save_safetensors(const std::filesystem::path& path, const TensorMap& tensors,
                      const std::map<std::string, std::string>& metadata = {});

}  // namespace cale
