// The settings of a program as one table, made from the `fields` of its configuration
// structs (cale/fields.h). The table reads YAML files and KEY=VALUE overrides into the
// structs, checks types, ranges and spelling, and prints them again.
//
//     EnvConfig env;
//     SacConfig agent;
//     ConfigTable table;
//     table.add("env", env);
//     table.add("agent", agent);
//     table.load("configs/sac/200m.yaml");
//     table.set_override("env.game=breakout");
#pragma once

#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "cale/fields.h"
#include "cale/setting.h"
#include "cale/text.h"

namespace cale {

/// An error in the user's input: one sentence with place, problem and remedy.
/// Control characters that it quotes are shown as \x0a, so that it stays one line.
/// Programs leave with exit code 2.
class ConfigError : public std::runtime_error {
  public:
    /// `sentence` is what what() returns.
    explicit ConfigError(std::string_view sentence);
};

/// One setting.
struct ConfigEntry {
    std::string key;           // "env.threshold"
    std::string type;          // setting_type(): "integer", "number or none", "one of a, b", ...
    std::string default_text;  // the value when it was added to the table
    std::string range_text;    // "0 to 1", "at least 1"; empty where anything goes
    std::string help;          // its sentence
    Range range;               // of numbers
    SettingMember member;      // where it is stored
    std::function<void(const std::string&)> check{};  // of texts: throws std::invalid_argument, a sentence
    bool takes_list = false;                          // of texts: a YAML list is one text with commas

    /// read_setting() of the member. Throws ConfigError where that throws; the member is then unchanged.
    void set(std::string_view text) const;
    /// The member's value as text that `set` would read to the same value.
    std::string get() const;
};

/// A key whose value in a file differs from the table's.
struct ConfigDifference {
    std::string key;    // "env.threshold"
    std::string here;   // in the table
    std::string there;  // in the file
};

/// The settings of a program, by section. It refers to the structs it was made from: they
/// must outlive it and stay where they are.
class ConfigTable {
  public:
    /// `listed_by` says where a reader finds all keys: it ends the sentence about a key that resembles none.
    explicit ConfigTable(std::string listed_by = "--help lists every key")
        : listed_by_(std::move(listed_by)) {}

    /// Adds the fields of `config` as `section.name`. Throws std::logic_error where a key exists already.
    template <class Config>
    void add(std::string_view section, Config& config) {
        for (auto& field : setting_fields(config)) add_entry(section, std::move(field));
    }

    /// Makes `check` validate a text setting. If it throws std::invalid_argument, its sentence is reported
    /// with the file and line, or the option, of the text.
    void check(std::string_view key, std::function<void(const std::string&)> check);

    /// Lets a text setting take a YAML list of texts too, which is stored with commas between them.
    void take_list(std::string_view key);

    /// Makes validate() call `rule`, which throws std::invalid_argument, naming the keys, for settings that
    /// are valid individually but not together.
    void add_rule(std::function<void()> rule) { rules_.push_back(std::move(rule)); }
    /// Throws ConfigError with the sentence of the first rule that the settings violate. Must be called after
    /// all are read.
    void validate() const;
    /// Resets all settings to their values when they were added.
    void reset();

    /// The settings in order, each section's together.
    const std::vector<ConfigEntry>& entries() const { return entries_; }
    /// Whether there is such a key.
    bool has(std::string_view key) const { return find(key) != nullptr; }
    /// Throws ConfigError with the nearest key where there is no such key.
    const ConfigEntry& at(std::string_view key) const;
    /// The sentence about a key that the table does not have: it names the nearest one.
    std::string unknown_key(std::string_view key) const;

    /// Reads a YAML file: sections that map keys to values, and perhaps `extends: other.yaml`
    /// (relative to this file), which is read first. Settings that it does not name keep
    /// their values. Throws ConfigError, "file:line:column: what is wrong".
    void load(const std::filesystem::path& file);

    /// Sets one key from "env.threshold=0.5". Throws ConfigError that names the override.
    void set_override(std::string_view key_equals_value);

    /// All settings and their sentences as YAML that load() reads to the same values.
    std::string to_yaml() const;

    /// Returns what load(file) would change, in the table's order; leaves the table unchanged. Throws as
    /// load() does.
    std::vector<ConfigDifference> differences(const std::filesystem::path& file);

  private:
    /// Throws std::logic_error where there is no such key.
    ConfigEntry& own_entry(std::string_view key);

    void add_entry(std::string_view section, SettingField field);
    const ConfigEntry* find(std::string_view key) const;

    std::string listed_by_;
    std::vector<ConfigEntry> entries_;
    std::vector<std::function<void()>> rules_;
};

}  // namespace cale
