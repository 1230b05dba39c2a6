#include "experiment/safetensors.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <set>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <ATen/ATen.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "experiment/files.h"

namespace cale {
namespace {

static_assert(std::endian::native == std::endian::little,
              "the format is little-endian, and so must be this machine");

using nlohmann::json;

constexpr std::string_view kMetadata = "__metadata__";
constexpr std::size_t kLengthSize = 8;
constexpr std::size_t kAlignment = 8;
constexpr std::size_t kMaxHeader = 100'000'000;  // as in the reference implementation
constexpr std::size_t kMaxDimensions = 64;       // LibTorch's own limit

struct ElementType {
    std::string_view name;
    at::ScalarType type;
};
constexpr std::array kElementTypes{
    ElementType{"F64", at::kDouble},    ElementType{"F32", at::kFloat}, ElementType{"F16", at::kHalf},
    ElementType{"BF16", at::kBFloat16}, ElementType{"I64", at::kLong},  ElementType{"I32", at::kInt},
    ElementType{"I16", at::kShort},     ElementType{"I8", at::kChar},   ElementType{"U8", at::kByte},
    ElementType{"BOOL", at::kBool},
};

/// Where a tensor of the header lies: what is needed to make it, all checked.
struct Entry {
    std::string name;
    at::ScalarType type;
    std::vector<std::int64_t> shape;
    std::size_t begin;
    std::size_t end;
};

/// A sentence about the file, which load_safetensors puts the name in front of.
struct Damage {
    std::string what;
};

/// A stranger's text for an error message: control characters are escaped.
std::string quoted(const std::string& text) {
    auto result = json(text).dump();
    result.front() = result.back() = '\'';
    return result;
}

/// The header's JSON. nlohmann::json takes the last of duplicate names and any depth; both are refused here.
json parse_header(std::string_view text) {
    std::vector<std::set<std::string>> names;
    const auto watch = [&](int depth, json::parse_event_t event, json& value) {
        if (depth > 4) throw Damage{"its header is nested too deeply"};
        if (event == json::parse_event_t::object_start) names.emplace_back();
        if (event == json::parse_event_t::object_end) names.pop_back();
        if (event == json::parse_event_t::key) {
            const auto& name = value.get_ref<const std::string&>();
            if (!names.back().insert(name).second)
                throw Damage{fmt::format("its header has {} twice", quoted(name))};
        }
        return true;
    };
    try {
        return json::parse(text, watch);
    } catch (const json::exception&) {
        throw Damage{"its header is not valid JSON"};
    }
}

std::size_t natural(const json& value, const std::string& what) {
    if (!value.is_number_unsigned()) throw Damage{what + " is not a whole number from 0"};
    return value.get<std::size_t>();
}

Entry parse_entry(const std::string& name, const json& description, std::size_t data_size) {
    const auto tensor = "tensor " + quoted(name);
    if (!description.is_object() || description.size() != 3 || !description.contains("dtype") ||
        !description.contains("shape") || !description.contains("data_offsets")) {
        throw Damage{tensor + " must have dtype, shape and data_offsets, and nothing else"};
    }
    const auto& dtype = description["dtype"];
    const auto known = std::find_if(kElementTypes.begin(), kElementTypes.end(),
                                    [&](const ElementType& type) { return dtype == type.name; });
    if (known == kElementTypes.end()) {
        throw Damage{fmt::format("{} has the unknown dtype {}", tensor, dtype.dump())};
    }

    const auto& shape = description["shape"];
    if (!shape.is_array() || shape.size() > kMaxDimensions) {
        throw Damage{
            fmt::format("{} must have a list of at most {} sizes as its shape", tensor, kMaxDimensions)};
    }
    Entry entry{name, known->type, {}, 0, 0};
    constexpr std::size_t max_bytes = std::numeric_limits<std::int64_t>::max();
    // Without the zeros: strides are products of sizes even where there are no elements.
    std::size_t extent = c10::elementSize(known->type);
    bool is_empty = false;
    for (const auto& size_value : shape) {
        const auto size = natural(size_value, tensor + ": a size of its shape");
        if (size > max_bytes / extent) {
            throw Damage{tensor + " has a shape with more elements than can be counted"};
        }
        extent *= std::max<std::size_t>(size, 1);
        is_empty = is_empty || size == 0;
        entry.shape.push_back(static_cast<std::int64_t>(size));
    }
    const std::size_t bytes = is_empty ? 0 : extent;

    const auto& offsets = description["data_offsets"];
    if (!offsets.is_array() || offsets.size() != 2) throw Damage{tensor + " must have two data_offsets"};
    entry.begin = natural(offsets[0], tensor + ": a data offset");
    entry.end = natural(offsets[1], tensor + ": a data offset");
    if (entry.begin > entry.end || entry.end > data_size) {
        throw Damage{fmt::format("{} has the data offsets {} to {}, but the file holds {} bytes of data",
                                 tensor, entry.begin, entry.end, data_size)};
    }
    if (entry.end - entry.begin != bytes) {
        throw Damage{fmt::format("{} has {} bytes of data where its shape and dtype need {}", tensor,
                                 entry.end - entry.begin, bytes)};
    }
    return entry;
}

std::map<std::string, std::string> parse_metadata(const json& description) {
    if (!description.is_object()) throw Damage{"its __metadata__ must map names to texts"};
    std::map<std::string, std::string> metadata;
    for (const auto& [name, value] : description.items()) {
        if (!value.is_string()) throw Damage{fmt::format("its metadata {} is not a text", quoted(name))};
        metadata[name] = value.get<std::string>();
    }
    return metadata;
}

/// Together the tensors must be the data, each byte once.
void check_layout(std::vector<Entry> entries, std::size_t data_size) {
    std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
        return std::tie(a.begin, a.end) < std::tie(b.begin, b.end);
    });
    std::size_t position = 0;
    for (const auto& entry : entries) {
        if (entry.begin != position) {
            throw Damage{fmt::format("tensor {} begins at byte {} of the data where {} was expected",
                                     quoted(entry.name), entry.begin, position)};
        }
        position = entry.end;
    }
    if (position != data_size) {
        throw Damage{fmt::format("it has {} bytes of data where its tensors need {}", data_size, position)};
    }
}

