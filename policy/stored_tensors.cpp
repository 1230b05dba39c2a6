#include "policy/stored_tensors.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <system_error>
#include <tuple>
#include <utility>

#include "cale/text.h"

namespace cale {
namespace {

static_assert(std::endian::native == std::endian::little,
              "the format is little-endian, and so must be this machine");

constexpr std::string_view kMetadata = "__metadata__";
constexpr std::size_t kLengthSize = 8;
constexpr std::size_t kAlignment = 8;
constexpr std::size_t kMaxHeader = 100'000'000;  // as in the reference implementation
constexpr std::size_t kMaxDimensions = 64;       // LibTorch's own limit

std::string number(std::uint64_t value) {
    return std::to_string(value);
}

/// Where a tensor of the header lies: what is needed to make it, all checked.
struct Entry {
    std::string name;
    ElementType type;
    std::vector<std::int64_t> shape;
    std::size_t begin;
    std::size_t end;
};

std::size_t natural(std::string_view value, const std::string& what) {
    const auto result = json_natural(value);
    if (!result || !std::in_range<std::size_t>(*result))
        throw FileDamage({what, " is not a whole number from 0"});
    return static_cast<std::size_t>(*result);
}

Entry parse_entry(const std::string& name, std::string_view description, std::size_t data_size) {
    const auto tensor = "tensor " + in_quotes(name);
    std::map<std::string, std::string_view> members;
    if (auto listed = json_members(description)) members.insert(listed->begin(), listed->end());
    if (members.size() != 3 || !members.contains("dtype") || !members.contains("shape") ||
        !members.contains("data_offsets")) {
        throw FileDamage({tensor, " must have dtype, shape and data_offsets, and nothing else"});
    }
    const auto dtype = json_text(members["dtype"]);
    const auto known = std::find_if(kElementTypes.begin(), kElementTypes.end(),
                                    [&](const ElementTypeInfo& type) { return dtype == type.name; });
    if (known == kElementTypes.end()) {
        // As the header has it, unless that might be more than a line.
        const auto written = members["dtype"];
        const bool is_short = written.size() < 100 && written.find_first_of("[{") == written.npos;
        throw FileDamage({tensor, " has the unknown dtype ", is_short ? printable(written) : "..."});
    }

    const auto shape = json_elements(members["shape"]);
    if (!shape || shape->size() > kMaxDimensions) {
        throw FileDamage(
            {tensor, " must have a list of at most ", number(kMaxDimensions), " sizes as its shape"});
    }
    Entry entry{name, static_cast<ElementType>(known - kElementTypes.begin()), {}, 0, 0};
    constexpr std::size_t max_bytes = std::numeric_limits<std::ptrdiff_t>::max();
    // Without the zeros: strides are products of sizes even where there are no elements.
    std::size_t extent = known->size;
    bool is_empty = false;
    for (const auto size_text : *shape) {
        const auto size = natural(size_text, tensor + ": a size of its shape");
        if (size > max_bytes / extent) {
            throw FileDamage({tensor, " has a shape with more elements than can be counted"});
        }
        extent *= std::max<std::size_t>(size, 1);
        is_empty = is_empty || size == 0;
        entry.shape.push_back(static_cast<std::int64_t>(size));
    }
    const std::size_t bytes = is_empty ? 0 : extent;

    const auto offsets = json_elements(members["data_offsets"]);
    if (!offsets || offsets->size() != 2) throw FileDamage({tensor, " must have two data_offsets"});
    entry.begin = natural((*offsets)[0], tensor + ": a data offset");
    entry.end = natural((*offsets)[1], tensor + ": a data offset");
    if (entry.begin > entry.end || entry.end > data_size) {
        throw FileDamage({tensor, " has the data offsets ", number(entry.begin), " to ", number(entry.end),
                          ", but the file holds ", number(data_size), " bytes of data"});
    }
    if (entry.end - entry.begin != bytes) {
        throw FileDamage({tensor, " has ", number(entry.end - entry.begin),
                          " bytes of data where its shape and dtype need ", number(bytes)});
    }
    return entry;
}

std::map<std::string, std::string> parse_metadata(std::string_view description) {
    const auto members = json_members(description);
    if (!members) throw FileDamage("its __metadata__ must map names to texts");
    std::map<std::string, std::string> metadata;
    for (const auto& [name, value] : *members) {
        auto text = json_text(value);
        if (!text) throw FileDamage({"its metadata ", in_quotes(name), " is not a text"});
        metadata[name] = std::move(*text);
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
            throw FileDamage({"tensor ", in_quotes(entry.name), " begins at byte ", number(entry.begin),
                              " of the data where ", number(position), " was expected"});
        }
        position = entry.end;
    }
    if (position != data_size) {
        throw FileDamage(
            {"it has ", number(data_size), " bytes of data where its tensors need ", number(position)});
    }
}

}  // namespace

