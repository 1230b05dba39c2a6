#include "train/safetensors.h"

#include <stdexcept>
#include <string_view>
#include <vector>

#include <ATen/ATen.h>
#include <fmt/format.h>

#include "storage/files.h"

namespace cale {

SafetensorsPieces pieces_of(const std::filesystem::path& path, const TensorMap& tensors,
                            const std::map<std::string, std::string>& metadata) {
    try {
        return safetensors_pieces(tensors, metadata);
    } catch (const std::invalid_argument& error) {
        throw std::invalid_argument(fmt::format("cannot save '{}': {}", path.string(), error.what()));
    }
}

void save_safetensors(const std::filesystem::path& path, const TensorMap& tensors,
                      const std::map<std::string, std::string>& metadata) {
    const auto [header, stored] = pieces_of(path, tensors, metadata);
    std::vector<std::string_view> pieces{header};
    for (const auto& tensor : stored)
        pieces.emplace_back(static_cast<const char*>(tensor.const_data_ptr()), tensor.nbytes());
    write_file_atomically(path, pieces);
}

}  // namespace cale
