// Named tensors in a file, in the safetensors format: data only, so that loading one
// executes nothing and a stranger's file may be opened.
// The format: https://huggingface.co/docs/safetensors
//   8 bytes  length of the header, little-endian
//   header   JSON: name -> {"dtype", "shape", "data_offsets": [begin, end)}, and the
//            texts of "__metadata__"; spaces fill it up to a multiple of 8 bytes
//   data     row-major, little-endian, without gaps
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "agents/agent.h"

namespace cale {

struct SafetensorsFile {
    TensorMap tensors;  // on the CPU, contiguous
    std::map<std::string, std::string> metadata;
};

/// Writes the tensors, of any device and strides, and the metadata; see write_file_atomically.
/// Element types: float64, float32, float16, bfloat16, int64, int32, int16, int8, uint8, bool.
/// Throws std::invalid_argument that names a tensor which cannot be stored and
/// std::system_error where the file cannot be written.
void save_safetensors(const std::filesystem::path& path, const TensorMap& tensors,
                      const std::map<std::string, std::string>& metadata = {});

/// Reads a whole file. Everything is checked before memory is allocated for it, which is
/// never much more than the file's size. Throws std::runtime_error that names the file and what is wrong.
SafetensorsFile load_safetensors(const std::filesystem::path& path);

}  // namespace cale
