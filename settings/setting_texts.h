// The settings of a run as text, by key.
#pragma once

#include <functional>
#include <map>
#include <string>

namespace cale {

/// "agent.loss" -> "huber".
using SettingTexts = std::map<std::string, std::string, std::less<>>;

/// Returns the settings in YAML as the training programs print it, and leave it in a run's config.yaml.
/// Throws YAML::Exception where it is no YAML, or a section is neither empty nor a map, as `extends` is.
SettingTexts settings_in(const std::string& yaml);

}  // namespace cale
