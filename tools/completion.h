// Completion scripts for shells, made from the same tables as --help.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "agents/agent.h"
#include "settings/config.h"
#include "settings/run_config.h"

namespace cale {

/// An option. `value` is what it takes, as --help shows it: nothing for a flag; FILE, FILE.yaml, DIR, GAME,
/// KEY=VALUE, DEVICE are completed as what they say, "NAME:{a,b}" by a and b, anything else is left to the
/// user.
struct OptionWords {
    std::string name;  // "--seed"
    std::string value;
    std::string help;
};

/// A setting that is given as KEY=VALUE.
struct SettingWords {
    std::string key;
    std::string help;
    std::vector<std::string> values{};  // empty: any
};

/// The words that can follow the name of a program or of a subcommand.
struct CommandWords {
    std::string name;
    std::string help{};
    std::string argument{};  // what it takes beside options, as OptionWords::value; KEY=VALUE: settings
    std::vector<OptionWords> options{};
    std::vector<SettingWords> settings{};
    std::vector<CommandWords> subcommands{};
};

/// Those of a table. The values are known of enumerations, of true/false, and of env.game.
std::vector<SettingWords> setting_words(const ConfigTable& table);

/// A training program with these settings.
CommandWords train_words(const std::string& program, const ConfigTable& table);

/// The training program of the agent that `make_agent` makes.
template <class AgentConfig>
CommandWords train_words(const std::string& agent,
                         std::unique_ptr<Agent> (*)(const AgentConfig&, const AgentSpec&)) {
    RunConfig<AgentConfig> config;
    return train_words("train_" + agent, settings_of(config));
}

/// Returns the completion script of these programs for a shell: "bash", "zsh" or "fish". Throws
/// std::invalid_argument for any other.
std::string completion_script(std::string_view shell, std::span<const CommandWords> programs);

}  // namespace cale