bool may_be_header(std::uint64_t length, std::uint64_t size) {
    return length > 0 && size >= kLengthSize && length <= size - kLengthSize && length <= kMaxHeader;
}

StoredTensors stored_tensors(std::string_view file) {
    if (file.size() < kLengthSize)
        throw FileDamage({"it has ", number(file.size()), " bytes, too few for a header"});
    std::uint64_t length = 0;
    std::memcpy(&length, file.data(), kLengthSize);
    // An empty one fits, and is refused as JSON.
    if (length > 0 && !may_be_header(length, file.size())) {
        throw FileDamage({"its header of ", number(length),
                          " bytes does not fit; it is cut off or not a safetensors file"});
    }
    auto header = file.substr(kLengthSize, static_cast<std::size_t>(length));
    const auto data = file.substr(kLengthSize + header.size());
    check_json(header);
    header.remove_prefix(std::min(header.find_first_not_of(" \t\n\r"), header.size()));
    const auto members = json_members(header);
    if (!members) throw FileDamage("its header is not a JSON object");

    StoredTensors result;
    std::vector<Entry> entries;
    for (const auto& [name, description] : *members) {
        if (name == kMetadata) {
            result.metadata = parse_metadata(description);
        } else {
            entries.push_back(parse_entry(name, description, data.size()));
        }
    }
    check_layout(entries, data.size());
    for (auto& entry : entries) {
        result.tensors[entry.name] = {entry.type, std::move(entry.shape),
                                      data.substr(entry.begin, entry.end - entry.begin)};
    }
    return result;
}

std::string safetensors_header(const std::vector<NamedShape>& tensors,
                               const std::map<std::string, std::string>& metadata) {
    const auto text = [](std::string_view value) {
        if (!is_utf8(value)) throw std::invalid_argument("a name or a metadata text is not valid UTF-8");
        return to_json(value);
    };
    std::string header = "{";
    const auto next = [&] {
        if (header.size() > 1) header += ',';
    };
    if (!metadata.empty()) {
        header += to_json(kMetadata) + ":{";
        bool first = true;
        for (const auto& [name, value] : metadata) {
            if (!std::exchange(first, false)) header += ',';
            header += text(name) + ':' + text(value);
        }
        header += '}';
    }
    std::size_t position = 0;
    for (const auto& [name, type, shape] : tensors) {
        const auto& info = kElementTypes.at(static_cast<std::size_t>(type));
        std::size_t end = info.size;
        for (const auto size : shape) end *= static_cast<std::size_t>(size);
        end += position;
        next();
        header += text(name) + ":{\"dtype\":" + to_json(info.name) + ",\"shape\":" + text_of_shape(shape) +
                  ",\"data_offsets\":[" + number(position) + ',' + number(end) + "]}";
        position = end;
    }
    header += '}';
    header.resize((header.size() + kAlignment - 1) / kAlignment * kAlignment, ' ');
    const auto length = std::bit_cast<std::array<char, kLengthSize>>(std::uint64_t{header.size()});
    return std::string(length.data(), length.size()) + header;
}

std::string text_of_shape(const std::vector<std::int64_t>& shape) {
    std::string text = "[";
    for (const auto size : shape) text += (text.size() > 1 ? ", " : "") + std::to_string(size);
    return text + "]";
}

std::string read_whole_file(const std::filesystem::path& path) {
    const auto fail = [&](int error) {
        throw std::system_error(error, std::generic_category(), "cannot read '" + path.string() + "'");
    };
    std::error_code ignored;
    if (std::filesystem::is_directory(path, ignored)) fail(EISDIR);
    std::ifstream file(path, std::ios::binary);
    if (!file) fail(errno);
    // A pipe does not say how much is in it.
    const bool has_size = std::filesystem::is_regular_file(path, ignored);
    const auto expected = static_cast<std::size_t>(has_size ? file_size(path, ignored) : 0);
    std::array<char, kLengthSize> length{};
    file.read(length.data(), kLengthSize);
    std::string bytes(length.data(), static_cast<std::size_t>(file.gcount()));
    if (file && !may_be_header(std::bit_cast<std::uint64_t>(length), has_size ? expected : kMaxHeader))
        return bytes;
    for (std::size_t size = bytes.size(); file; size = bytes.size()) {
        try {
            bytes.resize(std::max<std::size_t>({2 * size, expected + 1, 65'536}));
        } catch (const std::exception&) {  // bad_alloc, or more than a string can hold
            fail(ENOMEM);
        }
        file.read(bytes.data() + size, static_cast<std::streamsize>(bytes.size() - size));
        bytes.resize(size + static_cast<std::size_t>(file.gcount()));
    }
    if (file.bad()) fail(errno);
    return bytes;
}

}  // namespace cale
