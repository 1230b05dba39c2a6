#include "policy/torch/safetensors.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>
#include <string_view>

#include <ATen/ATen.h>

#include "policy/stored_tensors.h"

namespace cale {
namespace {

/// In the order of ElementType.
constexpr std::array kScalarTypes{at::kDouble, at::kFloat, at::kHalf, at::kBFloat16, at::kLong,
                                  at::kInt,    at::kShort, at::kChar, at::kByte,     at::kBool};
static_assert(kScalarTypes.size() == kElementTypes.size());

torch::Tensor make_tensor(const std::string& name, const StoredTensor& stored) {
    const auto bytes = stored.bytes;
    // Any other byte in a bool would be undefined behaviour.
    if (stored.type == ElementType::boolean &&
        std::ranges::any_of(bytes, [](char c) { return c != 0 && c != 1; })) {
        throw FileDamage({"tensor ", in_quotes(name), " has truth values other than 0 and 1"});
    }
    auto tensor = at::empty(stored.shape, kScalarTypes.at(static_cast<std::size_t>(stored.type)));
    if (!bytes.empty()) std::memcpy(tensor.data_ptr(), bytes.data(), bytes.size());
    return tensor;
}

}  // namespace

SafetensorsFile load_safetensors(const std::filesystem::path& path) {
    return parse_safetensors(read_whole_file(path), path);
}

SafetensorsFile parse_safetensors(std::string_view contents, const std::filesystem::path& path) {
    try {
        auto stored = stored_tensors(contents);
        SafetensorsFile file{{}, std::move(stored.metadata)};
        for (const auto& [name, tensor] : stored.tensors)
            file.tensors.emplace(name, make_tensor(name, tensor));
        return file;
    } catch (const FileDamage& damage) {
        throw std::runtime_error("'" + path.string() + "' cannot be used: " + damage.what());
    }
}

SafetensorsPieces safetensors_pieces(const TensorMap& tensors,
                                     const std::map<std::string, std::string>& metadata) {
    struct Item {
        NamedShape shape;
        torch::Tensor tensor;
    };
    std::vector<Item> items;
    for (const auto& [name, tensor] : tensors) {
        const auto reject = [&, &name = name](const std::string& why) {
            throw std::invalid_argument(std::string("tensor '").append(name).append("' ").append(why));
        };
        if (name == "__metadata__") reject("has the name that the format keeps for metadata");
        if (!tensor.defined()) reject("is undefined");
        const auto known = std::ranges::find(kScalarTypes, tensor.scalar_type());
        if (known == kScalarTypes.end() || tensor.layout() != at::kStrided)
            reject("is a " + tensor.toString() + " tensor, which the format does not know");
        const auto type = static_cast<ElementType>(known - kScalarTypes.begin());
        items.push_back({{name, type, tensor.sizes().vec()}, tensor.detach().to(at::kCPU).contiguous()});
    }
    // Widest elements first: then every tensor lies at a multiple of its element size.
    std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
        return a.tensor.element_size() > b.tensor.element_size();
    });
    std::vector<NamedShape> shapes;
    SafetensorsPieces pieces;
    for (auto& item : items) {
        shapes.push_back(std::move(item.shape));
        pieces.tensors.push_back(std::move(item.tensor));
    }
    pieces.header = safetensors_header(shapes, metadata);
    return pieces;
}

}  // namespace cale
