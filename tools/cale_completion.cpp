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

/// What a subcommand of `cale`, or cale itself, understands. Its KEY=VALUEs set the environment.
CommandWords words_of(const CLI::App& app, const std::vector<SettingWords>& settings) {
    CommandWords words{.name = app.get_name(), .help = app.get_description()};
    words.help = words.help.substr(0, words.help.find(". "));
    for (const CLI::Option* option : app.get_options()) {
        const std::string value = option->get_type_size() == 0 ? "" : option->get_type_name();
        if (option->get_positional()) {
            words.argument = value;
            continue;
        }
        if (value == "KEY=VALUE") words.settings = settings;
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
    programs.insert(programs.begin(), words_of(app, setting_words(table)));
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
