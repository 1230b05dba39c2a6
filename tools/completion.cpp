#include "tools/completion.h"

#include <algorithm>
#include <functional>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cale/games.h"
#include "settings/command_line.h"

namespace cale {
namespace {

// How a value is completed.
enum class Kind { none, flag, words, file, yaml_file, folder, setting };
struct Completion {
    Kind kind = Kind::none;
    std::string words{};  // with spaces between
};

/// This member of all items, with spaces between.
template <class Items, class Member>
std::string joined_members(const Items& items, Member member) {
    std::vector<std::string_view> words;
    words.reserve(items.size());
    for (const auto& item : items) words.push_back(std::invoke(member, item));
    return fmt::format("{}", fmt::join(words, " "));
}

Completion completion_of(std::string_view value) {
    if (value.empty()) return {Kind::flag};
    const auto open = value.find('{'), close = value.find('}');
    if (open < close && close != value.npos) {
        std::string words(value.substr(open + 1, close - open - 1));
        std::ranges::replace(words, ',', ' ');
        return {Kind::words, words};
    }
    if (value == "GAME") return {Kind::words, joined_members(all_games(), &Game::rom)};
    if (value == "DEVICE") return {Kind::words, "auto cpu cuda"};
    if (value == "KEY=VALUE") return {Kind::setting};
    if (value == "FILE.yaml") return {Kind::yaml_file};
    if (value.starts_with("FILE") || value.starts_with("RUN") || value.ends_with(".csv")) return {Kind::file};
    if (value.starts_with("DIR")) return {Kind::folder};
    return {};
}

/// Visits a program or each of its subcommands, whichever takes options, with the name of its function.
template <class Visit>
void for_each_command(std::span<const CommandWords> programs, const Visit& visit) {
    for (const auto& program : programs) {
        visit(program, program.name);
        for (const auto& command : program.subcommands) visit(command, program.name + "_" + command.name);
    }
}

// ---- bash ---------------------------------------------------------------------------

constexpr std::string_view kBashHead =
    R"(# Completion of cale's programs for bash. Made by `cale completion bash`.
_cale_words() { mapfile -t COMPREPLY < <(compgen -W "$1" -- "$cur"); }
_cale_files() { compopt -o filenames; mapfile -t COMPREPLY < <(compgen -f -- "$cur"); }
_cale_yaml_files() {
    compopt -o filenames
    mapfile -t COMPREPLY < <(compgen -d -- "$cur"; compgen -f -X '!*.y*ml' -- "$cur")
}
_cale_folders() { compopt -o filenames; mapfile -t COMPREPLY < <(compgen -d -- "$cur"); }
_cale_keys() { compopt -o nospace; mapfile -t COMPREPLY < <(compgen -S = -W "$1" -- "$cur"); }
_cale() {
    local program=${COMP_WORDS[0]##*/} cur=${COMP_WORDS[COMP_CWORD]} prev= key= command
    [ "$COMP_CWORD" -gt 0 ] && prev=${COMP_WORDS[COMP_CWORD-1]}
    # Bash makes three words of KEY=VALUE.
    if [ "$cur" = = ]; then key=$prev cur=
    elif [ "$prev" = = ]; then key=${COMP_WORDS[COMP_CWORD-2]}
    fi
    case $key in -*) prev=$key key= ;; esac
    command=_cale_in_$program
    if [ "$COMP_CWORD" -gt 1 ] && declare -F "${command}_${COMP_WORDS[1]}" >/dev/null; then
        command=${command}_${COMP_WORDS[1]}
    fi
    "$command"
}
)";

std::string bash_action(const Completion& completion) {
    switch (completion.kind) {
        case Kind::words:
            return fmt::format("_cale_words '{}'", completion.words);
        case Kind::file:
            return "_cale_files";
        case Kind::yaml_file:
            return "_cale_yaml_files";
        case Kind::folder:
            return "_cale_folders";
        case Kind::setting:
            return "_cale_keys \"$keys\"";
        default:
            return ":";
    }
}

std::string bash_script(std::span<const CommandWords> programs) {
    std::string script(kBashHead);
    for_each_command(programs, [&](const CommandWords& command, const std::string& name) {
        script += fmt::format("_cale_in_{}() {{\n", name);
        if (!command.settings.empty()) {
            script += fmt::format("    local keys='{}'\n    case $key in\n",
                                  joined_members(command.settings, &SettingWords::key));
            for (const auto& setting : command.settings) {
                if (!setting.values.empty())
                    script += fmt::format("        {}) _cale_words '{}'; return ;;\n", setting.key,
                                          fmt::join(setting.values, " "));
            }
            script += "        ?*) return ;;\n    esac\n";
        }
        script += "    case $prev in\n";
        for (const auto& option : command.options) {
            const auto completion = completion_of(option.value);
            if (completion.kind != Kind::flag)
                script += fmt::format("        {}) {}; return ;;\n", option.name, bash_action(completion));
        }
        script += fmt::format("    esac\n    case $cur in\n        -*) _cale_words '{}' ;;\n",
                              joined_members(command.options, &OptionWords::name));
        const auto argument =
            command.subcommands.empty()
                ? completion_of(command.argument)
                : Completion{Kind::words, joined_members(command.subcommands, &CommandWords::name)};
        script += fmt::format("        *) {} ;;\n    esac\n}}\n", bash_action(argument));
    });
    return script + fmt::format("complete -F _cale {}\n", joined_members(programs, &CommandWords::name));
}

// ---- zsh ----------------------------------------------------------------------------

/// For a word between single quotes in which brackets and colons are special.
std::string zsh_text(std::string_view text) {
    std::string result;
    for (const char c : text) {
        if (c == '\'') {
            result += "'\\''";
        } else {
            if (c == '[' || c == ']' || c == ':' || c == '\\') result += '\\';
            result += c;
        }
    }
    return result;
}

std::string zsh_action(const Completion& completion, std::string_view name) {
    switch (completion.kind) {
        case Kind::words:
            return fmt::format("({})", completion.words);
        case Kind::file:
            return "_files";
        case Kind::yaml_file:
            return "_files -g \"*.y(a|)ml\"";
        case Kind::folder:
            return "_files -/";
        case Kind::setting:
            return fmt::format("_cale_settings_{}", name);
        default:
            return " ";
    }
}

std::string zsh_settings(const CommandWords& command, const std::string& name) {
    std::string script = fmt::format("_cale_settings_{}() {{\n    local -a keys\n", name);
    script += "    if compset -P 1 '*='; then\n        case ${IPREFIX%=} in\n";
    for (const auto& setting : command.settings) {
        if (!setting.values.empty())
            script += fmt::format("            {}) compadd -- {} ;;\n", setting.key,
                                  fmt::join(setting.values, " "));
    }
    script += "        esac\n        return\n    fi\n    keys=(\n";
    for (const auto& setting : command.settings)
        script += fmt::format("        '{}:{}'\n", setting.key, zsh_text(setting.help));
    return script + "    )\n    _describe -t settings setting keys -S =\n}\n";
}

std::string zsh_script(std::span<const CommandWords> programs) {
    const std::string names = joined_members(programs, &CommandWords::name);
    std::string script = fmt::format(
        "#compdef {}\n# Completion of cale's programs for zsh. Made by `cale completion zsh`.\n", names);
    for_each_command(programs, [&](const CommandWords& command, const std::string& name) {
        if (!command.settings.empty()) script += zsh_settings(command, name);
        script += fmt::format("_cale_in_{}() {{\n", name);
        if (!command.subcommands.empty()) {
            script +=
                "    if (( CURRENT > 2 )); then\n        local command=$words[2]\n"
                "        shift words\n        (( CURRENT-- ))\n";
            script += fmt::format(
                "        (( $+functions[_cale_in_{0}_$command] )) && _cale_in_{0}_$command\n", name);
            script += "        return\n    fi\n    local -a commands\n    commands=(\n";
            for (const auto& subcommand : command.subcommands)
                script += fmt::format("        '{}:{}'\n", subcommand.name, zsh_text(subcommand.help));
            script += "    )\n    _describe -t commands command commands\n";
        }
        script += "    _arguments";
        for (const auto& option : command.options) {
            const auto completion = completion_of(option.value);
            script += fmt::format(
                " \\\n        '*{}[{}]{}'", option.name, zsh_text(option.help),
                completion.kind == Kind::flag ? "" : fmt::format(": :{}", zsh_action(completion, name)));
        }
        const auto argument = completion_of(command.argument);
        if (argument.kind != Kind::flag)
            script += fmt::format(" \\\n        '*: :{}'", zsh_action(argument, name));
        script += "\n}\n";
    });
    return script + fmt::format(R"(_cale() {{ "_cale_in_${{service:-${{words[1]:t}}}}"; }}
if [ "$funcstack[1]" = _cale ]; then _cale "$@"; else compdef _cale {}; fi
)",
                                names);
}

