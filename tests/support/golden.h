// The golden values of the reference and the hash that regenerates their inputs
// (tests/golden/README-agents.md, section "Hash").
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include <yaml-cpp/yaml.h>

namespace golden {

/// The folder named by CALE_GOLDEN_DIR, else the copy in the source tree.
std::string directory();

/// A file of that folder, else of the copy. Throws std::runtime_error that names the missing file.
std::string path_of(const std::string& file_name);
/// The same, read.
YAML::Node load(const std::string& file_name);

/// Every file of that folder whose top-level `kind` is this one, sorted by name; where it has none, those of
/// the copy. Throws std::runtime_error where that has none, too.
std::vector<std::string> files_of_kind(std::string_view kind);
/// The same of files that have these keys at the top.
std::vector<std::string> files_with(std::initializer_list<std::string_view> keys);

/// FNV-1a 64 of "case/name".
std::uint64_t seed(std::string_view case_name, std::string_view name);

/// Element `index` of the stream of `seed`: splitmix64 by index.
std::uint64_t bits(std::uint64_t seed, std::uint64_t index);

/// The same as a double in [0, 1).
double uniform(std::uint64_t seed, std::uint64_t index);

}  // namespace golden
