#include "web/settings.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "cale/setting.h"
#include "cale/text.h"

namespace cale::web {
namespace {

/// Throws std::invalid_argument where there is none.
SettingField setting_called(std::string_view name, EnvConfig& env) {
    const auto settings = setting_fields(env);
    const auto found = std::find_if(settings.begin(), settings.end(),
                                    [name](const SettingField& setting) { return setting.name == name; });
    if (found == settings.end())
        throw std::invalid_argument("there is no setting '" + std::string(name) + "'");
    return *found;
}

void set(EnvConfig& env, std::string_view name, std::string_view text) {
    const auto setting = setting_called(name, env);
    read_setting(name, setting.range, text, setting.member);
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
        try {
            static_cast<void>(setting_called(name, env));
        } catch (const std::invalid_argument& error) {
            throw std::runtime_error("this page is older than the policy: of its environment, " +
                                     std::string(error.what()));
        }
        try {
            set(env, name, unquoted(line.substr(colon + 2)));
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
        set(env, line.substr(0, sign), line.substr(std::min(sign + 1, line.size())));
    }
}

std::string setting(EnvConfig env, std::string_view name) {
    return written_setting(setting_called(name, env).member);
}

}  // namespace cale::web
