#include "tools/usage.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <utility>

#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cale/env.h"
#include "cale/text.h"
#include "settings/config.h"
#include "tools/train_programs.h"

namespace cale {
namespace fs = std::filesystem;
namespace {

std::vector<std::string> option_names(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::Option* option : app.get_options())
        for (const auto& name : option->get_lnames()) names.push_back("--" + name);
    return names;
}

std::vector<std::string> command_names(const CLI::App& program) {
    std::vector<std::string> names;
    for (const CLI::App* command : program.get_subcommands({})) names.push_back(command->get_name());
    return names;
}

/// The command that the command line named, else the program itself.
const CLI::App& named_command(const CLI::App& program) {
    const auto commands = program.get_subcommands();
    return commands.empty() ? program : *commands.front();
}

/// "FILE" of "FILE:{a,b}": CLI11 puts behind a type what is checked.
std::string plain_type(const CLI::Option& option) {
    const auto type = option.get_type_name();
    return type.substr(0, type.find(':'));
}

std::string unknown_option(const CLI::App& app, const std::string& word) {
    const auto name = word.substr(0, word.find('='));
    return fmt::format("unknown option '{}'{}", name, did_you_mean(name, option_names(app)));
}

/// Words that no option and no argument took: a sentence about the first option among them, else about the
/// first word; empty if there are none.
std::string leftover(const CLI::App& command) {
    const auto words = command.remaining();
    if (words.empty()) return {};
    const auto option = std::ranges::find_if(words, [](const auto& word) { return word.starts_with('-'); });
    if (option != words.end()) return unknown_option(command, *option);
    const bool setting = words.front().find('=') != std::string::npos;
    const bool takes_settings = command.get_option_no_throw("--set") != nullptr;
    return fmt::format("unexpected argument '{}'{}", words.front(),
                       setting && takes_settings ? "; settings are given as --set KEY=VALUE" : "");
}

/// Settings of an environment alone, which only the --help of a training program lists.
ConfigTable environment_table(EnvConfig& env) {
    ConfigTable table("train_sac --help lists env.*");
    table.add("env", env);
    return table;
}

}  // namespace

CLI::Validator whole_numbers(std::int64_t least, std::int64_t most) {
    const auto read = [=](std::string& text) {
        std::int64_t number = 0;
        try {
            read_setting("", {.low = static_cast<double>(least), .high = static_cast<double>(most)}, text,
                         &number);
        } catch (const std::invalid_argument&) {
            return fmt::format("'{}': give a whole number from {} to {}", text, least, most);
        }
        text = std::to_string(number);  // for CLI11 010 would be 8
        return std::string();
    };
    return {read, fmt::format("INT in [{} - {}]", least, most)};
}

CLI::Validator numbers(double least, double most) {
    const auto read = [=](const std::string& text) {
        const auto number = number_in<double>(text);
        if (number && *number >= least && *number <= most) return std::string();
        return fmt::format("'{}': give a number from {} to {}", text, least, most);
    };
    return {read, fmt::format("FLOAT in [{} - {}]", least, most)};
}

CLI::Validator seeds() {
    return whole_numbers(0, std::numeric_limits<std::uint32_t>::max());
}

CLI::Validator one_of(const std::vector<std::string>& words) {
    const auto read = [=](const std::string& text) {
        if (std::ranges::find(words, text) != words.end()) return std::string();
        return fmt::format("'{}': give {}{}", text, fmt::join(words, " or "), did_you_mean(text, words));
    };
    return {read, fmt::format("{{{}}}", fmt::join(words, ","))};
}

void refuse_forgotten_values(CLI::App& program) {
    const auto all = [](CLI::App*) { return true; };
    for (CLI::Option* flag : program.get_options()) flag->disable_flag_override();
    for (CLI::App* command : program.get_subcommands(all)) {
        for (CLI::Option* option : command->get_options()) {
            if (option->get_items_expected_max() == 0) {
                option->disable_flag_override();
                continue;
            }
            option->check([command, option](const std::string& value) {
                if (!value.empty() &&
                    (!value.starts_with("--") || command->get_option_no_throw(value) == nullptr))
                    return std::string();
                return fmt::format("'{}': give {}{}", value, plain_type(*option),
                                   option->get_required() ? "" : ", or leave it out");
            });
        }
    }
}

void check_first_word(const CLI::App& program, const std::string& word) {
    if (word.starts_with('-')) {
        if (program.get_option_no_throw(word.substr(0, word.find('='))) == nullptr)
            throw ConfigError(fmt::format("{} (see cale --help)", unknown_option(program, word)));
        return;
    }
    const auto commands = command_names(program);
    if (std::ranges::find(commands, word) != commands.end()) return;
    std::vector<std::string> programs;
    for (const auto& train_program : train_programs()) programs.push_back(train_program.name);
    for (const auto& name : {word, "train_" + word}) {
        if (std::ranges::find(programs, name) == programs.end()) continue;
        throw ConfigError(
            fmt::format("{0} is a program of its own: {0} env.game=pong (see {0} --help)", name));
    }
    if (word == "train" || !nearest(word, programs).empty())
        throw ConfigError(fmt::format("unknown command '{}'; agents are trained by programs of their own: {}",
                                      word, fmt::join(programs, ", ")));
    const auto guess = did_you_mean(word, commands);
    throw ConfigError(
        fmt::format("unknown command '{}'{}", word, guess.empty() ? "; cale --help lists them" : guess));
}

