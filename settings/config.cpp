#include "settings/config.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include "cale/text.h"
#include "settings/peer_names.h"
#include "settings/yaml.h"

namespace cale {

ConfigError::ConfigError(std::string_view sentence) : std::runtime_error(printable(sentence)) {}

namespace {

std::string_view section_of(std::string_view key) {
    return key.substr(0, key.find('.'));
}
std::string_view name_of(std::string_view key) {
    return key.substr(key.find('.') + 1);
}

// ---- values -------------------------------------------------------------------------

/// A text as YAML that every reader takes for a text.
std::string quoted(const std::string& text) {
    const auto is_plain = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
               c == '-' || c == '.' || c == '/';
    };
    const auto is_start = [&](char c) {
        return is_plain(c) && c != '-' && c != '.' && !(c >= '0' && c <= '9');
    };
    const bool is_word = text.size() == 1 || means_none(text) || truth_in(text).has_value();
    if (!text.empty() && is_start(text[0]) && !is_word && std::ranges::all_of(text, is_plain)) return text;
    YAML::Emitter emitter;
    emitter << YAML::DoubleQuoted << text;
    return emitter.c_str();
}

// ---- keys ---------------------------------------------------------------------------

/// The only key of the section whose name has this one's in it, as total_steps has steps; empty: there is
/// none.
std::string longer_key(std::string_view key, const std::vector<std::string>& keys) {
    constexpr std::size_t kFewestLetters = 4;
    const auto name = name_of(key);
    const auto is_longer = [&](const std::string& other) {
        return section_of(other) == section_of(key) && name_of(other).find(name) != std::string::npos;
    };
    const auto found = std::ranges::find_if(keys, is_longer);
    const bool only = name.size() >= kFewestLetters && std::ranges::count_if(keys, is_longer) == 1;
    return only ? *found : "";
}

/// The key that was meant; empty if none resembles it.
std::string meant_key(std::string_view key, const std::vector<ConfigEntry>& entries) {
    if (auto ours = key_of_peer(name_of(key), entries); !ours.empty()) return ours;
    std::vector<std::string> keys(entries.size());
    std::ranges::transform(entries, keys.begin(), &ConfigEntry::key);
    if (auto longer = longer_key(key, keys); !longer.empty()) return longer;
    if (auto near = nearest(key, keys); !near.empty()) return near;
    // The right name in the wrong section, or without one.
    std::vector<std::string> names(keys.size());
    std::ranges::transform(keys, names.begin(), name_of);
    const auto found = std::ranges::find(names, nearest(name_of(key), names));
    return found == names.end() ? "" : keys[static_cast<std::size_t>(found - names.begin())];
}

// ---- files --------------------------------------------------------------------------

/// Not what is piped or redirected.
bool lies_in_a_folder(const std::filesystem::path& file) {
    std::error_code ignored;
    const auto text = file.string();
    return std::filesystem::is_regular_file(file, ignored) && !text.starts_with("/dev/") &&
           !text.starts_with("/proc/");
}

class YamlReader {
  public:
    explicit YamlReader(const ConfigTable& table) : table_(table) {}

    /// `asked_by`: "file:line:column: " of the `extends` that leads here, or nothing.
    void read(const std::filesystem::path& file, const std::string& asked_by = "") {
        std::string text;
        try {
            text = read_yaml(file);
        } catch (const ConfigError& error) {
            throw ConfigError(asked_by + error.what());
        }
        std::error_code ignored;  // a pipe has no canonical name, and cannot be extended
        const auto canonical = std::filesystem::weakly_canonical(file, ignored);
        if (std::ranges::find(chain_, canonical) != chain_.end()) {
            throw ConfigError(
                fmt::format("{}'{}' extends itself; a base must not lead back to a file that extends it",
                            asked_by, file.string()));
        }
        chain_.push_back(canonical);
        read_root(file, text);
        chain_.pop_back();
    }

