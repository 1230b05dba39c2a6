#include "web/settings.h"

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>

#include "cale/setting.h"
#include "cale/text.h"

namespace cale::web {
namespace {

std::optional<SettingField> find_setting(std::string_view name, EnvConfig& env) {
    for (const auto& setting : setting_fields(env))
        if (setting.name == name) return setting;
    return std::nullopt;
}

std::string no_setting(std::string_view name) {
    return "there is no setting '" + std::string(name) + "'";
}

/// Throws std::invalid_argument where there is none.
SettingField setting_called(std::string_view name, EnvConfig& env) {
    const auto setting = find_setting(name, env);
    if (!setting) throw std::invalid_argument(no_setting(name));
    return *setting;
}

/// A configuration has texts in quotes that a reader of YAML might take for something else: "pong,breakout".
std::string_view unquoted(std::string_view text) {
    const bool quoted = text.size() >= 2 && text.front() == '"' && text.back() == '"';
    return quoted ? text.substr(1, text.size() - 2) : text;
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
        if (name == "rom_dir") continue;
        const auto setting = find_setting(name, env);
        if (!setting)
            throw std::runtime_error("this page is older than the policy: of its environment, " +
                                     no_setting(name));
        try {
            read_setting(name, setting->range, unquoted(line.substr(colon + 2)), setting->member);
        } catch (const std::invalid_argument& error) {
            throw std::runtime_error("the environment that the policy was trained in cannot be used: " +
                                     std::string(error.what()));
        }
    }
    return env;
}

void change(EnvConfig& env, std::string_view lines) {
    for (std::string_view line : split(lines, '\n')) {
        if (line.empty()) continue;
        const auto sign = std::min(line.find('='), line.size());
        const auto name = line.substr(0, sign);
        const auto setting = setting_called(name, env);
        read_setting(name, setting.range, line.substr(std::min(sign + 1, line.size())), setting.member);
    }
}

std::string setting(EnvConfig env, std::string_view name) {
    return written_setting(setting_called(name, env).member);
}

}  // namespace cale::web