// ---- fish ---------------------------------------------------------------------------

std::string fish_text(std::string_view text) {
    std::string result;
    for (const char c : text) {
        if (c == '\'' || c == '\\') result += '\\';
        result += c;
    }
    return result;
}

/// -x: takes a value and nothing is guessed; -F: files after all.
std::string fish_action(const Completion& completion, std::string_view name) {
    switch (completion.kind) {
        case Kind::flag:
            return "";
        case Kind::words:
            return fmt::format(" -x -a '{}'", completion.words);
        case Kind::file:
        case Kind::yaml_file:
            return " -r -F";
        case Kind::folder:
            return " -x -a '(__fish_complete_directories)'";
        case Kind::setting:
            return fmt::format(" -x -a '(__cale_settings_{})'", name);
        default:
            return " -x";
    }
}

std::string fish_settings(const CommandWords& command, const std::string& name) {
    std::string script = fmt::format("function __cale_settings_{}\n    switch (commandline -ct)\n", name);
    for (const auto& setting : command.settings) {
        if (!setting.values.empty())
            script += fmt::format("        case '*{0}=*'\n            printf '{0}=%s\\n' {1}\n", setting.key,
                                  fmt::join(setting.values, " "));
    }
    script += "        case '*'\n";
    for (const auto& setting : command.settings)
        script +=
            fmt::format("            printf '%s\\t%s\\n' '{}=' '{}'\n", setting.key, fish_text(setting.help));
    return script + "    end\nend\n";
}