  private:
    void read_root(const std::filesystem::path& file, const std::string& text) {
        const auto root = parse_yaml(file, text);
        if (root.IsNull()) return;
        if (!root.IsMap()) fail(file, root, "expected sections such as 'env:' with settings below");
        const auto sections = section_names();
        for (const auto& item : root) {
            const auto& key = scalar(file, item.first);
            const bool is_of_a_sweep = key == "grid" || key == "variants" || key == "search";
            if (is_of_a_sweep && std::ranges::find(sections, key) == sections.end())
                fail(file, item.first,
                     fmt::format("'{}' is of a sweep file: cale sweep {}", key, file.string()));
        }
        // The base comes first wherever it is named, so that this file has the last word.
        for (const auto& item : root) {
            if (scalar(file, item.first) != "extends") continue;
            read_base(file, item.first, item.second);
            break;
        }
        Seen seen;
        for (const auto& item : root) {
            check_duplicate(seen, file, item.first, scalar(file, item.first));
            if (item.first.Scalar() != "extends") read_section(file, item.first, item.second);
        }
    }

    using Seen = std::map<std::string, int>;  // key -> line

    [[noreturn]] static void fail(const std::filesystem::path& file, const YAML::Node& node,
                                  const std::string& what) {
        fail_at(file, node.Mark(), what);
    }
    static const std::string& scalar(const std::filesystem::path& file, const YAML::Node& key) {
        if (!key.IsScalar()) fail(file, key, "a key must be a word");
        return key.Scalar();
    }

    static void check_duplicate(Seen& seen, const std::filesystem::path& file, const YAML::Node& node,
                                const std::string& key) {
        const auto [found, is_new] = seen.emplace(key, node.Mark().line + 1);
        if (!is_new)
            fail(file, node,
                 fmt::format("'{}' is set a second time; line {} has the first", key, found->second));
    }

    void read_base(const std::filesystem::path& file, const YAML::Node& key, const YAML::Node& base) {
        constexpr auto kWanted = "'extends' must name another file, or a list of files";
        const auto read_one = [&](const YAML::Node& name) {
            if (!name.IsScalar()) fail(file, name.IsNull() ? key : name, kWanted);
            if (std::filesystem::path(name.Scalar()).is_relative() && !lies_in_a_folder(file))
                fail(file, name, "'extends' must be an absolute path here, as this is no file in a folder");
            read(file.parent_path() / name.Scalar(), place(file, name.Mark()) + ": ");
        };
        if (!base.IsSequence()) return read_one(base);
        for (const auto& name : base) read_one(name);
    }

    std::vector<std::string> section_names() const {
        std::vector<std::string> names;
        for (const auto& entry : table_.entries()) {
            const auto name = section_of(entry.key);
            if (names.empty() || names.back() != name) names.emplace_back(name);
        }
        return names;
    }

    void read_section(const std::filesystem::path& file, const YAML::Node& section,
                      const YAML::Node& settings) {
        const auto& name = section.Scalar();
        const auto sections = section_names();
        if (std::ranges::find(sections, name) == sections.end()) {
            if (table_.has(name)) {
                fail(file, section,
                     fmt::format("'{}' must be written as '{}' below '{}:'", name, name_of(name),
                                 section_of(name)));
            }
            if (!settings.IsMap()) fail(file, section, table_.unknown_key(name));
            const auto guess = did_you_mean(name, sections);
            const auto* const all = sections.size() == 1 ? "the only one here is" : "there are";
            const auto hint = guess.empty() ? fmt::format("; {} {}", all, fmt::join(sections, ", ")) : guess;
            fail(file, section, fmt::format("unknown section '{}'{}", name, hint));
        }
        if (settings.IsNull()) return;
        if (!settings.IsMap())
            fail(file, settings,
                 fmt::format("'{}' is a section: its settings go below it, one per line", name));
        Seen seen;
        for (const auto& item : settings) {
            const auto key = name + "." + scalar(file, item.first);
            check_duplicate(seen, file, item.first, key);
            read_value(file, key, item.first, item.second);
        }
    }

