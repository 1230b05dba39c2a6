// Reads the YAML that users write.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include <yaml-cpp/yaml.h>

namespace cale {

/// Returns the text of a file. Throws ConfigError where it cannot be read, with the name that was probably
/// meant or with what there is in the folder.
std::string read_yaml(const std::filesystem::path& file);

/// Returns "file:line:column", or the file alone for a mark without a place.
std::string place(const std::filesystem::path& file, const YAML::Mark& mark);

/// Throws ConfigError: "file:line:column: what".
[[noreturn]] void fail_at(const std::filesystem::path& file, const YAML::Mark& mark, std::string_view what);

/// Returns the one document of a text. Throws YAML::Exception with the place and a sentence in `msg`, where
/// the text is no YAML or has a second document.
YAML::Node parse_yaml(const std::string& text);
/// The same of a file's text. Throws ConfigError with its place.
YAML::Node parse_yaml(const std::filesystem::path& file, const std::string& text);

}  // namespace cale
