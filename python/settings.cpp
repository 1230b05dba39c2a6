#include "python/settings.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <stdexcept>
#include <variant>

#include "cale/text.h"

namespace cale::python {
namespace {

/// A value as text, exactly.
struct Writer {
    std::string operator()(const double* value) const {
        std::array<char, 32> text;
        return {text.data(), std::to_chars(text.data(), text.data() + text.size(), *value).ptr};
    }
    std::string operator()(const std::int64_t* value) const { return std::to_string(*value); }
    template <class Number>
    std::string operator()(const std::optional<Number>* value) const {
        return *value ? (*this)(&**value) : "none";
    }
    std::string operator()(const IntegerRange* value) const { return setting_text(*value); }
    std::string operator()(const bool* value) const { return *value ? "true" : "false"; }
    std::string operator()(const std::string* value) const { return *value; }
    std::string operator()(const EnumMember& value) const { return std::string(value.names[value.get()]); }
};

struct Collector {
    std::vector<EnvSetting>& settings;

    template <class T>
    void operator()(std::string_view name, T& member, std::string_view help) const {
        (*this)(name, member, Range{}, help);
    }
    template <class T>
    void operator()(std::string_view name, T& member, Range range, std::string_view help) const {
        settings.push_back({std::string(name), std::string(help), range, setting_member(member)});
    }
};

}  // namespace

std::vector<EnvSetting> env_settings(EnvConfig& config) {
    std::vector<EnvSetting> settings;
    fields(config, Collector{settings});
    return settings;
}

void set(EnvConfig& config, std::string_view name, std::string_view text) {
    const auto settings = env_settings(config);
    const auto found = std::ranges::find(settings, name, &EnvSetting::name);
    if (found == settings.end()) {
        std::vector<std::string> names;
        for (const auto& setting : settings) names.push_back(setting.name);
        const auto guess = did_you_mean(name, names);
        throw std::out_of_range("there is no setting '" + std::string(name) + "'" +
                                (guess.empty() ? "; cale.settings() lists all of them" : guess));
    }
    read_setting(name, found->range, text, found->member);
}

std::string course_of_games(const EnvConfig& config) {
    EnvConfig copy = config;
    copy.game = only_game(config).rom;
    std::string text;
    for (const auto& [name, help, range, member] : env_settings(copy)) {
        if (name == "rom_dir" || name == "num_envs" || name == "env_threads") continue;
        text += name + '=' + std::visit(Writer{}, member) + '\n';
    }
    return text;
}

}  // namespace cale::python
