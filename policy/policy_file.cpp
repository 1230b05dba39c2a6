#include "policy/policy_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "policy/json.h"
#include "policy/network_parameters.h"
#include "policy/network_text.h"
#include "policy/policy_texts.h"

namespace cale {
namespace {

constexpr std::string_view kFormat = "cale_policy";
// Version 2 is version 3 without the text `joystick`, which says what the coordinates of an action are; it is
// written for policies that need none. Version 1 is read, too.
constexpr std::string_view kVersion = "3", kVersionOfPolar = "2";
constexpr std::string_view kChecksum = "checksum";
constexpr std::string_view kGoldenObservation = "golden.observation";
constexpr std::string_view kGoldenOutput = "golden.output";

// Checksum ----------------------------------------------------------------------------

/// Of everything in a file but the order of its parts. Not against malice: against damage.
class Checksum {
  public:
    void add(std::string_view bytes) {
        add_word(bytes.size());
        while (!bytes.empty()) {
            std::uint64_t word = 0;
            const auto count = std::min(bytes.size(), sizeof(word));
            std::memcpy(&word, bytes.data(), count);
            add_word(word);
            bytes.remove_prefix(count);
        }
    }
    std::string text() const {
        constexpr std::string_view digits = "0123456789abcdef";
        std::string result;
        for (int shift = 60; shift >= 0; shift -= 4) result += digits[state_ >> shift & 15];
        return result;
    }

