#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "cale/env.h"
#include "tools/commands.h"
#include "tools/completion.h"
#include "tools/train_programs.h"
#include "tools/usage.h"

namespace cale {
namespace {

/// What KEY=VALUE can be.
struct Settings {
    std::vector<SettingWords> environment;
    std::vector<SettingWords> sweep;  // of all agents
};

/// Those of every training program, and the sets of games that a sweep may name.
std::vector<SettingWords> sweep_settings(const std::vector<CommandWords>& programs) {
    std::vector<SettingWords> all;
    for (const auto& program : programs) {
        for (const auto& setting : program.settings) {
            const auto known = std::ranges::find(all, setting.key, &SettingWords::key);
            auto& merged = known == all.end() ? all.emplace_back(setting) : *known;
            for (const auto& value : setting.values)
                if (std::ranges::find(merged.values, value) == merged.values.end())
                    merged.values.push_back(value);
        }
    }
    auto& games = std::ranges::find(all, "env.game", &SettingWords::key)->values;
    games.insert(games.end(), {"atari100k", "paper_ten", "all"});
    return all;
}

/// What a subcommand of `cale`, or cale itself, understands.
CommandWords words_of(const CLI::App& app, const Settings& settings) {
    CommandWords words{.name = app.get_name(), .help = app.get_description()};
    words.help = words.help.substr(0, words.help.find(". "));
    for (const CLI::Option* option : app.get_options()) {
        const std::string value = option->get_type_size() == 0 ? "" : option->get_type_name();
        if (option->get_positional()) {
            words.argument = value;
            continue;
        }
        if (value == "KEY=VALUE")
            words.settings = words.name == "sweep" ? settings.sweep : settings.environment;
        for (const auto& name : option->get_lnames())
            words.options.push_back({"--" + name, value, option->get_description()});
    }
    for (const CLI::App* command : app.get_subcommands({}))
        words.subcommands.push_back(words_of(*command, settings));
    return words;
}

void print_script(const CLI::App& app, const std::string& shell) {
    EnvConfig env;
    ConfigTable table;
    table.add("env", env);
    std::vector<CommandWords> programs = train_programs();
    const Settings settings{.environment = setting_words(table), .sweep = sweep_settings(programs)};
    programs.insert(programs.begin(), words_of(app, settings));
    std::fputs(completion_script(shell, programs).c_str(), stdout);
}

}  // namespace

void add_completion(CLI::App& app) {
    auto& command = *app.add_subcommand("completion",
                                        "Prints the script that teaches a shell to complete cale and the "
                                        "training programs: options, settings, their values, games.");
    const auto shell = std::make_shared<std::string>();
    command.add_option("SHELL", *shell, "bash, zsh or fish")
        ->required()
        ->transform(one_of({"bash", "zsh", "fish"}))
        ->type_name("SHELL");
    command.footer(
        "Examples:\n"
        "  source <(cale completion bash)        for this shell; in ~/.bashrc for every one\n"
        "  cale completion zsh > ~/.zfunc/_cale  in a folder of $fpath\n"
        "  cale completion fish | source\n"
        "\n"
        "cmake --install puts them where the shells look.\n"
        "\n"
        "Exit codes: 0 done, 1 failed, 2 usage.");
    command.callback([&app, shell] { print_script(app, *shell); });
}

}  // namespace cale
