#include "web/settings.h"

#include <algorithm>
#include <stdexcept>
#include <type_traits>

#include "cale/setting.h"
#include "cale/text.h"

namespace cale::web {
namespace {

// Of each type of setting, its value as read_setting() reads it.

std::string text_of(const std::string& value) {
    return value;
}
std::string text_of(bool value) {
    return value ? "true" : "false";
}
template <class Enum>
requires std::is_enum_v<Enum> std::string text_of(Enum value) {
    return std::string(names_of(value)[static_cast<std::size_t>(value)]);
}
template <class Value>
requires(!std::is_enum_v<Value>) std::string text_of(const Value& value) {
    return setting_text(value);
}

/// Calls use(member, range) with the setting's. Throws std::invalid_argument where there is none.
template <class Use>
void with_setting(EnvConfig& env, std::string_view name, const Use& use) {
    bool known = false;
    fields(env, [&](std::string_view field, auto& member, const auto& range_or_help, const auto&...) {
        if (field != name) return;
        known = true;
        if constexpr (std::is_same_v<std::remove_cvref_t<decltype(range_or_help)>, Range>) {
            use(member, range_or_help);
        } else {
            use(member, Range());
        }
    });
    if (!known) throw std::invalid_argument("there is no setting '" + std::string(name) + "'");
}

void set(EnvConfig& env, std::string_view name, std::string_view text) {
    with_setting(env, name,
                 [&](auto& member, Range range) { read_setting(name, range, text, setting_member(member)); });
}

}  // namespace

EnvConfig trained_env(const PolicyInfo& info) {
    const auto config = info.provenance.find("config");
    if (config == info.provenance.end())
        throw std::runtime_error("this policy does not say in which environment it was trained");
    EnvConfig env;
    bool inside = false;
    for (std::string_view line : split(config->second, '\n')) {
        const auto colon = line.find(": ");
        if (!line.starts_with("  ")) inside = line == "env:";
        if (!inside || !line.starts_with("  ") || colon == line.npos) continue;
        const auto name = line.substr(2, colon - 2);
        try {
            if (name != "rom_dir") set(env, name, line.substr(colon + 2));
        } catch (const std::invalid_argument& error) {
            throw std::runtime_error("this page is older than the policy: of its environment, " +
                                     std::string(error.what()));
        }
    }
    return env;
}

void change(EnvConfig& env, std::string_view lines) {
    for (std::string_view line : split(lines, '\n')) {
        if (line.empty()) continue;
        const auto sign = std::min(line.find('='), line.size());
        set(env, line.substr(0, sign), line.substr(std::min(sign + 1, line.size())));
    }
}

std::string setting(EnvConfig env, std::string_view name) {
    std::string text;
    with_setting(env, name, [&](const auto& member, Range) { text = text_of(member); });
    return text;
}

}  // namespace cale::web