std::string fish_script(std::span<const CommandWords> programs) {
    std::string script = "# Completion of cale's programs for fish. Made by `cale completion fish`.\n";
    for (const auto& program : programs) {
        script += fmt::format("complete -c {} -f\n", program.name);
        for (const auto& command : program.subcommands) {
            script += fmt::format("complete -c {} -n __fish_use_subcommand -a {} -d '{}'\n", program.name,
                                  command.name, fish_text(command.help));
        }
        for_each_command({&program, 1}, [&](const CommandWords& command, const std::string& name) {
            if (!command.settings.empty()) script += fish_settings(command, name);
            std::string when = program.subcommands.empty() ? "" : " -n __fish_use_subcommand";
            if (&command != &program)
                when = fmt::format(" -n '__fish_seen_subcommand_from {}'", command.name);
            for (const auto& option : command.options) {
                script += fmt::format("complete -c {}{} -l {}{} -d '{}'\n", program.name, when,
                                      option.name.substr(2), fish_action(completion_of(option.value), name),
                                      fish_text(option.help));
            }
            const auto argument = completion_of(command.argument);
            if (argument.kind == Kind::file)
                script += fmt::format("complete -c {}{} -F\n", program.name, when);
            if (argument.kind == Kind::words || argument.kind == Kind::setting ||
                argument.kind == Kind::folder) {
                const std::string action = fish_action(argument, name).substr(3);  // no option: without -x
                script += fmt::format("complete -c {}{}{}\n", program.name, when, action);
            }
        });
    }
    return script;
}

}  // namespace

std::vector<SettingWords> setting_words(const ConfigTable& table) {
    std::vector<SettingWords> settings;
    for (const auto& entry : table.entries()) {
        SettingWords setting{.key = entry.key, .help = entry.help};
        if (const auto* member = std::get_if<EnumMember>(&entry.member))
            setting.values.assign(member->names.begin(), member->names.end());
        if (std::holds_alternative<bool*>(entry.member)) setting.values = {"true", "false"};
        if (entry.key == "env.game") {
            for (const Game& game : all_games()) setting.values.emplace_back(game.rom);
        }
        settings.push_back(std::move(setting));
    }
    return settings;
}

CommandWords train_words(const std::string& program, const ConfigTable& table) {
    CommandWords words{.name = program, .argument = "KEY=VALUE", .settings = setting_words(table)};
    for (const auto& option : train_options(table))
        words.options.push_back(
            {std::string(option.name), std::string(option.value), std::string(option.help)});
    return words;
}

std::string completion_script(std::string_view shell, std::span<const CommandWords> programs) {
    if (shell == "bash") return bash_script(programs);
    if (shell == "zsh") return zsh_script(programs);
    if (shell == "fish") return fish_script(programs);
    throw std::invalid_argument(fmt::format("no completion for '{}': bash, zsh or fish", shell));
}

}  // namespace cale