torch::Tensor make_tensor(const Entry& entry, std::string_view data) {
    const auto bytes = data.substr(entry.begin, entry.end - entry.begin);
    // Any other byte in a bool would be undefined behaviour.
    if (entry.type == at::kBool &&
        std::any_of(bytes.begin(), bytes.end(), [](char c) { return c != 0 && c != 1; })) {
        throw Damage{fmt::format("tensor {} has truth values other than 0 and 1", quoted(entry.name))};
    }
    auto tensor = at::empty(entry.shape, at::TensorOptions(entry.type));
    if (!bytes.empty()) std::memcpy(tensor.data_ptr(), bytes.data(), bytes.size());
    return tensor;
}

SafetensorsFile parse(std::string_view file) {
    if (file.size() < kLengthSize)
        throw Damage{fmt::format("it has {} bytes, too few for a header", file.size())};
    std::uint64_t length = 0;
    std::memcpy(&length, file.data(), kLengthSize);
    if (length > file.size() - kLengthSize || length > kMaxHeader) {
        throw Damage{fmt::format(
            "its header of {} bytes does not fit; it is cut off or not a safetensors file", length)};
    }
    const auto data = file.substr(kLengthSize + length);
    const auto header = parse_header(file.substr(kLengthSize, length));
    if (!header.is_object()) throw Damage{"its header is not a JSON object"};

    SafetensorsFile result;
    std::vector<Entry> entries;
    for (const auto& [name, description] : header.items()) {
        if (name == kMetadata) {
            result.metadata = parse_metadata(description);
        } else {
            entries.push_back(parse_entry(name, description, data.size()));
        }
    }
    check_layout(entries, data.size());
    for (const auto& entry : entries) result.tensors.emplace(entry.name, make_tensor(entry, data));
    return result;
}

}  // namespace

void save_safetensors(const std::filesystem::path& path, const TensorMap& tensors,
                      const std::map<std::string, std::string>& metadata) {
    const auto reject = [&](const std::string& name, std::string_view why) {
        throw std::invalid_argument(
            fmt::format("cannot save '{}': tensor '{}' {}", path.string(), name, why));
    };
    struct Item {
        std::string_view name;
        std::string_view dtype;
        torch::Tensor tensor;
    };
    std::vector<Item> items;
    for (const auto& [name, tensor] : tensors) {
        if (name == kMetadata) reject(name, "has the name that the format keeps for metadata");
        if (!tensor.defined()) reject(name, "is undefined");
        const auto known =
            std::find_if(kElementTypes.begin(), kElementTypes.end(),
                         [&](const ElementType& type) { return tensor.scalar_type() == type.type; });
        if (known == kElementTypes.end() || tensor.layout() != at::kStrided) {
            reject(name, fmt::format("is a {} tensor, which the format does not know", tensor.toString()));
        }
        items.push_back({name, known->name, tensor.detach().to(at::kCPU).contiguous()});
    }
    // Widest elements first: then every tensor lies at a multiple of its element size.
    std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
        return a.tensor.element_size() > b.tensor.element_size();
    });

    auto header = json::object();
    if (!metadata.empty()) header[std::string(kMetadata)] = metadata;
    std::size_t position = 0;
    for (const auto& item : items) {
        const auto end = position + item.tensor.nbytes();
        header[std::string(item.name)] = {
            {"dtype", item.dtype}, {"shape", item.tensor.sizes().vec()}, {"data_offsets", {position, end}}};
        position = end;
    }
    std::string text;
    try {
        text = header.dump();
    } catch (const json::exception&) {
        throw std::invalid_argument(
            fmt::format("cannot save '{}': a name or a metadata text is not valid UTF-8", path.string()));
    }
    text.resize((text.size() + kAlignment - 1) / kAlignment * kAlignment, ' ');
    const auto length = std::bit_cast<std::array<char, kLengthSize>>(std::uint64_t{text.size()});

    std::vector<std::string_view> pieces{{length.data(), length.size()}, text};
    for (const auto& item : items) {
        pieces.emplace_back(static_cast<const char*>(item.tensor.const_data_ptr()), item.tensor.nbytes());
    }
    write_file_atomically(path, pieces);
}

SafetensorsFile load_safetensors(const std::filesystem::path& path) {
    const auto file = read_file(path);
    try {
        return parse(file);
    } catch (const Damage& damage) {
        throw std::runtime_error(fmt::format("'{}' cannot be used: {}", path.string(), damage.what));
    }
}

}  // namespace cale
