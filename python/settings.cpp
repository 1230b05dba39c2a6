#include "python/settings.h"

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "cale/setting.h"
#include "cale/text.h"

namespace cale::python {

void set(EnvConfig& config, std::string_view name, std::string_view text) {
    const auto settings = setting_fields(config);
    const auto found = std::ranges::find(settings, name, &SettingField::name);
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
    for (const auto& [name, help, range, member] : setting_fields(copy)) {
        if (name == "rom_dir" || name == "num_envs" || name == "env_threads") continue;
        text += name + '=' + written_setting(member) + '\n';
    }
    return text;
}

}  // namespace cale::python
