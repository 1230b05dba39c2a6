// The safetensors format, read without a copy: https://huggingface.co/docs/safetensors
//   8 bytes  length of the header, little-endian
//   header   JSON: name -> {"dtype", "shape", "data_offsets": [begin, end)}, and the
//            texts of "__metadata__"; spaces may fill it up
//   data     row-major, little-endian, without gaps
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "policy/json.h"

namespace cale {

enum class ElementType { f64, f32, f16, bf16, i64, i32, i16, i8, u8, boolean };
struct ElementTypeInfo {
    std::string_view name;  // in a header
    std::size_t size;       // bytes
};
/// In the order of ElementType.
inline constexpr std::array<ElementTypeInfo, 10> kElementTypes{{{"F64", 8},
                                                                {"F32", 4},
                                                                {"F16", 2},
                                                                {"BF16", 2},
                                                                {"I64", 8},
                                                                {"I32", 4},
                                                                {"I16", 2},
                                                                {"I8", 1},
                                                                {"U8", 1},
                                                                {"BOOL", 1}}};

/// A tensor as it lies in its file.
struct StoredTensor {
    ElementType type = ElementType::f32;
    std::vector<std::int64_t> shape;
    std::string_view bytes;  // of the file; at any address
};

/// A file's tensors and texts, by name.
struct StoredTensors {
    std::map<std::string, StoredTensor> tensors;
    std::map<std::string, std::string> metadata;
};

/// Checks everything that the format promises. The result refers to `file`.
/// Throws FileDamage that says what is wrong.
StoredTensors stored_tensors(std::string_view file);

/// A tensor's name, type and shape.
struct NamedShape {
    std::string name;
    ElementType type = ElementType::f32;
    std::vector<std::int64_t> shape;
};
/// The length and the header of a file whose data are the tensors' bytes in the order of `tensors`.
/// Throws std::invalid_argument for texts that are not UTF-8.
std::string safetensors_header(const std::vector<NamedShape>& tensors,
                               const std::map<std::string, std::string>& metadata);

/// "[32, 4, 8, 8]"
std::string text_of_shape(const std::vector<std::int64_t>& shape);

/// Returns whether a file of `size` bytes may have a header of `length` bytes; false for 0.
bool may_be_header(std::uint64_t length, std::uint64_t size);

/// Returns a whole file, which may be a pipe; its beginning where no header can follow, as of /dev/zero.
/// Throws std::system_error that names it and the reason.
std::string read_whole_file(const std::filesystem::path& path);

}  // namespace cale
