// One setting: a member of a configuration struct as its `fields` describe it (cale/fields.h), and how it is
// read from text. Every door to the settings, YAML, the command line and Python, reads by this, so that all
// of them have the same checks and sentences.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "cale/fields.h"
#include "cale/integer_range.h"

namespace cale {

/// A type-erased enumeration member: its value is an index into `names`.
struct EnumMember {
    std::span<const std::string_view> names;  // of the values, in order
    std::function<std::size_t()> get;         // its value
    std::function<void(std::size_t)> set;     // changes it
};

/// The struct member that a setting reads and writes.
using SettingMember =
    std::variant<std::int64_t*, double*, std::optional<double>*, std::optional<std::int64_t>*, IntegerRange*,
                 bool*, std::string*, EnumMember>;

/// Returns a field's member, type-erased. It refers to `member`, which must outlive it.
template <class T>
SettingMember setting_member(T& member) {
    if constexpr (std::is_enum_v<T>) {
        return EnumMember{names_of(member), [&member] { return static_cast<std::size_t>(member); },
                          [&member](std::size_t index) { member = static_cast<T>(index); }};
    } else {
        return &member;
    }
}

/// One field of a configuration.
struct SettingField {
    std::string name;      // "threshold"
    std::string help;      // its sentence
    Range range;           // of numbers
    SettingMember member;  // refers to the configuration
};

/// Returns the fields of a configuration in their order. They refer to `config`, which must outlive them.
template <class Config>
std::vector<SettingField> setting_fields(Config& config) {
    std::vector<SettingField> settings;
    fields(config, [&settings](std::string_view name, auto& member, const auto&... range_and_help) {
        SettingField setting{
            .name = std::string(name), .help = {}, .range = {}, .member = setting_member(member)};
        const auto take = [&setting](const auto& value) {
            if constexpr (std::is_same_v<std::remove_cvref_t<decltype(value)>, Range>) {
                setting.range = value;
            } else {
                setting.help = value;
            }
        };
        (take(range_and_help), ...);
        settings.push_back(std::move(setting));
    });
    return settings;
}

/// Returns "integer", "number", "number or none", "true/false", "text", "one of a, b".
std::string setting_type(const SettingMember& member);

/// Returns "0 to 1", "at least 1"; empty where anything goes.
std::string range_text(Range range);

/// Reads `text` into the member. Integers may be written 1000000, 1_000_000 or 1e6; true/false also yes/no
/// and on/off; an absent number is none or null. Throws std::invalid_argument that names key, value and what
/// is allowed; the member is then unchanged.
void read_setting(std::string_view key, Range range, std::string_view text, const SettingMember& member);

/// Returns the member's value as text that read_setting() reads to the same value.
std::string written_setting(const SettingMember& member);

/// Returns the truth value that the text stands for: true, yes, on, ...; none if it stands for none.
std::optional<bool> truth_in(std::string_view text);
/// Returns whether the text says that there is no value: none, null or ~.
bool means_none(std::string_view text);

}  // namespace cale
