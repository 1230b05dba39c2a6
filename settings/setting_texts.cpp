#include "settings/setting_texts.h"

#include "settings/yaml.h"

namespace cale {

SettingTexts settings_in(const std::string& yaml) {
    SettingTexts settings;
    for (const auto& section : parse_yaml(yaml)) {
        if (section.second.IsNull()) continue;  // its settings were cut off
        if (!section.second.IsMap())
            throw YAML::Exception(section.second.Mark(),
                                  "'" + section.first.Scalar() + "' must map keys to values");
        for (const auto& item : section.second)
            settings[section.first.Scalar() + "." + item.first.Scalar()] = item.second.Scalar();
    }
    return settings;
}

}  // namespace cale