  private:
    void add_word(std::uint64_t word) {
        state_ = (state_ ^ word) * 0x9e3779b97f4a7c15u;  // odd: no two states become one
        state_ ^= state_ >> 32;
    }
    std::uint64_t state_ = 0xcbf29ce484222325u;
};

}  // namespace

std::string policy_checksum(const Texts& metadata, const std::map<std::string, StoredTensor>& tensors) {
    Checksum sum;
    for (const auto& [key, text] : metadata) {
        if (key == kChecksum) continue;
        sum.add(key);
        sum.add(text);
    }
    for (const auto& [name, tensor] : tensors) {
        sum.add(name);
        sum.add(kElementTypes.at(static_cast<std::size_t>(tensor.type)).name);
        sum.add(text_of_shape(tensor.shape));
        sum.add(tensor.bytes);
    }
    return sum.text();
}

namespace {

// Reading -----------------------------------------------------------------------------

/// The parameters as they are stored.
std::vector<NamedShape> stored_parameters(const NetworkSpec& network) {
    std::vector<NamedShape> stored;
    for (auto& [name, shape] : parameter_shapes(network)) stored.push_back({name, ElementType::f32, shape});
    return stored;
}

std::vector<float> numbers_of(const StoredTensors& stored, const NamedShape& expected) {
    const auto found = stored.tensors.find(expected.name);
    if (found == stored.tensors.end()) throw FileDamage({"tensor '", expected.name, "' is missing"});
    const auto& tensor = found->second;
    if (tensor.type != expected.type || tensor.shape != expected.shape) {
        const auto text = [](ElementType type, const std::vector<std::int64_t>& shape) {
            return concatenated(
                {kElementTypes.at(static_cast<std::size_t>(type)).name, " ", text_of_shape(shape)});
        };
        throw FileDamage({"tensor '", expected.name, "' is ", text(tensor.type, tensor.shape),
                          ": its network needs ", text(expected.type, expected.shape)});
    }
    std::vector<float> numbers(tensor.bytes.size() / sizeof(float));
    std::memcpy(numbers.data(), tensor.bytes.data(), tensor.bytes.size());
    if (!std::ranges::all_of(numbers, [](float x) { return std::isfinite(x); }))
        throw FileDamage({"tensor '", expected.name, "' holds a number that is not finite"});
    return numbers;
}

GoldenPair golden_pair(const StoredTensors& stored, const PolicyFile& policy) {
    GoldenPair golden;
    const auto& network = policy.network;
    golden.output =
        numbers_of(stored, {std::string(kGoldenOutput), ElementType::f32, {output_size(network.head)}});
    const auto found = stored.tensors.find(std::string(kGoldenObservation));
    if (found == stored.tensors.end() || found->second.type != ElementType::u8 ||
        found->second.shape != network.observation) {
        throw FileDamage("tensor 'golden.observation' is not an observation of its network");
    }
    golden.observation.assign(found->second.bytes.begin(), found->second.bytes.end());
    return golden;
}

void check_names(const StoredTensors& stored, const std::vector<NamedShape>& parameters) {
    for (const auto& [name, tensor] : stored.tensors) {
        const bool known = name == kGoldenObservation || name == kGoldenOutput ||
                           std::ranges::find(parameters, name, &NamedShape::name) != parameters.end();
        if (!known) throw FileDamage({"tensor ", in_quotes(name), " is no part of its network"});
    }
}

}  // namespace

PolicyFile parse_policy_file(std::string_view contents) {
    const auto stored = stored_tensors(contents);
    Texts texts = stored.metadata;
    if (!texts.contains(std::string(kFormat)))
        throw FileDamage("it is a safetensors file, but not a policy that cale export made");
    const auto version = take_text(texts, kFormat);
    if (version != "1" && version != kVersionOfPolar && version != kVersion) {
        throw FileDamage(
            {"its format is version ", in_quotes(version), ", this program reads versions 1 to ", kVersion});
    }
    if (texts.contains("joystick") != (version == kVersion))
        throw FileDamage({"its format is version ", in_quotes(version),
                          version == kVersion ? ", but it has no text 'joystick'"
                                              : ", but it has a text 'joystick', which only version 3 has"});
    if (take_text(texts, kChecksum) != policy_checksum(stored.metadata, stored.tensors))
        throw FileDamage("its checksum is not that of its contents: it was damaged or changed");

    PolicyFile policy;
    auto& [info, network, weights, golden] = policy;
    read_texts(texts, version == "1", info, network);
    info.provenance = std::move(texts);

    const auto parameters = stored_parameters(network);
    check_names(stored, parameters);
    for (const auto& parameter : parameters) weights[parameter.name] = numbers_of(stored, parameter);
    golden = golden_pair(stored, policy);
    return policy;
}

std::map<std::string, std::string> policy_file_texts(const PolicyFile& policy) {
    auto texts = texts_of(policy.info, policy.network);
    texts.emplace(kFormat, texts.contains("joystick") ? kVersion : kVersionOfPolar);
    for (const auto& [key, text] : policy.info.provenance) {
        if (key == kChecksum || key == "joystick" || !texts.emplace(key, text).second)
            throw std::invalid_argument(concatenated({"provenance cannot be called '", key, "'"}));
    }
    return texts;
}

std::string policy_file_contents(const PolicyFile& policy) {
    auto texts = policy_file_texts(policy);
    const auto bytes = [](const auto& numbers) {
        return std::string_view(reinterpret_cast<const char*>(numbers.data()),
                                numbers.size() * sizeof(numbers[0]));
    };
    const auto& network = policy.network;
    std::map<std::string, StoredTensor> tensors;
    for (const auto& parameter : stored_parameters(network))
        tensors[parameter.name] = {parameter.type, parameter.shape, bytes(policy.weights.at(parameter.name))};
    tensors[std::string(kGoldenObservation)] = {ElementType::u8, network.observation,
                                                bytes(policy.golden.observation)};
    tensors[std::string(kGoldenOutput)] = {
        ElementType::f32, {output_size(network.head)}, bytes(policy.golden.output)};
    texts[std::string(kChecksum)] = policy_checksum(texts, tensors);

    // The bytes last: then every number lies at a multiple of its size.
    std::vector<NamedShape> order;
    order.reserve(tensors.size());
    for (const auto& [name, tensor] : tensors) order.push_back({name, tensor.type, tensor.shape});
    std::stable_partition(order.begin(), order.end(),
                          [](const NamedShape& tensor) { return tensor.type == ElementType::f32; });
    auto contents = safetensors_header(order, texts);
    for (const auto& tensor : order) contents += tensors.at(tensor.name).bytes;
    return contents;
}

std::vector<std::uint8_t> golden_observation(const PolicyInfo& info) {
    std::vector<std::uint8_t> pixels(info.observation_size());
    std::uint32_t x = 1;
    for (auto& pixel : pixels) {
        x = 1'664'525 * x + 1'013'904'223;
        pixel = static_cast<std::uint8_t>(x >> 24);
    }
    return pixels;
}

void check_golden(std::span<const float> output, std::span<const float> golden, double tolerance) {
    float largest = 1;
    for (const float number : golden) largest = std::max(largest, std::abs(number));
    for (std::size_t i = 0; i < golden.size(); ++i) {
        // Written so that NaN, which compares false to everything, is refused too.
        if (std::abs(output[i] - golden[i]) <= tolerance * static_cast<double>(largest)) continue;
        throw FileDamage({"its network does not give the golden output for the golden observation: ",
                          number_text(static_cast<double>(output[i])), " where ",
                          number_text(static_cast<double>(golden[i])), " was expected"});
    }
}

}  // namespace cale
