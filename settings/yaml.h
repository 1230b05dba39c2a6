// Reads the YAML that users write.
#pragma once

#include <string>

#include <yaml-cpp/yaml.h>

namespace cale {

/// Returns the one document of a text. Throws YAML::Exception with the place and a sentence in `msg`, where
/// the text is no YAML or has a second document.
YAML::Node parse_yaml(const std::string& text);

}  // namespace cale
