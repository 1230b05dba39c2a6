#include "web/settings.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <type_traits>

#include "cale/text.h"

namespace cale::web {
namespace {

// Each reads a value from text, and returns whether it could.

bool read(std::string_view text, std::string& value) {
    value = text;
    return true;
}

bool read(std::string_view text, bool& value) {
    value = text == "true";
    return value || text == "false";
}

bool read(std::string_view text, IntegerRange& value) {
    const auto range = integer_range_in(text);
    if (range) value = *range;
    return range.has_value();
}

template <class Number>
requires std::is_same_v<Number, double> || std::is_same_v<Number, std::int64_t>
bool read(std::string_view text, Number& value) {
    const auto number = number_in<Number>(text);
    if (number) value = *number;
    return number.has_value();
}

template <class Number>
bool read(std::string_view text, std::optional<Number>& value) {
    value.reset();
    return text == "none" || read(text, value.emplace());
}

template <class Enum>
requires std::is_enum_v<Enum>
bool read(std::string_view text, Enum& value) {
    const auto names = names_of(value);
    const auto found = std::find(names.begin(), names.end(), text);
    if (found != names.end()) value = static_cast<Enum>(found - names.begin());
    return found != names.end();
}

// And the way back.

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

/// Calls use(member) with the setting's. Throws std::invalid_argument where there is none.
template <class Use>
void with_setting(EnvConfig& env, std::string_view name, const Use& use) {
    bool known = false;
    fields(env, [&](std::string_view field, auto& member, const auto&...) {
        if (field != name) return;
        known = true;
        use(member);
    });
    if (!known) throw std::invalid_argument("there is no setting '" + std::string(name) + "'");
}

void set(EnvConfig& env, std::string_view name, std::string_view text) {
    with_setting(env, name, [&](auto& member) {
        if (read(text, member)) return;
        throw std::invalid_argument("the setting '" + std::string(name) + "' cannot be '" +
                                    std::string(text) + "'");
    });
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
    with_setting(env, name, [&](const auto& member) { text = text_of(member); });
    return text;
}

}  // namespace cale::web
