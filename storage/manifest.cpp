#include "storage/manifest.h"

#include <charconv>
#include <stdexcept>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "storage/checksum.h"
#include "storage/files.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr int kFormatVersion = 5;
constexpr const char* kManifestFile = "manifest.json";

[[noreturn]] void damaged() {
    throw std::runtime_error(fmt::format("{} is damaged", kManifestFile));
}

FileRecord parse_record(const nlohmann::json& json) {
    FileRecord record{.bytes = json.at("bytes").get<std::uint64_t>()};
    const auto text = json.at("crc32c").get<std::string>();
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), record.crc32c, 16);
    if (error != std::errc{} || end != text.data() + text.size()) damaged();
    return record;
}

Manifest parse(const std::string& text) {
    try {
        const auto json = nlohmann::json::parse(text);
        if (const auto& version = json.at("format_version"); version != kFormatVersion) {
            throw OtherFormat(fmt::format("its format is version {}, this program reads version {}",
                                          version.dump(), kFormatVersion));
        }
        Manifest manifest;
        for (const auto& [name, record] : json.at("files").items()) {
            if (name != fs::path(name).filename() || name == "." || name == "..") damaged();
            manifest[name] = parse_record(record);
        }
        return manifest;
    } catch (const nlohmann::json::exception&) {
        damaged();
    }
}

}  // namespace

FileRecord record_of(const fs::path& file) {
    const auto bytes = read_file(file);
    return {.bytes = bytes.size(), .crc32c = crc32c(bytes)};
}

void write_manifest(const fs::path& folder, const Manifest& manifest) {
    nlohmann::json files = nlohmann::json::object();
    for (const auto& [name, record] : manifest)
        files[name] = {{"bytes", record.bytes}, {"crc32c", checksum_text(record.crc32c)}};
    const nlohmann::json json{{"format_version", kFormatVersion}, {"files", files}};
    write_file_atomically(folder / kManifestFile, json.dump(2) + "\n");
}

bool holds_manifest(const fs::path& folder) {
    return fs::exists(folder / kManifestFile);
}

Manifest read_manifest(const fs::path& folder) {
    if (!holds_manifest(folder)) {
        throw std::runtime_error(
            fs::exists(folder / "state.json")
                ? fmt::format("it has no {}: it was damaged, or written by an older cale, which can finish "
                              "the run (format 2; this program reads version {})",
                              kManifestFile, kFormatVersion)
                : fmt::format("it has no {}", kManifestFile));
    }
    return parse(read_file(folder / kManifestFile));
}

std::optional<std::string> policy_checksum(const fs::path& folder) {
    const auto manifest = read_manifest(folder);
    const auto policy = manifest.find(kPolicyFile);
    if (policy == manifest.end()) return std::nullopt;
    return checksum_text(policy->second.crc32c);
}

void verify(const fs::path& folder, const Manifest& manifest) {
    for (const auto& [name, expected] : manifest) {
        const auto file = folder / name;
        if (!fs::is_regular_file(file)) throw std::runtime_error(fmt::format("{} is missing", name));
        if (const auto bytes = fs::file_size(file); bytes != expected.bytes) {
            throw std::runtime_error(
                fmt::format("{} has {} bytes where {} were written", name, bytes, expected.bytes));
        }
        if (record_of(file) != expected)
            throw std::runtime_error(fmt::format("{} is damaged: its checksum is another", name));
    }
}

}  // namespace cale
