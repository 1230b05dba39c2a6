// What a checkpoint's folder must hold: each file's size and checksum, in manifest.json
//
//     {"format_version": 5,
//      "files": {"agent.safetensors.zst": {"bytes": 27040936, "crc32c": "5ef2a0c1"}, ...}}
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>

namespace cale {

/// The size and the checksum of a file.
struct FileRecord {
    std::uint64_t bytes = 0;
    std::uint32_t crc32c = 0;
    bool operator==(const FileRecord&) const = default;
};
/// The folder is of another version of cale, and may be whole.
struct OtherFormat : std::runtime_error {
    using std::runtime_error::runtime_error;
};
using Manifest = std::map<std::string, FileRecord>;  // by the files' names

/// Returns the record of a file as it is now. Throws std::system_error, naming it.
FileRecord record_of(const std::filesystem::path& file);

/// Writes the manifest atomically. Must be called last, when the files' contents are synced: their names are
/// then on disk, too.
void write_manifest(const std::filesystem::path& folder, const Manifest& manifest);

/// Returns whether the folder is a checkpoint's, by its manifest.
bool holds_manifest(const std::filesystem::path& folder);

/// Throws OtherFormat, naming both versions, and std::runtime_error, saying what is wrong, for a folder
/// without one or with a damaged one.
Manifest read_manifest(const std::filesystem::path& folder);

/// The policy file (docs/policy_file.md), in checkpoints of agents and worlds that have one.
inline constexpr const char* kPolicyFile = "policy.safetensors";

/// Returns the checksum_text() of the policy of the checkpoint in `folder`, by its manifest; none where it
/// holds no policy. Throws as read_manifest() does.
std::optional<std::string> policy_checksum(const std::filesystem::path& folder);

/// Reads every file. Throws std::runtime_error that names the first one that is missing or has changed.
void verify(const std::filesystem::path& folder, const Manifest& manifest);

}  // namespace cale