    void read_value(const std::filesystem::path& file, const std::string& key, const YAML::Node& key_node,
                    const YAML::Node& value) {
        if (!table_.has(key)) fail(file, key_node, table_.unknown_key(key));
        const auto& entry = table_.at(key);
        if (entry.takes_list && value.IsSequence()) return read_list(file, entry, value);
        if (!value.IsScalar() && !value.IsNull()) {
            fail(file, value,
                 fmt::format(
                     "{} must be a single value ({}){}", key, entry.type,
                     value.IsSequence() ? "; `cale sweep` trains a run for each value of a list" : ""));
        }
        const bool is_text = std::holds_alternative<std::string*>(entry.member);
        const bool may_be_absent = is_text || std::holds_alternative<std::optional<double>*>(entry.member) ||
                                   std::holds_alternative<std::optional<std::int64_t>*>(entry.member);
        if (value.IsNull() && !may_be_absent)
            fail(file, key_node, fmt::format("{} has no value ({})", key, entry.type));
        try {
            entry.set(value.IsScalar() ? value.Scalar() : is_text ? "" : "none");
        } catch (const ConfigError& error) {
            fail(file, value, error.what());
        }
    }

    void read_list(const std::filesystem::path& file, const ConfigEntry& entry, const YAML::Node& list) {
        std::string text;
        for (const auto& item : list) {
            if (!item.IsScalar()) fail(file, item, fmt::format("{} takes a list of texts", entry.key));
            text += (text.empty() ? "" : ",") + item.Scalar();
        }
        try {
            entry.set(text);
        } catch (const ConfigError& error) {
            fail(file, list, error.what());
        }
    }

    const ConfigTable& table_;
    std::vector<std::filesystem::path> chain_;
};

/// Reads the text into the entry's member.
void read_into(const ConfigEntry& entry, std::string_view text) {
    if (text.find('\0') != text.npos)
        throw ConfigError(fmt::format("{}: its text has a character 0", entry.key));
    if (entry.check) {
        try {
            entry.check(std::string(text));
        } catch (const std::invalid_argument& error) {
            throw ConfigError(fmt::format("{}: {}", entry.key, error.what()));
        }
    }
    // Another one would not come back from the run's config.yaml.
    if (std::holds_alternative<std::string*>(entry.member) &&
        YAML::Load(quoted(std::string(text))).as<std::string>() != text) {
        throw ConfigError(fmt::format("{} must be text that a YAML file can hold, which is UTF-8, not '{}'",
                                      entry.key, text));
    }
    try {
        read_setting(entry.key, entry.range, text, entry.member);
    } catch (const std::invalid_argument& error) {
        throw ConfigError(error.what());
    }
}

/// The two ends of "1..3"; none of other text.
std::vector<std::string> ends_of_range(std::string_view text) {
    const auto dots = text.find("..");
    if (dots == text.npos) return {};
    return {std::string(text.substr(0, dots)), std::string(text.substr(dots + 2))};
}

/// "0.1..0.5"
bool is_range_of_fractions(std::string_view text) {
    const auto ends = ends_of_range(text);
    if (ends.empty()) return false;
    const auto first = number_in<double>(ends[0]), last = number_in<double>(ends[1]);
    return first && last && (*first != std::floor(*first) || *last != std::floor(*last));
}

/// Whether the text is a list as a sweep has it, "1..3" or "pong,breakout", of values that the entry takes.
bool is_list_of_values(const ConfigEntry& entry, std::string_view text) {
    auto values = split(text, ',');
    if (values.size() == 1) values = ends_of_range(text);
    if (values.size() < 2) return false;
    const auto before = entry.get();
    const bool all_fit = std::ranges::all_of(values, [&](const std::string& value) {
        try {
            read_into(entry, value);
            return true;
        } catch (const ConfigError&) {
            return false;
        }
    });
    read_into(entry, before);
    return all_fit;
}

}  // namespace

void ConfigEntry::set(std::string_view text) const {
    try {
        read_into(*this, text);
    } catch (const ConfigError&) {
        if (takes_list) throw;
        if (is_range_of_fractions(text)) {
            throw ConfigError(fmt::format(
                "{} takes one value, not '{}'; a sweep counts whole numbers only (1..3), so list them there",
                key, text));
        }
        if (!is_list_of_values(*this, text)) throw;
        throw ConfigError(fmt::format(
            "{} takes one value, not '{}'; `cale sweep` trains a run for each value of a list", key, text));
    }
}

std::string ConfigEntry::get() const {
    return written_setting(member);
}

