#include "sweep/settings.h"

#include <optional>

#include <yaml-cpp/yaml.h>

#include "settings/config.h"

namespace cale {
namespace {

/// A setting of no name, to read and print values with as the training programs do.
ConfigEntry entry_of(const SettingMember& member) {
    ConfigEntry entry;
    entry.member = member;
    return entry;
}

/// What a training program prints of a Value that it has read from the text; none where it reads no Value.
template <class Value>
std::optional<std::string> printed_as(const std::string& text) {
    Value value{};
    const auto entry = entry_of(&value);
    try {
        entry.set(text);
    } catch (const ConfigError&) {
        return std::nullopt;
    }
    return entry.get();
}

}  // namespace

SettingTexts settings_in(const std::string& yaml) {
    SettingTexts settings;
    for (const auto& section : YAML::Load(yaml)) {
        for (const auto& item : section.second)
            settings[section.first.Scalar() + "." + item.first.Scalar()] = item.second.Scalar();
    }
    return settings;
}

std::string printed_value(const std::string& text) {
    if (auto truth = printed_as<bool>(text)) return *truth;
    if (auto number = printed_as<std::int64_t>(text)) return *number;
    if (auto number = printed_as<std::optional<double>>(text)) return *number;
    return printed_as<IntegerRange>(text).value_or(text);
}

bool same_value(const std::string& a, const std::string& b) {
    return a == b || printed_value(a) == printed_value(b);
}

std::int64_t integer_in(const std::string& text) {
    std::int64_t value = 0;
    entry_of(&value).set(text);
    return value;
}

}  // namespace cale