std::string name_with_command(const CLI::App& program) {
    const auto& command = named_command(program);
    return &command == &program ? program.get_name()
                                : fmt::format("{} {}", program.get_name(), command.get_name());
}

std::string usage_sentence(const CLI::App& program, const CLI::ParseError& error) {
    const auto& command = named_command(program);
    const std::string what = error.what();
    const auto before = [&](std::string_view words) { return what.substr(0, what.find(words)); };
    // "--episodes: 'x': give a whole number from 1 to 1000000": the rest is of the functions above.
    if (dynamic_cast<const CLI::ValidationError*>(&error) != nullptr)
        return fmt::format("{} is {}", before(": "), what.substr(std::min(what.size(), what.find(": ") + 2)));
    if (dynamic_cast<const CLI::ExcludesError*>(&error) != nullptr)
        return fmt::format("{}: give one of them", what);  // "--greedy excludes --sampled"
    if (dynamic_cast<const CLI::RequiresError*>(&error) != nullptr)
        return fmt::format("{}: give both, or neither", what);  // "--video-episode requires --video"

    std::string sentence = before("\n");
    if (what.ends_with("disallowed flag override")) {  // "strict was given a disallowed flag override"
        sentence = fmt::format("--{} takes no value", before(" was given"));
    } else if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
        const auto name = before(":");
        const auto* option = command.get_option_no_throw(name);
        sentence = fmt::format(
            "{} {}", name,
            option != nullptr && option->count() > 1 ? "is given more than once" : "needs a value");
    } else if (const auto words = leftover(command); !words.empty()) {
        // CLI11 would rather say what a misspelled option was needed for.
        sentence = words;
    } else if (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr) {
        sentence = fmt::format("{} is missing", before(" is required"));
    }
    return fmt::format("{} (see {} --help)", sentence, name_with_command(program));
}

void set_environment(EnvConfig& env, const std::vector<std::string>& settings) {
    auto table = environment_table(env);
    for (const auto& setting : settings) {
        const auto key = setting.substr(0, setting.find('='));
        if (key.find('.') != key.npos && !key.starts_with("env.")) {
            throw ConfigError(fmt::format(
                "--set {}: nothing is trained here, so only settings env.* can be changed", setting));
        }
        table.set_override(setting);
    }
}

void load_environment(EnvConfig& env, const std::filesystem::path& file) {
    environment_table(env).load(file);
}

void check_roms(const EnvConfig& env) {
    try {
        static_cast<void>(find_roms(env));
    } catch (const std::runtime_error& error) {
        throw ConfigError(error.what());
    }
}

NewFolder make_output_folder(std::string_view option, const fs::path& folder) {
    const auto refusal = [&](std::string_view what, std::string_view why) {
        return ConfigError(fmt::format("{} {}: this folder cannot be {}: {}; give another", option,
                                       folder.string(), what, why));
    };
    std::optional<NewFolder> made;
    try {
        made.emplace(folder);
    } catch (const fs::filesystem_error& error) {
        throw refusal("made", error.code().message());
    }
    if (::access(folder.c_str(), W_OK | X_OK) != 0) throw refusal("written", std::strerror(errno));
    return std::move(*made);
}

fs::path shared_path(const fs::path& name, const fs::path& built) {
    const auto prefix = fs::read_symlink("/proc/self/exe").parent_path().parent_path();
    const auto installed = prefix / "share/cale" / name;
    return fs::exists(installed) ? installed : built;
}

void check_output_file(std::string_view option, const fs::path& file) {
    const auto refuse = [&](std::string_view why) {
        throw ConfigError(fmt::format("{} {}: {}", option, file.string(), why));
    };
    std::error_code ignored;
    if (fs::is_directory(file, ignored)) refuse("that is a folder; give the name of a file");
    const auto folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
    if (!fs::is_directory(folder, ignored))
        refuse(fmt::format("there is no folder '{}'; make it, or give another", folder.string()));
    if (::access(fs::exists(file, ignored) ? file.c_str() : folder.c_str(), W_OK) != 0)
        refuse(fmt::format("it cannot be written: {}; give another", std::strerror(errno)));
}

void check_picture_file(std::string_view option, const fs::path& file) {
    check_output_file(option, file);
    if (file.extension() != ".svg" && file.extension() != ".png")
        throw ConfigError(
            fmt::format("{} {}: a picture's name must end in .svg or .png", option, file.string()));
}

}  // namespace cale