void ConfigTable::add_entry(std::string_view section, SettingField field) {
    ConfigEntry entry{.key = fmt::format("{}.{}", section, field.name),
                      .type = setting_type(field.member),
                      .default_text = written_setting(field.member),
                      .range_text = cale::range_text(field.range),
                      .help = std::move(field.help),
                      .range = field.range,
                      .member = std::move(field.member)};
    if (has(entry.key)) throw std::logic_error(fmt::format("two fields are called '{}'", entry.key));
    const auto same_section = [&](const ConfigEntry& other) { return section_of(other.key) == section; };
    const auto last = std::find_if(entries_.rbegin(), entries_.rend(), same_section);
    entries_.insert(last == entries_.rend() ? entries_.end() : last.base(), std::move(entry));
}

ConfigEntry& ConfigTable::own_entry(std::string_view key) {
    const auto found = std::ranges::find(entries_, key, &ConfigEntry::key);
    if (found == entries_.end()) throw std::logic_error(fmt::format("there is no field '{}'", key));
    return *found;
}

void ConfigTable::check(std::string_view key, std::function<void(const std::string&)> check) {
    own_entry(key).check = std::move(check);
}

void ConfigTable::take_list(std::string_view key) {
    own_entry(key).takes_list = true;
}

void ConfigTable::validate() const {
    for (const auto& rule : rules_) {
        try {
            rule();
        } catch (const std::invalid_argument& error) {
            throw ConfigError(error.what());
        }
    }
}

void ConfigTable::reset() {
    for (const auto& entry : entries_) entry.set(entry.default_text);
}

const ConfigEntry* ConfigTable::find(std::string_view key) const {
    const auto found = std::ranges::find(entries_, key, &ConfigEntry::key);
    return found == entries_.end() ? nullptr : &*found;
}

const ConfigEntry& ConfigTable::at(std::string_view key) const {
    if (const auto* entry = find(key)) return *entry;
    throw ConfigError(unknown_key(key));
}

std::string ConfigTable::unknown_key(std::string_view key) const {
    const auto meant = meant_key(key, entries_);
    return fmt::format("unknown key '{}'; {}", key,
                       meant.empty() ? listed_by_ : fmt::format("did you mean '{}'?", meant));
}

void ConfigTable::load(const std::filesystem::path& file) {
    YamlReader(*this).read(file);
}

void ConfigTable::set_override(std::string_view key_equals_value) {
    const auto equals = key_equals_value.find('=');
    try {
        if (equals == std::string_view::npos || equals == 0)
            throw ConfigError("expected KEY=VALUE, such as env.game=breakout");
        at(key_equals_value.substr(0, equals)).set(key_equals_value.substr(equals + 1));
    } catch (const ConfigError& error) {
        throw ConfigError(fmt::format("--set {}: {}", key_equals_value, error.what()));
    }
}

std::string ConfigTable::to_yaml() const {
    std::string yaml;
    std::string_view section;
    for (const auto& entry : entries_) {
        if (section_of(entry.key) != section) {
            yaml += fmt::format("{}{}:\n", section.empty() ? "" : "\n", section_of(entry.key));
            section = section_of(entry.key);
        }
        const bool is_text = std::holds_alternative<std::string*>(entry.member);
        const auto value = entry.get();
        yaml += fmt::format("  # {}\n  {}: {}\n", entry.help, name_of(entry.key),
                            is_text ? quoted(value) : value);
    }
    return yaml;
}

std::vector<ConfigDifference> ConfigTable::differences(const std::filesystem::path& file) {
    std::vector<std::string> here;
    for (const auto& entry : entries_) here.push_back(entry.get());
    const auto restore = [&] {
        for (std::size_t i = 0; i < entries_.size(); ++i) entries_[i].set(here[i]);
    };
    try {
        // A file that an older version wrote lacks the settings that are newer: it ran with their defaults.
        reset();
        load(file);
    } catch (...) {
        restore();
        throw;
    }
    std::vector<ConfigDifference> result;
    for (std::size_t i = 0; i < entries_.size(); ++i) {
        const auto there = entries_[i].get();
        if (there != here[i]) result.push_back({entries_[i].key, here[i], there});
    }
    restore();
    return result;
}

}  // namespace cale
