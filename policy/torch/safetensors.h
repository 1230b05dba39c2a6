// Named tensors in a file, in the safetensors format: data only, so that loading executes nothing and
// untrusted files are safe to open. The format: policy/stored_tensors.h
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <torch/types.h>

#include "networks/layers.h"

namespace cale {

/// The contents of a safetensors file.
struct SafetensorsFile {
    TensorMap tensors;  // on the CPU, contiguous
    std::map<std::string, std::string> metadata;
};

/// Reads a whole file. Everything is checked before memory is allocated for it, which is
/// never much more than the file's size. Throws std::runtime_error that names the file and what is wrong.
SafetensorsFile load_safetensors(const std::filesystem::path& path);
/// The same for the contents of a file; errors name it `path`.
SafetensorsFile parse_safetensors(std::string_view contents, const std::filesystem::path& path);

/// The pieces of a file, in order.
struct SafetensorsPieces {
    std::string header;
    std::vector<torch::Tensor> tensors;  // on the CPU, contiguous
};

/// A file of these tensors, of any device and strides, and these texts.
/// Element types: float64, float32, float16, bfloat16, int64, int32, int16, int8, uint8, bool.
/// Throws std::invalid_argument, without a file's name, that names a tensor which cannot be stored.
SafetensorsPieces safetensors_pieces(const TensorMap& tensors,
                                     const std::map<std::string, std::string>& metadata);

}  // namespace cale
